/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/options_view.h"

#include <math.h>
#include <stdlib.h>

#include "proto/base/number.h"

enum { MOST_FRAMES = 10000 }; /* their numbers have four digits */
enum { MOST_SAMPLES = 1024 }; /* of a pixel */

static const double least_fov = 0.1, most_fov = 170;
/* of a coordinate of the camera: rays have floats, and the camera may be beyond everything that floats can name */
static const double most_coordinate = 1e38;

static enum bvhd_status parse_point(const char *where, const char *text, double ret_point[3], struct bvhd_error *error)
{
    double point[3];
    const char *at = text;
    for (int i = 0; i < 3; i++) {
        char *end;
        point[i] = strtod(at, &end);
        if (end == at || *end != (i < 2 ? ',' : '\0'))
            return bvhd_error_set(error, BVHD_INVALID, where, "not of the form X,Y,Z: '%.60s'", text);
        if (!(fabs(point[i]) <= most_coordinate))
            return bvhd_error_set(error, BVHD_INVALID, where, "coordinates are numbers up to 1e38: '%.60s'", text);
        at = end + 1;
    }
    for (int i = 0; i < 3; i++)
        ret_point[i] = point[i];
    return BVHD_OK;
}

enum bvhd_status options_view_eye(const char *text, struct view_options *view, struct bvhd_error *error)
{
    enum bvhd_status status = parse_point("--eye", text, view->eye, error);
    view->has_eye |= status == BVHD_OK;
    return status;
}

enum bvhd_status options_view_look_at(const char *text, struct view_options *view, struct bvhd_error *error)
{
    enum bvhd_status status = parse_point("--look-at", text, view->look_at, error);
    view->has_look_at |= status == BVHD_OK;
    return status;
}

enum bvhd_status options_view_fov(const char *text, struct view_options *view, struct bvhd_error *error)
{
    char *end;
    double degrees = strtod(text, &end);
    if (end == text || *end || !(degrees >= least_fov && degrees <= most_fov))
        return bvhd_error_set(error, BVHD_INVALID, "--fov", "an angle from 0.1 to 170 degrees, not '%.60s'", text);
    view->fov = degrees;
    return BVHD_OK;
}

enum bvhd_status options_view_turn(const char *text, struct view_options *view, struct bvhd_error *error)
{
    return number_read32("--turn", text, (struct number_range){1, MOST_FRAMES, false}, &view->turn, error);
}

enum bvhd_status options_view_samples(const char *text, struct view_options *view, struct bvhd_error *error)
{
    return number_read32("--samples", text, (struct number_range){1, MOST_SAMPLES, false}, &view->samples, error);
}

enum bvhd_status options_view_times(const char *text, struct view_options *view, struct bvhd_error *error)
{
    char *end;
    const float first = strtof(text, &end);
    float last = first;
    bool is_number = end != text;
    if (is_number && *end == ':') {
        const char *second = end + 1;
        last = strtof(second, &end);
        is_number = end != second;
    }
    if (!is_number || *end)
        return bvhd_error_set(error, BVHD_INVALID, "--times", "not of the form A:B or A: '%.60s'", text);
    if (!(first >= 0 && first <= last && last <= 1))
        return bvhd_error_set(error, BVHD_INVALID, "--times", "they are in 0 .. 1, and B is not before A: '%.60s'",
                              text);
    view->times[0] = first;
    view->times[1] = last;
    view->has_times = true;
    return BVHD_OK;
}

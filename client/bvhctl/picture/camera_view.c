/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/camera_view.h"

static const double pi = 3.14159265358979323846;
static const double outside_angle = 0.3, inside_angle = 0.52; /* half of the vertical angle of view */
static const double margin = 0.86; /* the part of the picture's sides that the subject may take */

struct vector view_towards(const struct stage *stage, double azimuth, double elevation)
{
    struct vector side = vector_cross(stage->up, stage->front);
    struct vector level = vector_mad(vector_scale(stage->front, cos(azimuth)), side, sin(azimuth));
    return vector_mad(vector_scale(level, cos(elevation)), stage->up, sin(elevation));
}

void view_aim(struct camera *camera, const struct stage *stage, struct vector forward,
              const struct camera_options *options)
{
    double half_angle = options->fov > 0 ? options->fov / 2 : camera->is_inside ? inside_angle : outside_angle;
    camera->forward = forward;
    camera->right = vector_unit(vector_cross(forward, stage->up));
    if (vector_length(camera->right) < 0.5) /* it looks straight up or down */
        camera->right = vector_cross(stage->up, stage->front);
    camera->right = vector_unit(vector_mad(camera->right, forward, -vector_dot(camera->right, forward)));
    camera->up = vector_cross(camera->right, forward);
    camera->half_height = tan(half_angle);
    camera->half_width = camera->half_height * options->aspect;
}

double view_flatness(const struct stage *stage)
{
    struct vector extent = vector_sub(stage->high, stage->low);
    return extent.z / fmax(fmax(extent.x, extent.y), 1e-44);
}

/*
 * The box of points that should be in the picture. It is the bulk; but of a landscape, which is much wider than high,
 * only the middle, because otherwise everything on it would be tiny.
 */
struct focus {
    struct vector middle, reach; /* along the axes of the stage; `reach` is half of the extent */
};

/* Returns the point of the subject that is nearest to the middle of the bulk. */
static struct vector nearest_to_middle(const struct stage *stage, struct vector middle)
{
    struct vector nearest = middle;
    double least = INFINITY;
    for (uint32_t i = 0; i < stage->sample_count; i++) {
        struct vector at = stage_to_local(stage, stage->samples[i].at);
        double distance = vector_length(vector_sub(at, middle));
        if (stage->samples[i].is_subject && distance < least) {
            least = distance;
            nearest = at;
        }
    }
    return nearest;
}

static struct focus find_focus(const struct stage *stage, const struct camera_options *options)
{
    static const double whole = 0.501, middle_only = 0.26, landscape = 0.03;
    struct vector extent = vector_sub(stage->high, stage->low);
    double flatness = view_flatness(stage), closeness = options->closeness > 1 ? options->closeness : 1,
           rounding = 1e-6 * stage->size; /* the extent of a level plane is 0 */
    double wide = (flatness > 1e-4 && flatness < landscape ? middle_only : whole) / closeness;
    struct focus focus = {.middle = vector_scale(vector_add(stage->low, stage->high), 0.5)};
    if (closeness > 1)
        focus.middle = nearest_to_middle(stage, focus.middle);
    focus.reach = vector_make(wide * extent.x + rounding, wide * extent.y + rounding, whole * extent.z + rounding);
    return focus;
}

static bool in_focus(const struct stage *stage, const struct focus *focus, struct vector point)
{
    struct vector away = vector_sub(stage_to_local(stage, point), focus->middle);
    return fabs(away.x) <= focus->reach.x && fabs(away.y) <= focus->reach.y && fabs(away.z) <= focus->reach.z;
}

/* The size of the subject in the picture, by its samples, as seen from far away. */
struct fit {
    double left, right, bottom, top; /* of the outermost samples, relative to the centre of the view */
    double distance;
};

static void fit_point(const struct camera *camera, struct vector target, struct vector point, struct fit *fit)
{
    struct vector q = vector_sub(point, target);
    double x = vector_dot(q, camera->right), y = vector_dot(q, camera->up), z = vector_dot(q, camera->forward);
    double needed = fmax(fabs(x) / (camera->half_width * margin), fabs(y) / (camera->half_height * margin)) - z;
    fit->distance = fmax(fit->distance, needed);
    fit->left = fmin(fit->left, x);
    fit->right = fmax(fit->right, x);
    fit->bottom = fmin(fit->bottom, y);
    fit->top = fmax(fit->top, y);
}

static struct fit fit_subject(const struct stage *stage, const struct focus *focus, const struct camera *camera,
                              struct vector target)
{
    struct fit fit = {INFINITY, -INFINITY, INFINITY, -INFINITY, 0};
    for (uint32_t i = 0; i < stage->sample_count; i++) {
        const struct stage_sample *sample = &stage->samples[i];
        if (!sample->is_subject)
            continue;
        if (in_focus(stage, focus, sample->at))
            fit_point(camera, target, sample->at, &fit);
        for (int k = 0; k < 3; k++)
            if (in_focus(stage, focus, sample->corners[k]))
                fit_point(camera, target, sample->corners[k], &fit);
    }
    return fit;
}

/* Moves the target to the middle of what is seen. */
static struct vector centre_on(const struct stage *stage, const struct focus *focus, const struct camera *camera,
                               struct vector target)
{
    for (int i = 0; i < 2; i++) {
        struct fit fit = fit_subject(stage, focus, camera, target);
        if (fit.left > fit.right)
            return target;
        target = vector_mad(target, camera->right, (fit.left + fit.right) / 2);
        target = vector_mad(target, camera->up, (fit.bottom + fit.top) / 2);
    }
    return target;
}

/* Returns the distance from which the subject fits into the picture from every side, at the elevation of a camera. */
static double fit_around(const struct stage *stage, const struct focus *focus, const struct camera *camera,
                         struct vector target)
{
    enum { SIDES = 24 };
    double distance = 0;
    for (int i = 0; i < SIDES; i++) {
        struct camera turned = camera_turn(stage, camera, 2 * pi * i / SIDES);
        distance = fmax(distance, fit_subject(stage, focus, &turned, target).distance);
    }
    return distance;
}

struct camera view_outside(const struct stage *stage, const struct camera_options *options, struct vector forward)
{
    struct focus focus = find_focus(stage, options);
    struct camera camera = {0};
    view_aim(&camera, stage, forward, options);
    struct vector target = stage_to_world(stage, focus.middle);
    if (options->has_target)
        target = options->target;
    else if (!options->turns)
        target = centre_on(stage, &focus, &camera, target);
    double distance = options->turns ? fit_around(stage, &focus, &camera, target)
                                     : fit_subject(stage, &focus, &camera, target).distance;
    camera.origin = vector_mad(target, camera.forward, -fmax(distance, 1e-3 * stage->size));
    camera.pivot = target;
    return camera;
}

double view_azimuth(int index)
{
    int step = index % VIEW_AZIMUTHS, side = step % 2 ? -1 : 1;
    return side * 2 * pi * (step / 2 + 0.5) / VIEW_AZIMUTHS;
}

int view_level(int index)
{
    return index / VIEW_AZIMUTHS;
}

static struct camera inside_view(const struct stage *stage, const struct camera_options *options, int index)
{
    static const double heights[VIEW_HEIGHTS] = {0.2, 0.48}, elevations[VIEW_HEIGHTS] = {0.04, -0.06};
    int azimuth = index % VIEW_INSIDE_AZIMUTHS, stand = index / VIEW_INSIDE_AZIMUTHS, column = stand % VIEW_GRID,
        row = stand / VIEW_GRID % VIEW_GRID;
    int level = stand / (VIEW_GRID * VIEW_GRID);
    struct vector extent = vector_sub(stage->high, stage->low);
    struct vector local =
        vector_make(stage->low.x + extent.x * (column + 0.5) / VIEW_GRID,
                    stage->low.y + extent.y * (row + 0.5) / VIEW_GRID, stage->low.z + extent.z * heights[level]);
    struct camera camera = {.is_inside = true, .origin = stage_to_world(stage, local)};
    camera.pivot = camera.origin;
    view_aim(&camera, stage, view_towards(stage, 2 * pi * azimuth / VIEW_INSIDE_AZIMUTHS, elevations[level]), options);
    return camera;
}

struct camera view_make(const struct stage *stage, const struct camera_options *options, int index)
{
    static const double elevations[VIEW_ELEVATIONS] = {0.17, 0.31, 0.49, 0.7};
    if (index >= VIEWS_OUTSIDE)
        return inside_view(stage, options, index - VIEWS_OUTSIDE);
    struct vector from = view_towards(stage, view_azimuth(index), elevations[view_level(index)]);
    return view_outside(stage, options, vector_scale(from, -1));
}

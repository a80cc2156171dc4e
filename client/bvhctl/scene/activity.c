/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/activity.h"

#include <math.h>

static bool has_no_area(const float *const corners[3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - (double)corners[0][axis];
        b[axis] = (double)corners[2][axis] - (double)corners[0][axis];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

struct activity activity_of(const struct import_mesh *mesh)
{
    struct activity activity = {0};
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        const float *corners[3];
        bool has_nan = false, is_finite = true;
        for (int k = 0; k < 3; k++) {
            corners[k] = mesh->positions + 3 * (size_t)mesh->indices[3 * (size_t)i + (size_t)k];
            for (int axis = 0; axis < 3; axis++) {
                has_nan |= isnan(corners[k][axis]);
                is_finite &= isfinite(corners[k][axis]);
            }
        }
        activity.inactive += has_nan;
        activity.infinite += !has_nan && !is_finite;
        activity.degenerate += is_finite && has_no_area(corners);
    }
    return activity;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/activity.h"

#include <math.h>

#include "client/bvhctl/scene/import_round.h"

static bool has_no_area(const float *const corners[3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - (double)corners[0][axis];
        b[axis] = (double)corners[2][axis] - (double)corners[0][axis];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

/*
 * A primitive of points or lines is inactive with a NaN, infinite with an infinity, and degenerate if no radius is
 * greater than 0. Radii are finite.
 */
static struct activity activity_of_round(const struct import_mesh *mesh)
{
    struct activity activity = {0};
    uint32_t corners = import_shape_kinds[mesh->shape].corners;
    for (uint32_t i = 0; i < mesh->primitive_count; i++) {
        bool has_nan = false, is_finite = true, has_radius = false;
        for (uint32_t k = 0; k < corners; k++) {
            uint32_t vertex = mesh->indices[(size_t)i * corners + k];
            for (size_t axis = 0; axis < 3; axis++) {
                has_nan |= isnan(mesh->positions[3 * (size_t)vertex + axis]);
                is_finite &= isfinite(mesh->positions[3 * (size_t)vertex + axis]);
            }
            has_radius |= mesh->radii[vertex] > 0;
        }
        activity.inactive += has_nan;
        activity.infinite += !has_nan && !is_finite;
        activity.degenerate += is_finite && !has_radius;
    }
    return activity;
}

struct activity activity_of(const struct import_mesh *mesh)
{
    struct activity activity = {0};
    if (mesh->shape != IMPORT_TRIANGLES)
        return activity_of_round(mesh);
    for (uint32_t i = 0; i < mesh->primitive_count; i++) {
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

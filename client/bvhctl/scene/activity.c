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

/* Returns whether a triangle has no area at all times: two corners are one, or all are on a line along an axis. */
static bool has_no_area_at_any_time(const float *const corners[2][3])
{
    int flat = 0;
    bool has_twins = false;
    for (int axis = 0; axis < 3; axis++) {
        bool is_flat = true;
        for (int key = 0; key < 2; key++)
            is_flat &= corners[key][0][axis] == corners[key][1][axis] && corners[key][0][axis] == corners[key][2][axis];
        flat += is_flat;
    }
    for (int k = 0; k < 3; k++) {
        bool are_same = true;
        for (int i = 0; i < 6; i++)
            are_same &= corners[i / 3][k][i % 3] == corners[i / 3][(k + 1) % 3][i % 3];
        has_twins |= are_same;
    }
    return flat >= 2 || has_twins;
}

/* Adds a triangle, by its corners at both ends of its motion, which are the same if it stands still. */
static void add_triangle(const float *const corners[2][3], bool moves, struct activity *activity)
{
    bool has_nan = false, is_finite = true;
    for (int i = 0; i < (moves ? 18 : 9); i++) {
        has_nan |= isnan(corners[i / 9][i / 3 % 3][i % 3]);
        is_finite &= isfinite(corners[i / 9][i / 3 % 3][i % 3]);
    }
    activity->inactive += has_nan;
    activity->infinite += !has_nan && !is_finite;
    activity->degenerate += is_finite && (moves ? has_no_area_at_any_time(corners) : has_no_area(corners[0]));
}

struct activity activity_of(const struct import_mesh *mesh)
{
    struct activity activity = {0};
    const float *const ends[2] = {mesh->positions, mesh->end_positions ? mesh->end_positions : mesh->positions};
    if (mesh->shape != IMPORT_TRIANGLES)
        return activity_of_round(mesh);
    for (uint32_t i = 0; i < mesh->primitive_count; i++) {
        const float *corners[2][3];
        for (int k = 0; k < 6; k++)
            corners[k / 3][k % 3] = ends[k / 3] + 3 * (size_t)mesh->indices[3 * (size_t)i + (size_t)(k % 3)];
        add_triangle((const float *const(*)[3])corners, mesh->end_positions != NULL, &activity);
    }
    return activity;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* traverse_state.c - puts a ray into object space and into bottom levels, and decides whether it can hit anything. */
#include "builder/traverse/traverse_state.h"

#include <math.h>

static void cross(const double a[3], const double b[3], double ret_product[3])
{
    ret_product[0] = a[1] * b[2] - a[2] * b[1];
    ret_product[1] = a[2] * b[0] - a[0] * b[2];
    ret_product[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/*
 * The matrix is inverted in double (Cramer's rule), once per visit. The inverses that layouts store are rounded to
 * float, which is not precise enough: rays would not meet the same side of shared edges as the exact ray.
 */
void traverse_inverse_init(const float object_to_world[12], struct traverse_inverse *ret_inverse)
{
    double columns[3][3], (*rows)[3] = ret_inverse->rows;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            columns[j][i] = object_to_world[4 * i + j];
    cross(columns[1], columns[2], rows[0]);
    cross(columns[2], columns[0], rows[1]);
    cross(columns[0], columns[1], rows[2]);
    ret_inverse->scale = 1 / dot(columns[0], rows[0]);
}

void traverse_state_to_object(struct traverse_state *state, const float object_to_world[12])
{
    const struct ray *ray = state->ray;
    struct traverse_inverse inverse;
    double offset[3], direction[3];
    state->object_to_world = object_to_world;
    traverse_inverse_init(object_to_world, &inverse);
    for (int i = 0; i < 3; i++) {
        offset[i] = (double)ray->origin[i] - object_to_world[4 * i + 3];
        direction[i] = ray->direction[i];
    }
    for (int i = 0; i < 3; i++) {
        state->origin[i] = dot(inverse.rows[i], offset) * inverse.scale;
        state->direction[i] = dot(inverse.rows[i], direction) * inverse.scale;
    }
}

bool traverse_state_enter(struct traverse_state *state, const struct traverse_instance *instance, uint32_t skip_flag,
                          bool is_triangles)
{
    if (!traverse_state_settle(state, instance, skip_flag, is_triangles))
        return false;
    if (is_triangles)
        triangle_ray_init(state->origin, state->direction, &state->triangle_ray);
    return true;
}

bool traverse_state_is_usable(const struct traverse_state *state)
{
    const double *direction = state->direction;
    bool is_zero = direction[0] == 0 && direction[1] == 0 && direction[2] == 0;
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(state->origin[axis]) || !isfinite(direction[axis]))
            return false;
    return !is_zero;
}

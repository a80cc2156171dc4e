/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_ray.h"

#include <math.h>

enum oracle_ray_kind oracle_ray_init(struct oracle_ray *ret_prepared, const struct ray *ray)
{
    int z = 0;
    for (int axis = 0; axis < 3; axis++) {
        if (!isfinite(ray->origin[axis]) || !isfinite(ray->direction[axis]))
            return ORACLE_RAY_EMPTY;
        z = fabsf(ray->direction[axis]) > fabsf(ray->direction[z]) ? axis : z;
    }
    /* The comparison is false, and the ray empty, also if tmin or tmax is NaN. */
    if (ray->direction[z] == 0 || !(ray->tmin < ray->tmax))
        return ORACLE_RAY_EMPTY;
    struct radial along = radial_input(ray->direction[z]);
    if (!radial_is_nonzero(along))
        return ORACLE_RAY_VAGUE;

    struct oracle_ray prepared = {.x = (z + 1) % 3, .y = (z + 2) % 3, .z = z, .direction_z = along};
    prepared.origin[0] = radial_input(ray->origin[prepared.x]);
    prepared.origin[1] = radial_input(ray->origin[prepared.y]);
    prepared.origin[2] = radial_input(ray->origin[z]);
    prepared.shear[0] = radial_div(radial_input(ray->direction[prepared.x]), along);
    prepared.shear[1] = radial_div(radial_input(ray->direction[prepared.y]), along);
    for (int axis = 0; axis < 3; axis++) {
        prepared.from[axis] = radial_input(ray->origin[axis]);
        prepared.along[axis] = radial_input(ray->direction[axis]);
    }
    prepared.tmin = ray->tmin;
    prepared.tmax = ray->tmax;
    prepared.flags = ray->flags;
    *ret_prepared = prepared;
    return ORACLE_RAY_GOOD;
}

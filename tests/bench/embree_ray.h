/* SPDX-License-Identifier: Apache-2.0 */
/* embree_ray.h - converts a ray to Embree's. */
#ifndef BVHD_BENCH_EMBREE_RAY_H
#define BVHD_BENCH_EMBREE_RAY_H

#include "builder/piece/embree_version.h"
#include "builder/traverse/traverse.h"

static inline struct RTCRay embree_ray(const struct ray *ray)
{
    return (struct RTCRay){.org_x = ray->origin[0],
                           .org_y = ray->origin[1],
                           .org_z = ray->origin[2],
                           .dir_x = ray->direction[0],
                           .dir_y = ray->direction[1],
                           .dir_z = ray->direction[2],
                           .tnear = ray->tmin,
                           .tfar = ray->tmax,
                           .mask = ~0u};
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* device_ray.h - rays as shaders read them (struct bvhd_ray). */
#ifndef BVHCTL_DEVICE_RAY_H
#define BVHCTL_DEVICE_RAY_H

#include <string.h>

#include <bvhd/bvhd_trace.h>

#include "builder/traverse/ray.h"

static inline void device_rays_put(const struct ray *rays, uint32_t count, struct bvhd_ray *ret_rays)
{
    for (uint32_t i = 0; i < count; i++) {
        struct bvhd_ray *to = &ret_rays[i];
        *to = (struct bvhd_ray){.tmin = rays[i].tmin,
                                .tmax = rays[i].tmax,
                                .flags = rays[i].flags,
                                .mask = rays[i].cull_mask,
                                .time = rays[i].time};
        memcpy(to->origin, rays[i].origin, sizeof to->origin);
        memcpy(to->direction, rays[i].direction, sizeof to->direction);
    }
}

#endif

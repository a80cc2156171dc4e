/* SPDX-License-Identifier: Apache-2.0 */
/* device_ray.h - a ray as shaders read it (kernels/trace_rays.glsl). */
#ifndef BVHCTL_DEVICE_RAY_H
#define BVHCTL_DEVICE_RAY_H

#include <string.h>

#include "builder/traverse/traverse.h"

struct device_ray {
    float origin[3], tmin;
    float direction[3], tmax;
    uint32_t flags, mask, reserved[2];
};

_Static_assert(sizeof(struct device_ray) == 48, "as shaders have it");

static inline void device_rays_put(const struct ray *rays, uint32_t count, struct device_ray *ret_rays)
{
    for (uint32_t i = 0; i < count; i++) {
        struct device_ray *to = &ret_rays[i];
        *to = (struct device_ray){
            .tmin = rays[i].tmin, .tmax = rays[i].tmax, .flags = rays[i].flags, .mask = rays[i].cull_mask};
        memcpy(to->origin, rays[i].origin, sizeof to->origin);
        memcpy(to->direction, rays[i].direction, sizeof to->direction);
    }
}

#endif

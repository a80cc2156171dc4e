/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer.h"

#include <math.h>

const struct tracer_hit tracer_miss = {.t = INFINITY, .instance = RAY_NO_INSTANCE};

static uint32_t flags_of(const struct ray_hit *hit)
{
    return (hit->front_face ? TRACER_FRONT_FACE : 0u) | (hit->is_aabb ? TRACER_AABB : 0u) |
           (hit->is_sphere ? TRACER_SPHERE : 0u) | (hit->is_swept_sphere ? TRACER_SWEPT_SPHERE : 0u);
}

struct tracer_hit tracer_hit_of(const struct ray_hit *hit)
{
    return (struct tracer_hit){.t = hit->t,
                               .u = hit->u,
                               .v = hit->v,
                               .instance = hit->instance,
                               .custom_index = hit->custom_index,
                               .geometry = hit->geometry,
                               .primitive = hit->primitive,
                               .flags = flags_of(hit)};
}

void tracer_destroy(struct tracer *tracer)
{
    if (tracer)
        tracer->destroy(tracer);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer.h"

#include <math.h>

const struct tracer_hit tracer_miss = {.t = INFINITY, .instance = RAY_NO_INSTANCE};

struct tracer_hit tracer_hit_of(const struct ray_hit *hit)
{
    return (struct tracer_hit){.t = hit->t,
                               .u = hit->u,
                               .v = hit->v,
                               .instance = hit->instance,
                               .custom_index = hit->custom_index,
                               .geometry = hit->geometry,
                               .primitive = hit->primitive,
                               .flags = (hit->front_face ? TRACER_FRONT_FACE : 0) | (hit->is_aabb ? TRACER_AABB : 0)};
}

void tracer_destroy(struct tracer *tracer)
{
    if (tracer)
        tracer->destroy(tracer);
}

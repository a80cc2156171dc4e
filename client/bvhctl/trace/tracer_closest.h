/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer_closest.h - quicker kernels for what most rays ask: the closest triangle, without flags
 * (kernels/trace_closest.comp). One takes rays that go together, the other one those that do not; they answer as the
 * query does.
 */
#ifndef BVHCTL_TRACER_CLOSEST_H
#define BVHCTL_TRACER_CLOSEST_H

#include "client/bvhctl/trace/tracer_device.h"

/* What a tracer of portable structures runs. */
enum tracer_way {
    TRACER_WAY_AUTO, /* by the rays */
    TRACER_WAY_QUERY, /* what every ray can be traced by */
    TRACER_WAY_TOGETHER, /* a thread a ray */
    TRACER_WAY_REFILL, /* rays are handed out to lanes as these get free */
};

struct tracer_closest {
    enum tracer_way way;
    int together, refill; /* places among the choices; -1: neither of them is there */
};

/*
 * Adds the kernels to a tracer whose bindings are rays, hits, scene; binding 3 becomes tracer_closest's. `structures`
 * decide whether there is anything to add: with AABBs only the query is right.
 */
enum bvhd_status tracer_closest_init(struct tracer_closest *closest, struct tracer_device *device,
                                     const struct structures *structures, bool has_fused_fma, struct bvhd_error *error);

/* For tracer_device's choose. */
int tracer_closest_choose(const struct tracer_closest *closest, const struct ray *rays, uint64_t count);

/* Of a tracer of tracer_portable_create: from now on that way, for rays and scenes that it is right for. */
void tracer_portable_set_way(struct tracer *tracer, enum tracer_way way);

#endif

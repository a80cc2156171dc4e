/* SPDX-License-Identifier: Apache-2.0 */
/* bench_embree.h - traces the rays of bench_rays.h through a scene of Embree. */
#ifndef BVHD_BENCH_EMBREE_H
#define BVHD_BENCH_EMBREE_H

#include "tests/bench/bench_rays.h"
#include "tests/bench/embree_ray.h"

#if RTC_VERSION_MAJOR >= 4
#define BENCH_INTERSECT(scene, arguments, hit) rtcIntersect1(scene, hit, arguments)
#define BENCH_OCCLUDED(scene, arguments, ray) rtcOccluded1(scene, ray, arguments)
#else
#define RTCIntersectArguments RTCIntersectContext
#define RTCOccludedArguments RTCIntersectContext
#define rtcInitIntersectArguments rtcInitIntersectContext
#define rtcInitOccludedArguments rtcInitIntersectContext
#define BENCH_INTERSECT rtcIntersect1
#define BENCH_OCCLUDED rtcOccluded1
#endif

/* Traces the rays one by one, and returns how many have hit. */
static inline uint32_t bench_trace_embree(RTCScene scene, const struct bench_rays *rays, enum bench_kind kind)
{
    uint32_t hits = 0;
    struct RTCIntersectArguments closest;
    struct RTCOccludedArguments any;
    rtcInitIntersectArguments(&closest);
    rtcInitOccludedArguments(&any);
    for (uint32_t i = 0; i < rays->count; i++) {
        struct RTCRayHit hit = {.ray = embree_ray((const struct ray *)&rays->rays[i]),
                                .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
        hit.ray.time = rays->rays[i].time;
        if (kind == BENCH_SHADOW)
            BENCH_OCCLUDED(scene, &any, &hit.ray);
        else
            BENCH_INTERSECT(scene, &closest, &hit);
        hits += kind == BENCH_SHADOW ? hit.ray.tfar < 0 : hit.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
}

#endif

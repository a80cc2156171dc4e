/* SPDX-License-Identifier: Apache-2.0 */
/* embree_api.h - opens a device of Embree, counts its memory, and names its qualities. */
#ifndef BVHD_BENCH_EMBREE_API_H
#define BVHD_BENCH_EMBREE_API_H

#include <stdatomic.h>
#include <stdio.h>

#include "builder/piece/embree_version.h"
#include "tests/bench/bvhd_bench/method.h"

/* Opens a device whose memory monitor counts the bytes that it holds in *live. Returns NULL when there is no device. */
static inline RTCDevice embree_api_device(unsigned threads, RTCMemoryMonitorFunction monitor, atomic_llong *live)
{
    char config[32];
    snprintf(config, sizeof config, "threads=%u", threads);
    RTCDevice device = rtcNewDevice(config);
    if (device)
        rtcSetDeviceMemoryMonitorFunction(device, monitor, live);
    return device;
}

static inline bool embree_api_count(void *live, ssize_t bytes, bool post)
{
    (void)post;
    atomic_fetch_add_explicit((atomic_llong *)live, (long long)bytes, memory_order_relaxed);
    return true;
}

static inline enum RTCBuildQuality embree_api_quality(enum method_effort effort)
{
    return effort == EFFORT_LOW    ? RTC_BUILD_QUALITY_LOW
           : effort == EFFORT_HIGH ? RTC_BUILD_QUALITY_HIGH
                                   : RTC_BUILD_QUALITY_MEDIUM;
}

#endif

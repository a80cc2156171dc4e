/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_vulkan_busy.h - keeps a device busy before something short is measured, so that its clock is what it is under
 * load.
 */
#ifndef BVHD_BENCH_VULKAN_BUSY_H
#define BVHD_BENCH_VULKAN_BUSY_H

#include "client/bvhctl/gpu/gpu.h"

struct bench_busy {
    struct gpu *gpu;
    struct gpu_kernel kernel;
    struct gpu_buffer buffer;
    uint32_t rounds; /* that take about the time asked for; 0: nothing to do, the device is a CPU */
};

/* Measures how much work takes `milliseconds`. End with bench_busy_finish. */
enum bvhd_status bench_busy_init(struct bench_busy *busy, struct gpu *gpu, double milliseconds,
                                 struct bvhd_error *error);
void bench_busy_finish(struct bench_busy *busy);

/* Works, and waits for it. */
enum bvhd_status bench_busy_run(struct bench_busy *busy, struct bvhd_error *error);

#endif

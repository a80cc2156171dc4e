/* SPDX-License-Identifier: Apache-2.0 */
/* bench_vulkan_busy.h - keeps a device busy before a short measurement, so that its clock is as high as under load. */
#ifndef BVHD_BENCH_VULKAN_BUSY_H
#define BVHD_BENCH_VULKAN_BUSY_H

#include "client/bvhctl/gpu/gpu.h"

struct bench_busy {
    struct gpu *gpu;
    struct gpu_kernel kernel;
    struct gpu_buffer buffer;
    uint32_t rounds; /* rounds that take about the time asked for; 0: the device is a CPU and needs no work */
};

/* Measures how many rounds take `milliseconds`. The caller ends it with bench_busy_finish, unless it fails. */
enum bvhd_status bench_busy_init(struct bench_busy *busy, struct gpu *gpu, double milliseconds,
                                 struct bvhd_error *error);
void bench_busy_finish(struct bench_busy *busy);

/* Submits the rounds and waits until the device has done them. */
enum bvhd_status bench_busy_run(struct bench_busy *busy, struct bvhd_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bench_vulkan_busy.h"

#include "tests/bench/busy_comp.h"
#include "proto/base/clock.h"

enum { GROUPS = 4096, FIRST_ROUNDS = 256 };

enum bvhd_status bench_busy_run(struct bench_busy *busy, struct bvhd_error *error)
{
    VkCommandBuffer commands;
    if (!busy->rounds)
        return BVHD_OK;
    enum bvhd_status status = gpu_begin(busy->gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    gpu_kernel_record(busy->gpu, &busy->kernel, commands, &busy->rounds, GROUPS);
    return gpu_submit(busy->gpu, commands, error);
}

/* Doubles the rounds until they take the time asked for, which also raises the device's clock. */
static enum bvhd_status calibrate(struct bench_busy *busy, double milliseconds, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    busy->rounds = FIRST_ROUNDS;
    for (double took = 0; status == BVHD_OK && took < milliseconds / 2 && busy->rounds < 1u << 24;) {
        uint64_t began = clock_ns();
        busy->rounds *= 2;
        status = bench_busy_run(busy, error);
        took = (double)(clock_ns() - began) * 1e-6;
    }
    return status;
}

enum bvhd_status bench_busy_init(struct bench_busy *busy, struct gpu *gpu, double milliseconds,
                                 struct bvhd_error *error)
{
    *busy = (struct bench_busy){.gpu = gpu};
    if (gpu->properties.type == VK_PHYSICAL_DEVICE_TYPE_CPU)
        return BVHD_OK;
    struct gpu_kernel_options options = {
        .code = busy_comp, .size = sizeof busy_comp, .bindings = 1, .push_size = sizeof busy->rounds};
    enum bvhd_status status =
        gpu_buffer_create(gpu, 256, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, GPU_DEVICE, &busy->buffer, error);
    if (status == BVHD_OK)
        status = gpu_kernel_create(gpu, &options, &busy->kernel, error);
    if (status == BVHD_OK) {
        const struct gpu_buffer *bound[] = {&busy->buffer};
        gpu_kernel_bind(gpu, &busy->kernel, bound, NULL);
        status = calibrate(busy, milliseconds, error);
    }
    if (status != BVHD_OK)
        bench_busy_finish(busy);
    return status;
}

void bench_busy_finish(struct bench_busy *busy)
{
    if (!busy->gpu)
        return;
    if (busy->kernel.pipeline)
        gpu_kernel_destroy(busy->gpu, &busy->kernel);
    gpu_buffer_destroy(busy->gpu, &busy->buffer);
    *busy = (struct bench_busy){0};
}

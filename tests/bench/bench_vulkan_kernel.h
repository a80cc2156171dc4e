/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_vulkan_kernel.h - rays through portable structures by a kernel from a file: to measure many against each other.
 *
 * A kernel's bindings are rays, hits (kernels/trace_rays.glsl), the scene, and words that are 0 at first. Push
 * constants: count, has_top, location of the root, address of the scene's buffer. Constant 0 is the workgroup's size,
 * constant 1 the number of workgroups; where that is 0 there is a thread for each ray. A second kernel may follow the
 * first.
 */
#ifndef BVHD_BENCH_VULKAN_KERNEL_H
#define BVHD_BENCH_VULKAN_KERNEL_H

#include "client/bvhctl/trace/tracer.h"

/*
 * `text`: "NAME=FILE.spv[:CONSTANT,...][+FILE.spv[:CONSTANT,...]]"; constants default to 64 and 0. `statistics`: prints
 * the driver's.
 */
enum bvhd_status bench_kernel_create(struct gpu *gpu, const char *text, bool statistics,
                                     const struct structures *structures, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error);

/*
 * bench_vulkan_statistics.c: compiles the kernel once more and prints what the driver tells of it in one line; nothing
 * where it does not.
 */
void bench_statistics_of(struct gpu *gpu, const char *name, const struct gpu_kernel_options *options,
                         VkPipelineLayout layout);
void bench_statistics_print(struct gpu *gpu, const char *name, VkPipeline pipeline);

#endif

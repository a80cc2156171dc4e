/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_vulkan_kernel.h - traces rays through portable structures with a kernel from a file, so that many kernels can
 * be compared with each other.
 *
 * The bindings of a kernel are the rays, the hits (kernels/trace_rays.glsl), the scene, and words that are initially 0.
 * The push constants are count, has_top, the location of the root, and the address of the scene's buffer.
 * Specialization constant 0 is the size of a workgroup, constant 1 the number of workgroups; if constant 1 is 0, there
 * is a thread for each ray. A second kernel may follow the first.
 */
#ifndef BVHD_BENCH_VULKAN_KERNEL_H
#define BVHD_BENCH_VULKAN_KERNEL_H

#include "client/bvhctl/trace/tracer.h"

/*
 * Creates a tracer from `text`: "NAME=FILE.spv[:CONSTANT,...][+FILE.spv[:CONSTANT,...]]"; constants default to 64 and
 * 0. With `statistics` it also prints the driver's statistics of the kernels.
 */
enum bvhd_status bench_kernel_create(struct gpu *gpu, const char *text, bool statistics,
                                     const struct structures *structures, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error);

/*
 * In bench_vulkan_statistics.c: compiles the kernel once more and prints the driver's statistics of it in one line.
 * Prints nothing where the driver has none.
 */
void bench_statistics_of(struct gpu *gpu, const char *name, const struct gpu_kernel_options *options,
                         VkPipelineLayout layout);
void bench_statistics_print(struct gpu *gpu, const char *name, VkPipeline pipeline);

#endif

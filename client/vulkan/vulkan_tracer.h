/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_tracer.h - the parts behind bvhd_trace.h: what a device and a scene let a tracer use, the kernels that follow
 * from it (vulkan_tracer.c), buffers and recording (vulkan_trace.c).
 */
#ifndef BVHD_VULKAN_TRACER_H
#define BVHD_VULKAN_TRACER_H

#include <bvhd/bvhd_trace.h>

#include "client/vulkan/vulkan_buffer.h"
#include "client/vulkan/vulkan_contents.h"
#include "client/vulkan/vulkan_kernel.h"

enum {
    VULKAN_TRACE_GROUP = 64, /* threads of a workgroup, where nothing else is chosen */
    VULKAN_TRACE_HEAD = 16, /* bytes of counters at the start of the scratch memory: struct vulkan_trace_counters */
};

/* The counters of the kernels, which are 0 before they run. */
struct vulkan_trace_counters {
    uint32_t next_ray; /* where persistent threads take new rays from */
    uint32_t fallback; /* rays that are left to the portable query */
    uint32_t unresolved; /* rays with undecided triangles, which are left to the resolve kernel */
    uint32_t undecided; /* undecided triangles of all rays, those that there was no room for too */
};

/* Properties of a device by which the kernels are chosen. */
struct vulkan_trace_traits {
    bool has_quick_doubles; /* a few operations on doubles do not slow down a shader */
    bool has_small_halves; /* shaders convert denormal halves exactly, and quickly */
    bool has_fused_fma; /* fma() rounds once */
    bool has_ballots;
    bool has_shuffles; /* and votes; no lane of a subgroup is missing, and 32 bits have one for each */
    bool is_cpu;
    uint32_t lanes; /* of a subgroup */
    uint32_t multiprocessors; /* 0: not known */
};

/* The structures that are traced, all in one buffer. */
struct vulkan_trace_scene {
    VkBuffer buffer;
    VkDeviceSize size;
    uint64_t base; /* the buffer's address; 0 where locations are offsets in it */
    uint64_t root; /* location */
    bool has_top;
    struct vulkan_contents contents;
};

/* A kernel that traces all rays of a record. */
struct vulkan_trace_pass {
    VkPipeline pipeline;
    uint32_t max_groups; /* 0: a thread for each ray; else the most workgroups, whose threads take rays */
    bool resolves; /* it decides on undecided triangles itself, so the resolve kernel need not follow */
};

/* The push constants of all kernels, as bvhd_trace_rays.glsl declares them. */
struct vulkan_trace_push {
    uint32_t count;
    uint32_t has_top;
    uint32_t root[2];
    uint32_t scene_base[2];
    uint32_t ray_flags;
};

struct bvhd_tracer {
    const struct bvhd_vulkan_device *device;
    struct vulkan_layout layout;
    VkPipelineCache cache; /* of the options */
    struct vulkan_trace_scene scene;
    VkPipeline query; /* traces every kind of ray */
    bool has_closest; /* the following kernels are there */
    struct vulkan_trace_pass coherent, incoherent;
    VkPipeline resolve, fallback; /* run after these */
};

/* Compiles the kernels for a scene on a device with these traits. bvhd_tracer_create finds out both, and calls it. */
enum bvhd_status vulkan_tracer_create(const struct bvhd_vulkan_device *device, const struct vulkan_trace_scene *scene,
                                      const struct vulkan_trace_traits *traits, VkPipelineCache cache,
                                      struct bvhd_tracer **ret_tracer, struct bvhd_error *error);

/* Finds the traits of a device (vulkan_trace_traits.c). Without a queue (NULL) has_small_halves is false. */
struct vulkan_trace_traits vulkan_trace_traits_of(struct bvhd_vulkan_device *device,
                                                  const struct bvhd_vulkan_queue *queue, bool has_float64);

/*
 * Returns whether shaders convert denormal halves (16-bit floats) to floats exactly: Vulkan allows a device to take
 * them for 0. It runs a kernel, waits, and returns false when that fails.
 */
bool vulkan_keeps_small_halves(const struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue);

#endif

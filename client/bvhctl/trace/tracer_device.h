/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer_device.h - what tracers on a Vulkan device have in common: rays go up in portions, a kernel runs over them,
 * hits come back. The kernel's first two bindings are rays and hits (kernels/trace_rays.glsl), its push constants begin
 * with struct tracer_push.
 */
#ifndef BVHCTL_TRACER_DEVICE_H
#define BVHCTL_TRACER_DEVICE_H

#include "client/bvhctl/trace/tracer.h"

enum {
    TRACER_PORTION = 1 << 22, /* most rays of a dispatch, where buffers may be as large as theirs */
    TRACER_GROUP = 64, /* threads of a workgroup, specialisation constant 0 */
    TRACER_BINDINGS = 8, /* most storage buffers */
    TRACER_CHOICES = 2, /* kernels beside the first one */
    TRACER_AFTER_GROUPS = 256, /* of the kernels that run after these */
};

/* As kernels declare it. */
struct tracer_push {
    uint32_t count; /* of rays; filled by tracer_device_trace */
    uint32_t has_top;
    uint32_t extra[2]; /* for the kind of tracer */
    uint32_t scene_base[2];
};

/* A kernel that may run in place of the first one, over the same bindings. */
struct tracer_device_choice {
    struct gpu_kernel kernel;
    uint32_t most_groups; /* 0: a thread a ray; else so many workgroups at most, among which it hands the rays out */
    bool is_whole; /* `after` does not have to run */
};

struct tracer_device {
    struct tracer tracer; /* its first member */
    struct gpu *gpu;
    struct memory *memory;
    struct gpu_kernel kernel;
    struct tracer_device_choice choices[TRACER_CHOICES];
    uint32_t choice_count;
    /* Which of the choices runs over all rays of a call, -1: the first kernel. NULL: always that one. */
    int (*choose)(const struct tracer_device *self, const struct ray *rays, uint64_t count);
    struct gpu_kernel after; /* runs after a choice that is not whole */
    /* runs after both where the second word of the work buffer, of rays that they have left, is not 0 */
    struct gpu_kernel rest;
    uint32_t work_binding,
        /* of choices: a buffer with so many bytes for each ray, after 16 that are 0 before they run; 0: none */
        work_each;
    struct gpu_timer timer;
    struct tracer_push push;
    const struct gpu_buffer *buffers[TRACER_BINDINGS]; /* from binding 2 on, kept by the kind of tracer */
    const VkAccelerationStructureKHR *structures;
    struct gpu_buffer upload, rays, hits, work, readback; /* the last one has the head of work after the hits */
    uint32_t capacity; /* of these, in rays */
    void (*release)(struct tracer_device *self); /* what the kind of tracer holds besides; may be NULL */
};

/*
 * Fills *self with a kernel and a timer: then the caller sets push, buffers, structures and release, and hands out
 * &self->tracer. Constant 0 of `options` is TRACER_GROUP; the size of push constants is not looked at. `self` comes
 * from `memory`. On failure nothing is held, but `self` is the caller's to free.
 */
enum bvhd_status tracer_device_init(struct tracer_device *self, struct gpu *gpu,
                                    const struct gpu_kernel_options *options, struct memory *memory,
                                    struct bvhd_error *error);

/* The kernels that choices need; constants and bindings are up to `options`. On failure it is as before. */
enum bvhd_status tracer_device_add_after(struct tracer_device *self, const struct gpu_kernel_options *options,
                                         struct bvhd_error *error);
enum bvhd_status tracer_device_add_rest(struct tracer_device *self, const struct gpu_kernel_options *options,
                                        struct bvhd_error *error);
/* Adds a choice. */
enum bvhd_status tracer_device_add(struct tracer_device *self, const struct gpu_kernel_options *options,
                                   uint32_t most_groups, struct bvhd_error *error);

/* The end of all of them: calls release, and frees `self`. */
void tracer_device_destroy(struct tracer_device *self);

#endif

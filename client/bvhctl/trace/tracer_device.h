/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer_device.h - what tracers on a Vulkan device have in common: rays are copied to the device in portions, kernels
 * run over them, and hits are copied back. Rays and hits are struct bvhd_ray and struct bvhd_hit there.
 */
#ifndef BVHCTL_TRACER_DEVICE_H
#define BVHCTL_TRACER_DEVICE_H

#include <bvhd/bvhd_trace.h>

#include "client/bvhctl/trace/tracer.h"

enum {
    TRACER_PORTION = 1 << 22, /* most rays of a dispatch, where buffers may be as large as theirs */
    TRACER_GROUP = 64, /* rays of a dispatch come in multiples of this but for the last ones */
};

struct tracer_device;

/* The functions that one kind of tracer provides. */
struct tracer_device_kind {
    /* Binds self->rays and self->hits, which have just been created for `count` rays. */
    enum bvhd_status (*bind)(struct tracer_device *self, uint32_t count, struct bvhd_error *error);
    /* Undoes bind, before the buffers are destroyed; also when nothing is bound. */
    void (*unbind)(struct tracer_device *self);
    /* Inspects all rays of a call before the first portion; may be NULL. */
    void (*prepare)(struct tracer_device *self, const struct ray *rays, uint64_t count);
    /* Records the kernels over the first `count` rays of the buffer. */
    enum bvhd_status (*record)(struct tracer_device *self, VkCommandBuffer commands, uint32_t count,
                               struct bvhd_error *error);
    /* Frees everything else that this kind of tracer holds. */
    void (*release)(struct tracer_device *self);
};

struct tracer_device {
    struct tracer tracer; /* its first member */
    const struct tracer_device_kind *kind;
    struct gpu *gpu;
    struct memory *memory;
    struct gpu_timer timer;
    struct gpu_buffer upload, rays, hits, readback;
    uint32_t capacity; /* of these, in rays */
};

/*
 * Fills *self, which comes from `memory`; the caller hands out &self->tracer. End with tracer_device_destroy, also
 * after a failure.
 */
enum bvhd_status tracer_device_init(struct tracer_device *self, const struct tracer_device_kind *kind, struct gpu *gpu,
                                    struct memory *memory, struct bvhd_error *error);

/* Calls unbind and release, and frees `self`. NULL-safe. */
void tracer_device_destroy(struct tracer_device *self);

#endif

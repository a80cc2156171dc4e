/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer.h - rays by the thousand through the structures of a directory: on the CPU, by the compute traversal, or by a
 * driver's own ray queries.
 */
#ifndef BVHCTL_TRACER_H
#define BVHCTL_TRACER_H

#include "client/bvhctl/gpu/gpu.h"
#include "proto/base/parallel.h"
#include "client/bvhctl/scene/structures.h"

/* The hit of a ray, in the form that every kind of tracer can give; 32 bytes, as kernels write it. */
struct tracer_hit {
    float t; /* INFINITY: nothing */
    float u, v;
    uint32_t instance; /* RAY_NO_INSTANCE without a top level, or without a hit */
    uint32_t custom_index;
    uint32_t geometry, primitive;
    uint32_t flags; /* TRACER_ */
};

enum { TRACER_FRONT_FACE = 1, TRACER_AABB = 2, TRACER_SPHERE = 4, TRACER_SWEPT_SPHERE = 8 };

/* The answer for a ray that meets nothing: all other fields are 0. */
extern const struct tracer_hit tracer_miss;

/* Converts a hit of the CPU's traversal to this form. */
struct tracer_hit tracer_hit_of(const struct ray_hit *hit);

struct tracer {
    const char *device; /* "cpu", or the device's name */
    enum target target; /* of the structures; 0 where nobody knows */
    /*
     * Traces rays[0 .. count), any number of them. Triangles are accepted; what ret_hits says of AABBs is up to the
     * kind of tracer. *ret_seconds: what the device spent on tracing alone, copies not counted; may be NULL. One call
     * at a time.
     */
    enum bvhd_status (*trace)(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error);
    void (*destroy)(struct tracer *tracer);
};

/* NULL-safe. */
void tracer_destroy(struct tracer *tracer);

/* On the CPU: whatever target the structures have. They, and `parallel`, must outlive it. */
enum bvhd_status tracer_cpu_create(const struct structures *structures, const struct parallel *parallel,
                                   struct memory *memory, struct tracer **ret_tracer, struct bvhd_error *error);

/* By compute shaders: portable structures on any device. */
enum bvhd_status tracer_portable_create(struct gpu *gpu, const struct structures *structures, struct memory *memory,
                                        struct tracer **ret_tracer, struct bvhd_error *error);

/*
 * By ray queries: structures of the device's native target. BVHD_INCOMPATIBLE when they are of another one, with which
 * one it would need.
 */
enum bvhd_status tracer_native_create(struct gpu *gpu, const struct structures *structures, struct memory *memory,
                                      struct tracer **ret_tracer, struct bvhd_error *error);

/*
 * Traces through any top-level structure of the device, for instance one that the driver built, without reading files.
 * `top` must outlive the tracer. Rays do not hit AABBs, because a ray query does not report where they are. Returns
 * BVHD_UNSUPPORTED on a device without VK_KHR_ray_query.
 */
enum bvhd_status tracer_query_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error);

#endif

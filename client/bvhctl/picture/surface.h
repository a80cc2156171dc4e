/* SPDX-License-Identifier: Apache-2.0 */
/*
 * surface.h - what lies at a place that a tracer reports: the triangle's corners in the world, found by instance,
 * geometry and primitive on the host.
 *
 * Hits are hostile: a device may have computed anything.
 */
#ifndef BVHCTL_SURFACE_H
#define BVHCTL_SURFACE_H

#include "client/bvhctl/picture/stage.h"
#include "client/bvhctl/trace/tracer.h"

/* Where to look triangles up. Four bytes a primitive and an instance. */
struct surfaces {
    const struct structures *structures;
    uint32_t **triangle_rows; /* of each distinct bottom level, by flat primitive: a row of structure_triangle */
    uint32_t *owners; /* of each bottom level: the first row that has the same bytes */
    uint32_t *instance_rows; /* by position in the request: a row of structure_instance */
    uint32_t instance_count;
    struct memory *memory;
};

/* The structures must outlive it. BVHD_NO_MEMORY. End with surfaces_finish. */
enum bvhd_status surfaces_init(struct surfaces *surfaces, const struct structures *structures, struct memory *memory,
                               struct bvhd_error *error);
/* NULL-safe, idempotent. */
void surfaces_finish(struct surfaces *surfaces);

/* A triangle of an instance. */
struct surface {
    uint32_t bottom; /* row of its bottom level */
    struct vector corners[3]; /* in the world */
    struct vector shift; /* what the instance's transform moves its origin by; 0 without a top level */
};

/* false: there is no such triangle. Not for AABBs. Any thread. */
bool surfaces_find(const struct surfaces *surfaces, const struct tracer_hit *hit, struct surface *ret_surface);

/* Unit length, either side. 0 for a triangle without area. */
struct vector surface_normal(const struct surface *surface);

/* What a ray of stage_ray has met. false: nothing, or nothing that exists. */
bool surfaces_meet(const struct surfaces *surfaces, const struct ray *ray, const struct tracer_hit *hit,
                   struct stage_hit *ret_hit);

#endif

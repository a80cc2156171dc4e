/* SPDX-License-Identifier: Apache-2.0 */
/*
 * surface.h - finds the triangle that a tracer reports, on the host: its corners in world space, by the numbers of
 * instance, geometry and primitive.
 *
 * Hits are hostile, because a device may have computed anything.
 */
#ifndef BVHCTL_SURFACE_H
#define BVHCTL_SURFACE_H

#include "client/bvhctl/picture/stage.h"
#include "client/bvhctl/trace/tracer.h"

/* Tables to find primitives by number. They take four bytes for each primitive and each instance. */
struct surfaces {
    const struct structures *structures;
    /* of each bottom level that is the owner of its bytes, by flat primitive number: its row */
    uint32_t **primitive_rows;
    uint32_t *owners; /* of each bottom level: the first bottom level that has the same bytes */
    uint32_t *instance_rows; /* by position in the request: a row of structure_instance */
    uint32_t instance_count;
    struct memory *memory;
};

/* The structures must outlive the tables. BVHD_NO_MEMORY. End with surfaces_finish. */
enum bvhd_status surfaces_init(struct surfaces *surfaces, const struct structures *structures, struct memory *memory,
                               struct bvhd_error *error);
/* NULL-safe, idempotent. */
void surfaces_finish(struct surfaces *surfaces);

/* A triangle of an instance at the time of a ray, or a part of the tangent plane of a round primitive. */
struct surface {
    uint32_t bottom; /* row of its bottom level */
    struct vector corners[3]; /* in world space; of a round primitive, the first one is where it was hit */
    float object_to_world[12]; /* the instance's transform then, row-major 3x4; unset without a top level */
    struct vector shift; /* its translation; 0 without a top level */
};

/* Finds the surface that a ray hit. Returns false if there is no such primitive. Not for hits of AABBs. Any thread. */
bool surfaces_find(const struct surfaces *surfaces, const struct ray *ray, const struct tracer_hit *hit,
                   struct surface *ret_surface);

/* Returns a unit normal, of either side, and outward of a round primitive; 0 for a triangle without area. */
struct vector surface_normal(const struct surface *surface);

/* Converts a hit of a ray of stage_ray. Returns false for a miss, and if there is no such primitive. Any thread. */
bool surfaces_meet(const struct surfaces *surfaces, const struct ray *ray, const struct tracer_hit *hit,
                   struct stage_hit *ret_hit);

#endif

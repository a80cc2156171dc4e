/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stage.h - a scene set up to be pictured: which way is up, where its bulk stands, what a ray sees.
 *
 * The bulk is a box around nearly all triangles, so that a far triangle or an endless ground does not make the rest
 * invisible.
 */
#ifndef BVHCTL_STAGE_H
#define BVHCTL_STAGE_H

#include "client/bvhctl/scene/structures.h"
#include "client/bvhctl/picture/vector.h"

enum { STAGE_EVEN_SAMPLES = 8192, STAGE_SAMPLES = 12288 };

struct stage {
    const struct structures *structures;
    struct structure_instance *instances; /* those in the top level, by position in the request */
    uint32_t instance_count;
    uint64_t triangle_count; /* of all instances */
    struct vector up, east, north; /* right-handed: east x north = up; north and east are other axes of the scene */
    /* points on triangles: first so many with each triangle as likely as any other, then more by area */
    struct vector *samples;
    uint32_t even_count, sample_count;
    struct vector low, high; /* the bulk, along east, north and up */
    double size; /* diagonal of the bulk; > 0 */
    double floor; /* height of the floor under the bulk */
    struct memory *memory;
};

/*
 * `up`: 'x', 'y', 'z', or 'a' for a guess. Fails on a scene without a triangle that could be seen. End with
 * stage_finish.
 */
enum bvhd_status stage_init(struct stage *stage, const struct structures *structures, char up, struct memory *memory,
                            struct bvhd_error *error);
/* NULL-safe, idempotent. */
void stage_finish(struct stage *stage);

/* What a ray met. */
struct stage_hit {
    struct vector position, normal; /* the normal is a unit vector towards the ray's origin */
    double distance;
    uint32_t instance, handle, geometry; /* instance 0 without a top level */
};

/* Direction of unit length. true and *ret_hit on a hit. Thread-safe. */
bool stage_look(const struct stage *stage, struct vector origin, struct vector direction, struct stage_hit *ret_hit);

/* The distance to anything in the way, INFINITY for nothing. */
double stage_clearance(const struct stage *stage, struct vector origin, struct vector direction);

/* Triangle tests a ray, on average over some rays between points of the stage. */
double stage_cost(const struct stage *stage);

/* A point just above the surface that was hit, from which rays may start. */
struct vector stage_leave(const struct stage *stage, const struct stage_hit *hit);

/* The ray as traversal takes it. */
struct ray stage_ray(struct vector origin, struct vector direction);

/* Coordinates of a point along east, north and up, and back. */
struct vector stage_to_local(const struct stage *stage, struct vector point);
struct vector stage_to_world(const struct stage *stage, struct vector local);

#endif

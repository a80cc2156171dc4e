/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stage.h - prepares a scene for a picture: which direction is up, which box encloses most of it, what a ray hits, and
 * when.
 *
 * That box, the bulk, encloses nearly all triangles but not all of them, so that a far triangle or an endless ground
 * does not make the others too small to see (stage_bulk.h).
 */
#ifndef BVHCTL_STAGE_H
#define BVHCTL_STAGE_H

#include "client/bvhctl/scene/structures.h"
#include "client/bvhctl/picture/vector.h"

enum { STAGE_EVEN_SAMPLES = 8192, STAGE_SAMPLES = 12288 };

/* A random point of a primitive of the scene. For a round one a triangle stands in (round_surface.h). */
struct stage_sample {
    struct vector at;
    struct vector corners[3]; /* of its triangle */
    double reach; /* the longest side of its triangle */
    float time; /* when it is there */
    bool is_subject; /* it belongs to what the picture is about: it is in the bulk, and not on an endless ground */
};

/*
 * When the rays of a picture meet what moves: at times from the first to the last, which are in 0 .. 1. They are those
 * of rays (struct ray): where something moves, a picture of several times is blurred.
 */
struct stage_times {
    float first, last;
};

struct stage {
    const struct structures *structures;
    struct stage_times times;
    bool is_blurred; /* some structure moves, and the times differ */
    struct structure_instance *instances; /* of the top level, sorted by their positions in the request */
    uint32_t instance_count;
    uint64_t primitive_count; /* triangles, spheres and linear swept spheres of all instances */
    struct vector up, east, north; /* axes of the scene, right-handed: east x north = up */
    /*
     * The horizontal direction from which one looks at the front of most models: +z where y is up, as glTF says, and
     * -y where z is up, as in most programs that have it so
     */
    struct vector front;
    /*
     * in samples[0 .. even_count) every triangle is equally probable, in the others its probability is in proportion to
     * its area
     */
    struct stage_sample *samples;
    uint32_t even_count, sample_count;
    struct vector low, high; /* the bulk, along east, north and up */
    double size; /* diagonal of the bulk; > 0 */
    double floor; /* height of the floor under the bulk */
    struct memory *memory;
};

/*
 * Prepares a scene. `up` is 'x', 'y', 'z', or 'a' for a guess. It is an error if no primitive of the scene can be seen.
 * The structures must outlive the stage. End with stage_finish.
 */
enum bvhd_status stage_init(struct stage *stage, const struct structures *structures, char up, struct stage_times times,
                            struct memory *memory, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void stage_finish(struct stage *stage);

/* Returns the time of the picture that lies at a fraction, 0 to 1, between the first and the last. */
float stage_time(const struct stage *stage, double fraction);

/* The point that a ray hit. */
struct stage_hit {
    struct vector position, normal; /* the normal is a unit vector towards the ray's origin */
    double distance;
    bool is_back; /* the corners of the triangle are in clockwise order as seen from the ray's origin */
    uint32_t instance, handle, geometry; /* instance 0 without a top level */
    /* the rest is set by surfaces_meet only: */
    uint32_t primitive;
    double u, v; /* of the hit; of a triangle, position = (1-u-v) corners[0] + u corners[1] + v corners[2] */
    struct vector corners[3]; /* of the triangle, or of one in the tangent plane of a round primitive, in world space */
    float object_to_world[12]; /* of the instance at the time of the ray, row-major 3x4; unset without a top level */
    bool is_box; /* it is an AABB */
};

/*
 * Traces a ray on the CPU. `direction` is a unit vector. Returns true and fills in *ret_hit if it hits something. Any
 * thread.
 */
bool stage_look(const struct stage *stage, struct vector origin, struct vector direction, float time,
                struct stage_hit *ret_hit);

/* Returns the distance to the closest hit, INFINITY if there is none. Any thread. */
double stage_clearance(const struct stage *stage, struct vector origin, struct vector direction, float time);

/* Returns the mean number of primitives that a ray is tested against, over some rays between points of the stage. */
double stage_cost(const struct stage *stage);

/* Returns a point just above the surface that was hit, from which rays may start. */
struct vector stage_leave(const struct stage *stage, const struct stage_hit *hit);

/* Returns the ray in the form that traversal takes. */
struct ray stage_ray(struct vector origin, struct vector direction, float time);

/* Convert a point to coordinates along east, north and up, and back. */
struct vector stage_to_local(const struct stage *stage, struct vector point);
struct vector stage_to_world(const struct stage *stage, struct vector local);

#endif

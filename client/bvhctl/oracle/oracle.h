/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle.h - the reference that traversal is judged by: brute force over all primitives, in double precision.
 *
 * It uses no acceleration structure and shares no code with traverse.h. For every primitive that a ray might meet,
 * bounds say how far its shape and its t move when every input (vertex, radius, matrix and ray component) moves by one
 * float ulp. By them the primitive is surely hit, surely missed, or possibly hit. The answer for a ray is certain when
 * no possibly hit primitive could change it. Primitives whose t intervals overlap are tied, and any of them is right;
 * so are those whose t is the same to 32 significant bits, because then bvhd_cpu.h chooses by their numbers.
 */
#ifndef BVHD_ORACLE_H
#define BVHD_ORACLE_H

#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "builder/traverse/ray.h"
#include "proto/base/status.h"

enum oracle_shape { ORACLE_TRIANGLES, ORACLE_SPHERES, ORACLE_SWEPT_SPHERES, ORACLE_SHAPES };

/* How the transform of a mesh moves between the times 0 and 1. */
enum oracle_motion {
    ORACLE_STILL,
    ORACLE_MATRIX, /* each of the 12 numbers moves for itself */
    ORACLE_SRT, /* `transform` and `end_transform` are the 16 numbers of VkSRTDataNV, each of which moves for itself */
};

/* Which ends of a linear swept sphere have a cap. */
enum { ORACLE_CAP_FIRST = 1, ORACLE_CAP_SECOND = 2 };

/* The primitives of one geometry, with the transform of one instance of it. */
struct oracle_mesh {
    enum oracle_shape shape; /* of all its primitives */
    const float *positions; /* xyz: corners of triangles, centres of spheres */
    const float *end_positions; /* of triangles that move: at time 1, while `positions` is at time 0; else NULL */
    /*
     * three vertices a triangle, one a sphere, two a swept sphere; NULL: they follow each other, so that triangle i is
     * vertices 3i .. 3i+2
     */
    const uint32_t *indices;
    const float *radii; /* of round shapes: one a vertex */
    const uint8_t *caps; /* of swept spheres: ORACLE_CAP_ bits of each; NULL: all have both */
    uint32_t primitive_count;
    const float *transform; /* row-major 3x4, object to world; NULL: none */
    enum oracle_motion motion; /* of the transform */
    const float *end_transform; /* at time 1, while `transform` is at time 0; NULL: it stands still */
    uint32_t instance, geometry; /* as traversal reports them */
};

enum oracle_outcome { ORACLE_MISS, ORACLE_HIT, ORACLE_UNCERTAIN };

/* Primitives `primitive` .. `primitive + count - 1`: a run of identical primitives is listed as one. */
struct oracle_primitive_id {
    uint32_t instance, geometry, primitive;
    uint32_t count;
    double t; /* the same for all of them */
};

struct oracle_answer {
    enum oracle_outcome outcome;
    double t; /* of the closest sure hit */
    double t_low, t_high; /* the interval of that t while inputs move by one ulp */
    double t_end; /* ORACLE_HIT: the largest t of all tied primitives */
    uint32_t tied_count;
    struct oracle_primitive_id *tied; /* ORACLE_HIT: the tied primitives, the closest first; freed by oracle_finish */
};

enum oracle_verdict { ORACLE_RIGHT, ORACLE_UNDECIDED, ORACLE_WRONG_MISS, ORACLE_WRONG_HIT, ORACLE_WRONG_PRIMITIVE };

/*
 * Fills ret_answers[ray_count]; end with oracle_finish, except after a failure. Of the RAY_ flags, culling by facing is
 * honoured for triangles, in the mesh's own space, and the others are ignored; every primitive counts as opaque.
 * Primitives with a vertex or a radius that is not finite are never hit, nor are triangles with two equal corners and
 * round shapes whose radii are all 0. Thin triangles whose sides could change places within an ulp are never surely
 * hit. The answers are the same for any number of threads.
 *
 * Meshes that move are met as they are at the ray's time, which is in [0, 1]. Rays of one time should follow each
 * other, because all primitives are read again when the time changes. Transforms that are singular at a time hit
 * nothing then.
 *
 * progress(progress_context, done, total), which may be NULL, is called from any thread; it counts pairs of a ray and a
 * primitive.
 */
enum bvhd_status oracle_trace(const struct oracle_mesh *meshes, uint32_t mesh_count, const struct ray *rays,
                              uint32_t ray_count, struct memory *memory, const struct parallel *parallel,
                              void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                              struct oracle_answer *ret_answers, struct bvhd_error *error);
void oracle_finish(struct oracle_answer *answers, uint32_t ray_count, struct memory *memory);

/*
 * Judges an answer of traversal: `hit`, or NULL for a miss. The verdict WRONG_HIT means that there is nothing to hit,
 * or that the right primitive is reported at a t that it cannot have. When the verdict is ORACLE_RIGHT
 * for a hit, *ret_t_rel_err becomes |hit->t - t| / |t|, where t is what the oracle has computed for the same primitive;
 * otherwise it becomes 0. ret_t_rel_err may be NULL.
 */
enum oracle_verdict oracle_judge(const struct oracle_answer *answer, const struct ray_hit *hit, double *ret_t_rel_err);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle.h - the reference that traversal is judged by: brute force over all triangles, in double precision.
 *
 * It uses no acceleration structure and shares no code with traverse.h. For every triangle that a ray might meet,
 * bounds say how far its edge functions and its t move when every input (vertex, matrix and ray component) moves by one
 * float ulp. By them the triangle is surely hit, surely missed, or possibly hit. The answer for a ray is certain when
 * no possibly hit triangle could change it. Triangles whose t intervals overlap are tied, and any of them is right; so
 * are those whose t is the same to 32 significant bits, because then bvhd_cpu.h chooses by their numbers.
 */
#ifndef BVHD_ORACLE_H
#define BVHD_ORACLE_H

#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "builder/traverse/ray.h"
#include "proto/base/status.h"

/* The triangles of one geometry, with the transform of one instance of it. */
struct oracle_mesh {
    const float *positions; /* xyz */
    const uint32_t *indices; /* three a triangle; NULL: triangle i is vertices 3i .. 3i+2 */
    uint32_t triangle_count;
    const float *transform; /* row-major 3x4, object to world; NULL: none */
    uint32_t instance, geometry; /* as traversal reports them */
};

enum oracle_outcome { ORACLE_MISS, ORACLE_HIT, ORACLE_UNCERTAIN };

/* Primitives `primitive` .. `primitive + count - 1`: a run of identical triangles is listed as one. */
struct oracle_triangle_id {
    uint32_t instance, geometry, primitive;
    uint32_t count;
    double t; /* the same for all of them */
};

struct oracle_answer {
    enum oracle_outcome outcome;
    double t; /* of the closest sure hit */
    double t_low, t_high; /* the interval of that t while inputs move by one ulp */
    double t_end; /* ORACLE_HIT: the largest t of all tied triangles */
    uint32_t tied_count;
    struct oracle_triangle_id *tied; /* ORACLE_HIT: the tied triangles, the closest first; freed by oracle_finish */
};

enum oracle_verdict { ORACLE_RIGHT, ORACLE_UNDECIDED, ORACLE_WRONG_MISS, ORACLE_WRONG_HIT, ORACLE_WRONG_PRIMITIVE };

/*
 * Fills ret_answers[ray_count]; end with oracle_finish, except after a failure. Of the RAY_ flags, culling by facing is
 * honoured, in the mesh's own space, and the others are ignored; every triangle counts as opaque. Triangles with a
 * corner that is not finite, or with two equal corners, are never hit. Thin triangles whose sides could change places
 * within an ulp are never surely hit. The answers are the same for any number of threads.
 *
 * progress(progress_context, done, total), which may be NULL, is called from any thread; it counts pairs of a ray and a
 * triangle.
 */
enum bvhd_status oracle_trace(const struct oracle_mesh *meshes, uint32_t mesh_count, const struct ray *rays,
                              uint32_t ray_count, struct memory *memory, const struct parallel *parallel,
                              void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                              struct oracle_answer *ret_answers, struct bvhd_error *error);
void oracle_finish(struct oracle_answer *answers, uint32_t ray_count, struct memory *memory);

/*
 * Judges an answer of traversal: `hit`, or NULL for a miss. The verdict WRONG_HIT means that there is nothing to hit,
 * or that the right triangle is reported at a t that it cannot have. When the verdict is ORACLE_RIGHT
 * for a hit, *ret_t_rel_err becomes |hit->t - t| / |t|, where t is what the oracle has computed for the same triangle;
 * otherwise it becomes 0. ret_t_rel_err may be NULL.
 */
enum oracle_verdict oracle_judge(const struct oracle_answer *answer, const struct ray_hit *hit, double *ret_t_rel_err);

#endif

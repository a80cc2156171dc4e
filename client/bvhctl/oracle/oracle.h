/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle.h - the reference that traversal is judged by: brute force over all triangles, in double precision.
 *
 * No acceleration structure, no code shared with traverse.h. For every triangle that a ray might meet, bounds say how
 * far its edge functions and its t move when every input (vertex, matrix and ray component) moves by one float ulp: it
 * is surely hit, surely missed, or may be hit. A ray is certain when no triangle that may be hit could change its
 * answer; triangles whose t intervals overlap are tied, and any of them is right.
 */
#ifndef BVHD_ORACLE_H
#define BVHD_ORACLE_H

#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "builder/traverse/traverse.h"

/* Triangles as imported, with the transform of one instance of them. */
struct oracle_mesh {
    const float *positions; /* xyz */
    const uint32_t *indices; /* three a triangle; NULL: triangle i is vertices 3i .. 3i+2 */
    uint32_t triangle_count;
    const float *transform; /* row-major 3x4, object to world; NULL: none */
    uint32_t instance, geometry; /* as traversal reports them */
};

enum oracle_kind { ORACLE_MISS, ORACLE_HIT, ORACLE_UNCERTAIN };

/* Primitives `primitive` .. `primitive + count - 1`: identical triangles that follow each other are told once. */
struct oracle_triangle_id {
    uint32_t instance, geometry, primitive;
    uint32_t count;
    double t; /* of a tied one */
};

struct oracle_answer {
    enum oracle_kind kind;
    double t; /* of the closest sure hit */
    double t_low, t_high; /* its interval over one-ulp moves */
    double t_end; /* ORACLE_HIT: the largest t that may be reported, of all tied ones */
    uint32_t tied_count; /* ORACLE_HIT: the triangles that may be reported, the closest first */
    struct oracle_triangle_id *tied; /* owned by the answers; freed by oracle_finish */
};

enum oracle_verdict { ORACLE_RIGHT, ORACLE_UNDECIDED, ORACLE_WRONG_MISS, ORACLE_WRONG_HIT, ORACLE_WRONG_PRIMITIVE };

/*
 * Fills ret_answers[ray_count]; end with oracle_finish. On failure nothing is held. RAY_ flags but culling by facing,
 * which is honoured (in the mesh's own space), are ignored; every triangle counts as opaque. Triangles with a corner
 * that is not finite, or with two equal corners, are never hit; thin ones whose sides an ulp could swap are hit at most
 * possibly. The same answers for any number of threads.
 *
 * progress(context, done, total) may be NULL; called from any thread, in pairs of ray and triangle.
 */
enum bvhd_status oracle_trace(const struct oracle_mesh *meshes, uint32_t mesh_count, const struct ray *rays,
                              uint32_t ray_count, struct memory *memory, const struct parallel *parallel,
                              void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                              struct oracle_answer *ret_answers, struct bvhd_error *error);
void oracle_finish(struct oracle_answer *answers, uint32_t ray_count, struct memory *memory);

/*
 * `hit` NULL: the traversal missed. WRONG_HIT: there is nothing to be hit, or the right triangle is reported at a t
 * that it cannot have. *ret_t_rel_err (may be NULL): |t - own t| / |own t| of the triangle that is hit, when right;
 * else 0.
 */
enum oracle_verdict oracle_judge(const struct oracle_answer *answer, const struct ray_hit *hit, double *ret_t_rel_err);

#endif

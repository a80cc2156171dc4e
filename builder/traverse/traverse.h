/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse.h - traces rays through portable structures on the CPU. It is the reference for shaders, and `bvhctl check`
 * and `trace` use it.
 *
 * The semantics are Vulkan's (Vulkan specification, Ray Traversal). Triangles, spheres and linear swept spheres are hit
 * for tmin < t < tmax, round ones where the ray enters them from outside; AABB candidates are reported if the ray meets
 * them in the closed interval. Boxes are tested conservatively (boxtest.h), in
 * float, or in double for rays or structures with magnitudes outside 2^-60 .. 2^60. Triangles are decided in double
 * with exact signs (triangle.h), which is watertight: no ray slips between triangles that share an edge or a vertex,
 * and none hits twice there. Spheres and linear swept spheres are decided in double, or where that leaves signs open in
 * twice that precision (sphere.h, swept_sphere.h); their facing does not count.
 *
 * Answers do not depend on the order of visits: of hits with equal t, to 32 significant bits, the one with the lowest
 * (instance, geometry, primitive) wins. With TERMINATE_ON_FIRST_HIT only the existence of a hit is independent of the
 * order, not which hit it is. An instance's ray is transformed in double; t is the same in both spaces, and facing is
 * decided in object space.
 *
 * What moves is met as it is at the ray's time (motion.h): a triangle with its corners at that time, an instance with
 * its matrix. The time counts in each structure that moves, whatever the other level is.
 */
#ifndef BVHD_TRAVERSE_H
#define BVHD_TRAVERSE_H

#include "builder/format/portable.h"
#include "builder/traverse/ray.h"
#include "builder/traverse/unpacked.h"

/* A shorter way of plain rays through one unpacked structure (leaf_kind.h). */
struct traverse_state;
typedef bool (*traverse_plain)(struct traverse_state *state, const struct portable_view *view,
                               const struct unpacked_node *unpacked);

/*
 * The scene to trace: one bottom level, or a top level with one view for each of its handles (NULL: the instance counts
 * as inactive).
 */
struct scene {
    const struct portable_view *top; /* NULL: the scene is bottoms[0] alone */
    const struct portable_view *const *bottoms;
    uint32_t bottom_count;
    const uint32_t *rows; /* the row of bottoms for each handle of the top level; NULL: handle i is row i */
    /*
     * The nodes of each of the bottoms that is unpacked (unpacked.h), else NULL; NULL: none is. The triangles of those
     * bottoms are stored ones.
     */
    const struct unpacked_node *const *unpacked;
    const struct unpacked_node *unpacked_top; /* the nodes of the top level, or NULL */
    traverse_plain plain; /* set by traverse_settle(), for a shorter way of plain rays; may stay NULL */
};

/* The any-hit decision about a candidate: whether it counts, and whether the ray ends. */
enum candidate_verdict {
    CANDIDATE_IGNORE = 0,
    CANDIDATE_ACCEPT = 1,
    CANDIDATE_IGNORE_AND_END = 2,
    CANDIDATE_ACCEPT_AND_END = CANDIDATE_ACCEPT | CANDIDATE_IGNORE_AND_END,
};

/* Where a candidate is, for decisions that need more than the hit. It lives as long as the call. */
struct candidate_space {
    const double *origin, *direction; /* the ray in object space */
    const float *object_to_world; /* row-major 3x4, not aligned to more than a float; NULL if there is no TLAS */
    double tmax; /* the distance of the closest hit so far, or the end of the ray's interval */
    bool is_opaque; /* an AABB whose geometry, instance or ray is opaque */
};

/*
 * The any-hit callback: called for each triangle, sphere or linear swept sphere that is not opaque, and each AABB
 * candidate, that can still be the answer. For an AABB, hit->t holds the entry distance clamped to the ray's interval,
 * and the callback sets it if it accepts. Calls come in any order and, with split references, possibly more than once
 * for a primitive unless its geometry has NO_DUPLICATE_ANY_HIT.
 */
typedef enum candidate_verdict (*candidate_function)(void *context, const struct ray *ray,
                                                     const struct candidate_space *space, struct ray_hit *hit);

/* How to trace. All zero is the default. */
struct traverse_options {
    candidate_function candidate; /* NULL: all are accepted, AABBs at their entry distance */
    void *context;
    bool flip_order; /* visit children in the opposite order; the answers are the same */
    bool baseline_only; /* use no instructions beyond the baseline; the answers are the same */
    bool exact_only; /* test all boxes in double; the answers are the same */
};

/* The work that was done: `triangles` are tested primitives of any kind. Counts are added to, not reset. */
struct traverse_counters {
    uint64_t nodes, triangles, instances;
};

/*
 * Finds the closest hit (or any hit, with RAY_TERMINATE_ON_FIRST_HIT). Returns true and fills *ret_hit if there is one,
 * otherwise returns false and leaves *ret_hit as it was. `options` and `counters` may be NULL. May be called from any
 * thread.
 */
bool traverse(const struct scene *scene, const struct ray *ray, const struct traverse_options *options,
              struct ray_hit *ret_hit, struct traverse_counters *counters);

/*
 * Finds out whether there is a shorter way of plain rays through the scene, which has to be one unpacked structure
 * without a top level, on a machine with AVX2. Called once, when the other fields are set.
 */
void traverse_settle(struct scene *scene);

/*
 * Fetch the object-space corners of the triangle that was hit: exactly as stored; or those of a triangle that may move,
 * at the time of the ray. Not for other kinds.
 */
void traverse_positions(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);
void traverse_positions_at(const struct scene *scene, const struct ray_hit *hit, float time, float ret_corners[3][3]);

#endif

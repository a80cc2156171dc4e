/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_judge.h - compares the answers of a shader's ray queries with the CPU traversal, and where they differ, with
 * brute force in double. For test programs only.
 */
#ifndef BVHD_SHADER_JUDGE_H
#define BVHD_SHADER_JUDGE_H

#include "tests/support/shader/shader_meshes.h"
#include "tests/support/shader/shader_still.h"

struct shader_tally {
    uint64_t rays, hits; /* hits of the CPU */
    uint64_t differing; /* another primitive, or t, u or v differ by more than some last bits */
    uint64_t right; /* differing rays where both hits are right by the double reference, so they are ties */
    uint64_t uncertain; /* differing rays where the reference cannot decide */
    /* differing rays that hit an AABB where rounding can decide; the reference covers no AABBs */
    uint64_t boxes;
    uint64_t certain; /* all other differing rays: defects */
    uint64_t other_bits; /* the same primitive, but t is not equal in every bit */
};

/*
 * Judges the answers. rays[i].flags and cull_mask must be those of the case, and all rays must have the same time if
 * something moves. Adds to *tally, and prints the first defects of a call as "WHAT: ...".
 */
void shader_judge(const char *what, const struct scene *scene, const struct shader_case *shared, const struct ray *rays,
                  uint32_t count, const struct shader_answer *answers, const struct parallel *parallel,
                  struct memory *memory, struct shader_tally *tally);

/* The shader's answer as a hit of the CPU, and whether two hits are the same, up to some last bits of t, u and v. */
struct ray_hit shader_judge_hit(const struct shader_intersection *hit);
bool shader_judge_same(const struct ray *ray, const struct ray_hit *a, const struct ray_hit *b);

/* The CPU's candidate function. It accepts by the policy that context (enum shader_policy *) points to. */
enum candidate_verdict shader_judge_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                              struct ray_hit *hit);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_candidates.h - judges what ray queries of a shader report beside the hit: candidates, and details of a hit.
 * For test programs only.
 */
#ifndef BVHD_SHADER_CANDIDATES_H
#define BVHD_SHADER_CANDIDATES_H

#include "tests/support/shader/shader_judge.h"

struct shader_candidate_tally {
    uint64_t rays, candidates; /* rays with more candidates than there is room for are left out */
    uint64_t differing; /* candidates of one side that the other does not have */
    uint64_t defects;
};

/*
 * Judges rays for which nothing is opaque, with SHADER_IGNORE: every required candidate is reported, no impossible one
 * is, and all their values are right. Where the CPU has other candidates, boxes are judged in extended precision, and
 * triangles by the double reference.
 */
void shader_candidates_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                             const struct shader_full_answer *answers, struct memory *memory,
                             struct shader_candidate_tally *tally);

/* Judges corners, the ray in object space, and matrices of hits that the CPU has too. Returns the number of defects. */
uint64_t shader_details_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                              const struct shader_full_answer *answers);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_candidates.h - what ray queries of a shader say beside the answer: candidates, and what is known of a hit. For
 * test programs only.
 */
#ifndef BVHD_SHADER_CANDIDATES_H
#define BVHD_SHADER_CANDIDATES_H

#include "tests/support/shader/shader_judge.h"

struct shader_candidate_tally {
    uint64_t rays, candidates; /* rays with more candidates than there is room for are left out */
    uint64_t differing; /* a candidate of one side that the other does not have */
    uint64_t defects;
};

/*
 * Of rays for which nothing is opaque, with SHADER_IGNORE: every candidate that there must be, none that there cannot
 * be, each told of rightly. Boxes are judged by extended precision, triangles by the double reference, where the CPU
 * has other candidates.
 */
void shader_candidates_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                             const struct shader_full_answer *answers, struct memory *memory,
                             struct shader_candidate_tally *tally);

/* Corners, the ray in object space and matrices of hits that the CPU has too. Returns the number of defects. */
uint64_t shader_details_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                              const struct shader_full_answer *answers);

#endif

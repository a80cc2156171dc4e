/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_judge.h - traces rays through what was built of random requests, and judges the answers: hits by brute force
 * over what the request means, candidates by the boxes that a ray meets. For test programs only.
 */
#ifndef BVHD_RANDOM_JUDGE_H
#define BVHD_RANDOM_JUDGE_H

#include "tests/support/builder/random_run.h"
#include "tests/support/builder/random_top.h"

/* Judges a scene of one bottom level. */
void random_judge_bottom(struct random_run *run, const struct random_input *bottom, const struct scene *scene,
                         struct random *random);

/* Judges a scene of a top level over bottom levels. */
void random_judge_top(struct random_run *run, struct random_top *top, const struct scene *scene, struct random *random);

#endif

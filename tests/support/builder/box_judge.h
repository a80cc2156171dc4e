/* SPDX-License-Identifier: Apache-2.0 */
/*
 * box_judge.h - judges which boxes a traversal names as candidates of a ray: each box that is certainly met must be
 * one, and no box that is clearly missed. For test programs only.
 */
#ifndef BVHD_BOX_JUDGE_H
#define BVHD_BOX_JUDGE_H

#include "tests/support/builder/candidates.h"

struct box_judge {
    const struct ray *world;
    struct long_ray local;
    long double slack; /* the relative error that the transformation into an instance's space can add */
    double origin[3], inverse[3]; /* of the local ray, to dismiss most boxes by */
};

/* Prepares for boxes of a bottom level, or of an instance with this row-major 3x4 matrix. The ray must live on. */
void box_judge_init(struct box_judge *ret_judge, const struct ray *world, const float *matrix);

/* Returns what is wrong with a box that was a candidate, or was not; NULL if nothing is. */
const char *box_judge_find(const struct box_judge *judge, const float box[6], bool seen);

/*
 * Returns whether the ray at t is where coordinates exceed the range of floats, so that there are no boxes. An instance
 * can move primitives there.
 */
bool box_judge_is_beyond_floats(const struct ray *ray, long double t);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * level_choice.h - chooses levels for triangles by how much more they decide for their bytes.
 *
 * A triangle at level 0 takes no bytes: a special index says all of it. At other levels it takes those of its states
 * and of its entry in the micromap; that equal states are stored once is not known yet. A step from a level to a
 * higher one decides further parts of the triangle and takes further bytes; its worth is the one divided by the other,
 * times the weight of the triangle. From its level each triangle takes the step of the greatest worth, of equal ones
 * the longest, then again from there, so that the worth of its steps falls. Steps of all triangles are taken in the
 * order of falling worth, those of equal worth in the order of triangles, until one is worth less than it has to be,
 * or would exceed the budget. (That is the greedy answer to a knapsack problem, which is as good as the best but for
 * one step.)
 */
#ifndef BVHD_LEVEL_CHOICE_H
#define BVHD_LEVEL_CHOICE_H

#include "builder/context.h"
#include "builder/format/micro_triangle.h"
#include "proto/base/status.h"

/* What is known of a triangle. */
struct level_facts {
    uint32_t decided[MICRO_LEVEL_MAX + 1]; /* parts of MICRO_COUNT_MAX that each level decides; they do not fall */
    double weight; /* how often the triangle counts; at least 0 */
};

/* What a step has to be worth, in triangles a byte, and the bytes of all levels together. */
struct level_limits {
    enum micro_format format;
    unsigned last; /* the highest level allowed */
    double worth;
    uint64_t budget;
};

/* Chooses ret_levels[i] for each of `count` triangles. Fails with BVHD_NO_MEMORY or BVHD_CANCELLED. */
enum bvhd_status level_choice_make(const struct level_facts *facts, size_t count, const struct level_limits *limits,
                                   const struct build_context *context, unsigned char *ret_levels,
                                   struct bvhd_error *error);

#endif

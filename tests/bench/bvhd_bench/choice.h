/* SPDX-License-Identifier: Apache-2.0 */
/*
 * choice.h - decides whether the tier that the quality auto chooses is as good as the best one. The cost of a tier is
 * the time of its build plus the time of the rays through the result. A hint is an expected number of rays for each
 * primitive.
 */
#ifndef BVHD_BENCH_CHOICE_H
#define BVHD_BENCH_CHOICE_H

#include "tests/bench/bvhd_bench/summary.h"

enum { CHOICE_HINTS = 4 };

/* For hint 0 .. CHOICE_HINTS - 1: the rays for each primitive, and the name of the method that is given this hint. */
double choice_rays(int hint);
const char *choice_method(int hint);

struct choice {
    const char *best; /* the tier that costs least */
    const char *chosen; /* the tier that auto takes */
    double best_ms, auto_ms; /* build on one thread plus diffuse rays on one thread */
    double spread_ms; /* three median absolute deviations of both together */
    bool is_good; /* auto costs at most 10 %, or the spread, more than the best tier */
};

/* For one scene and the portable target. Returns false when something needed was not measured. */
bool choice_of(const struct results *results, uint32_t scene, int hint, struct choice *ret_choice);

#endif

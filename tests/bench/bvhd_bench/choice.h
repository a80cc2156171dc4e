/* SPDX-License-Identifier: Apache-2.0 */
/*
 * choice.h - whether auto is as good a choice as the best tier, when a build and the rays through it are paid together.
 */
#ifndef BVHD_BENCH_CHOICE_H
#define BVHD_BENCH_CHOICE_H

#include "tests/bench/bvhd_bench/summary.h"

enum { CHOICE_HINTS = 4 };

/* Rays a primitive, and the method that is told so. */
double choice_rays(int hint);
const char *choice_method(int hint);

struct choice {
    const char *best; /* the tier that costs least */
    const char *chosen; /* the tier that auto takes */
    double best_ms, auto_ms; /* building on one thread, and diffuse rays on one */
    double spread_ms; /* three median absolute deviations of both together */
    bool is_good; /* auto costs at most 10 % or the spread more */
};

/* Of one scene, portable target. False when something was not measured. */
bool choice_of(const struct results *results, uint32_t scene, int hint, struct choice *ret_choice);

#endif

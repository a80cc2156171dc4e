/* SPDX-License-Identifier: Apache-2.0 */
/* calibrate.h - fits the constants of the cost model in builder/tier.c to measurements. */
#ifndef BVHD_BENCH_CALIBRATE_H
#define BVHD_BENCH_CALIBRATE_H

#include "tests/bench/bvhd_bench/summary.h"

/*
 * Fits by least squares over the logarithms of the times on one thread, with a weak prior that every term but the
 * constant one is 0, so that few scenes cannot overfit. Prints to stdout:
 * - the table for tier.c;
 * - for each scene and number of rays: the tier that costs least, and what three tables choose and lose: this one, one
 *   that was fitted without scenes of the same kind (all scenes of one NAME of NAME@SEED@SIZE), which estimates the
 *   loss on scenes that nobody has measured, and the table in use;
 * - how often each of the three tables loses.
 * Returns false, with a line on stderr, when a tier was not measured on any scene.
 */
bool calibrate_print(const struct results *results);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* calibrate.h - the constants of tier.c, fitted to what was measured. */
#ifndef BVHD_BENCH_CALIBRATE_H
#define BVHD_BENCH_CALIBRATE_H

#include "tests/bench/bvhd_bench/summary.h"

/*
 * By least squares over the logarithms of one thread's times, held towards none of them where scenes are few. Prints
 * what tier.c's table should be; for each scene and number of rays what it chooses and loses, beside a table that was
 * fitted without scenes of that kind (NAME of NAME@SEED@SIZE), which tells what to expect of others, and the one in
 * use; and how often each loses. False, and a line on stderr, when a tier was not measured on any scene.
 */
bool calibrate_print(const struct results *results);

#endif

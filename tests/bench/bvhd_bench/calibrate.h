/* SPDX-License-Identifier: Apache-2.0 */
/* calibrate.h - the constants of tier.c, fitted to what was measured. */
#ifndef BVHD_BENCH_CALIBRATE_H
#define BVHD_BENCH_CALIBRATE_H

#include "summary.h"

/*
 * By least squares over the logarithms of one thread's times, held towards none of them where scenes are few. Prints what tier.c's table should be, and for each scene and
 * number of rays what both tables choose and lose. False, and a line on stderr, when a tier was not measured on any scene.
 */
bool calibrate_print(const struct results *results);

#endif

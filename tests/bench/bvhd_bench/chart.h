/* SPDX-License-Identifier: Apache-2.0 */
/*
 * chart.h - charts of what was measured, as SVG and PNG, by gnuplot.
 *
 * Colours are those of Okabe and Ito, which most colour-blind people tell apart; every family has a shape of its own,
 * too, and every point its name beside it. The scripts stay beside the pictures, with their data in them.
 */
#ifndef BVHD_BENCH_CHART_H
#define BVHD_BENCH_CHART_H

#include "tests/bench/bvhd_bench/stability.h"
#include "tests/bench/bvhd_bench/summary.h"

/*
 * Where there is no gnuplot they say so on stderr, and that is no failure. False, and a line on stderr, when a file
 * cannot be written.
 */
bool chart_results(const struct results *results, const char *directory);
/* Part of chart_results: our tiers, scene by scene. */
bool chart_scenes(const struct results *results, const char *directory);
bool chart_stability(const struct stability *stability, const char *directory);

#endif

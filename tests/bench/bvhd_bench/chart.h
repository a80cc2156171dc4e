/* SPDX-License-Identifier: Apache-2.0 */
/*
 * chart.h - draws charts of the results, as SVG and PNG, with gnuplot.
 *
 * The colours are those of Okabe and Ito, which most colour-blind people can tell apart; every family also has its own
 * shape, and every point has its name beside it. The gnuplot scripts, which contain their data, stay beside the
 * pictures.
 */
#ifndef BVHD_BENCH_CHART_H
#define BVHD_BENCH_CHART_H

#include "tests/bench/bvhd_bench/stability.h"
#include "tests/bench/bvhd_bench/summary.h"

/*
 * Without gnuplot these functions write a line to stderr and return true. They return false, with a line on stderr,
 * when a file cannot be written.
 */
bool chart_results(const struct results *results, const char *directory);
/* Draws our tiers scene by scene; chart_results calls it. */
bool chart_scenes(const struct results *results, const char *directory);
bool chart_stability(const struct stability *stability, const char *directory);

#endif

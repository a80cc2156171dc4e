/* SPDX-License-Identifier: Apache-2.0 */
/* report.h - what was measured, as JSON; README.md has the schema. */
#ifndef BVHD_BENCH_REPORT_H
#define BVHD_BENCH_REPORT_H

#include "tests/bench/bvhd_bench/stability.h"
#include "tests/bench/bvhd_bench/summary.h"

/* DIRECTORY/report.json. False, and a line on stderr. */
bool report_results(const struct results *results, const char *directory);

/* DIRECTORY/stability.json, and stability.md, a table for people. */
bool report_stability(const struct stability *stability, const struct stability_options *options,
                      const char *directory);

#endif

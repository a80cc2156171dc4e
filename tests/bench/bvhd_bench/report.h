/* SPDX-License-Identifier: Apache-2.0 */
/* report.h - writes the results as JSON; README.md has the schema. */
#ifndef BVHD_BENCH_REPORT_H
#define BVHD_BENCH_REPORT_H

#include "tests/bench/bvhd_bench/stability.h"
#include "tests/bench/bvhd_bench/summary.h"

/* Writes DIRECTORY/report.json. Returns false, with a line on stderr, on failure. */
bool report_results(const struct results *results, const char *directory);

/* Writes DIRECTORY/stability.json, and DIRECTORY/stability.md, which is a table for people. */
bool report_stability(const struct stability *stability, const struct stability_options *options,
                      const char *directory);

#endif

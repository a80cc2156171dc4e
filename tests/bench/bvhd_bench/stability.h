/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stability.h - maps which methods survive which scenes, and what they get wrong there. Each cell of the map is
 * measured in a separate process.
 */
#ifndef BVHD_BENCH_STABILITY_H
#define BVHD_BENCH_STABILITY_H

#include "tests/bench/bvhd_bench/cell.h"
#include "tests/bench/bvhd_bench/scene_source.h"

enum { STABILITY_ROWS = 32, STABILITY_COLUMNS = 64 };

struct stability_options {
    uint32_t size, rays; /* of each scene */
    uint64_t seed;
    double seconds; /* time limit of a cell */
    char **scenes; /* names of the generated scenes wanted; none: all hard ones */
    int scene_count;
};

struct stability {
    const struct method *rows[STABILITY_ROWS];
    uint32_t row_count;
    struct scene_source columns[STABILITY_COLUMNS];
    uint32_t column_count;
    struct cell_result cells[STABILITY_ROWS][STABILITY_COLUMNS];
};

/* Runs all cells. Returns false, with a line on stderr, when a process cannot be started. */
bool stability_run(const struct stability_options *options, struct stability *ret_stability);

/* Whether the cell has an answer and no wrong one. */
bool stability_is_clean(const struct cell_result *cell);

/* The cell's rays a second divided by those of the fastest clean method of the column; 0 when unknown. */
double stability_speed(const struct stability *stability, uint32_t row, uint32_t column);

/* The number of cells of our own methods that are not clean. */
uint32_t stability_own_failures(const struct stability *stability);

#endif

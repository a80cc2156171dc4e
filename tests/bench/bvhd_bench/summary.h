/* SPDX-License-Identifier: Apache-2.0 */
/* summary.h - geometric means over the scenes, and the floors that they have to meet. */
#ifndef BVHD_BENCH_SUMMARY_H
#define BVHD_BENCH_SUMMARY_H

#include "tests/bench/bvhd_bench/measure.h"

struct results {
    const struct measure_options *options;
    struct scene_figures *scenes; /* malloc */
    uint32_t scene_count;
};

/* The figures that have means. The figures of trees are relative to the full sweep's. */
enum figure {
    FIGURE_RATE_ALL, /* million triangles a second, all threads */
    FIGURE_RATE_ONE, /* one thread */
    FIGURE_SAH,
    FIGURE_WORK,
    FIGURE_OVERLAP,
    FIGURE_REFS, /* references per triangle */
    FIGURE_BYTES, /* bytes per triangle */
    FIGURE_PRIMARY, /* million rays a second */
    FIGURE_DIFFUSE,
    FIGURE_SHADOW,
    FIGURES
};

const char *figure_name(enum figure figure);
/* Returns false when the figure was not measured. */
bool figure_of(const struct results *results, uint32_t scene, uint32_t method, enum figure figure, double *ret_value);

struct mean {
    uint32_t count; /* number of scenes; 0: no mean */
    double value;
    double least, most;
    const char *least_scene, *most_scene;
};
/*
 * Returns the mean of a figure of one method, or of its ratio to the figure of `peer` (NULL: of the figure itself).
 * Methods that were not measured have no mean.
 */
struct mean mean_of(const struct results *results, const char *method, const char *peer, enum figure figure);

/* A bound that a mean has to meet: at least `floor`, or at most. */
struct floor {
    const char *method, *peer; /* peer NULL: bounds the figure itself */
    enum figure figure;
    bool at_least;
    double floor, aim; /* the bound; a better value that is wanted, but not required */
};
const struct floor *floor_all(uint32_t *ret_count);
bool floor_is_met(const struct floor *floor, const struct mean *mean);

#endif

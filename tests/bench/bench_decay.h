/* SPDX-License-Identifier: Apache-2.0 */
/* bench_decay.h - the figures of bench_decay, and the chart of them. */
#ifndef BVHD_BENCH_DECAY_H
#define BVHD_BENCH_DECAY_H

#include <stdbool.h>

#include "proto/base/geometry.h"

enum { DECAY_ANGLES = 14, DECAY_SCENES = 8, DECAY_KINDS = 2 };

/* The figures of one angle: of an updated tree, and of one that is built for the same pose. */
struct decay_row {
    double angle; /* degrees between the two ends of the mesh */
    double decay; /* as an update reports it: cost of the updated tree over that of its source */
    double cost, fresh_cost; /* of the updated tree and of the built one, by the surface area heuristic */
    double rate[DECAY_KINDS], fresh_rate[DECAY_KINDS]; /* million primary and diffuse rays a second of one thread */
    double update_ms, build_ms;
};

struct decay_scene {
    const char *name;
    unsigned triangles;
    struct decay_row rows[DECAY_ANGLES];
};

struct decay_results {
    enum build_quality quality;
    double from; /* degrees by which the source was twisted when it was built */
    int scene_count;
    struct decay_scene scenes[DECAY_SCENES];
};

/* The time of a diffuse ray through the updated tree, over that through the built one. */
double decay_slowdown(const struct decay_row *row);

/*
 * The number of rays a primitive, diffuse ones in one thread, beyond which a build costs less than it saves for them;
 * infinite where the built tree saves nothing.
 */
double decay_break_even(const struct decay_scene *scene, const struct decay_row *row);

/* Draws decay.svg and decay.png, and keeps the gnuplot script decay.gp. Returns false, with a line on stderr. */
bool decay_chart(const struct decay_results *results, const char *directory);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* measure.h - measures all methods on one scene, with interleaved repetitions. */
#ifndef BVHD_BENCH_MEASURE_H
#define BVHD_BENCH_MEASURE_H

#include "builder/facts.h"
#include "tests/bench/bvhd_bench/ray_sets.h"
#include "tests/bench/bvhd_bench/statistic.h"
#include "tests/bench/bvhd_bench/verdicts.h"

/* A crew is the set of threads that a build runs on. Crew 0 is all threads, crew 1 is a single thread. */
enum { MEASURE_METHODS = 32, MEASURE_STAGES = 8, MEASURE_CREWS = 2 };

struct measure_options {
    int runs; /* repetitions of builds and of rays, interleaved */
    /*
     * Once the builds of one method, scene and number of threads, or the rays of one kind, have taken this many
     * seconds, 3 repetitions are enough.
     */
    double patience;
    uint32_t picture; /* a picture has picture x picture primary rays */
    uint32_t size; /* triangles of a generated scene */
    uint32_t check_rays; /* rays compared with brute force; 0: none */
    uint64_t seed;
    unsigned threads; /* of crew 0 */
    bool calibrates; /* measures only builds on one thread, and rays */
    const struct method *methods[MEASURE_METHODS];
    uint32_t method_count;
};

/* The figures of one method on one scene. */
struct figures {
    const struct method *method;
    char failure[400]; /* empty: nothing failed */
    struct statistic ms[MEASURE_CREWS]; /* duration of a build, in milliseconds */
    struct statistic stages[MEASURE_CREWS][MEASURE_STAGES]; /* METHOD_OWN */
    struct build_stats stats; /* METHOD_OWN */
    uint64_t bytes, peak_resident, peak_bytes; /* see subject.h, cell.h */
    double sah, overlap, refs; /* of the method's tree; refs: references per primitive */
    uint32_t depth;
    struct tree_work work; /* diffuse rays in the neutral tracer */
    struct statistic mrays[RAY_KINDS]; /* million rays a second of one thread's processor time */
    struct traverse_counters counters; /* METHOD_OWN: diffuse rays through the blob */
    struct verdicts verdicts;
};

struct scene_figures {
    const char *name;
    uint32_t triangles, vertices;
    struct facts facts; /* the statistics by which auto chooses */
    uint32_t ray_counts[RAY_KINDS];
    struct figures methods[MEASURE_METHODS];
};

const char *measure_stage_name(int stage);

/*
 * Measures a file or a generated scene. Returns false, with a line on stderr, when the scene cannot be measured at all.
 */
bool measure_scene(const char *path, const struct measure_options *options, struct scene_figures *ret_figures);

/* Million triangles a second of crew 0 (all threads) or crew 1 (one thread); 0 where nothing was measured. */
double measure_rate(const struct scene_figures *scene, const struct figures *figures, int crew);

#endif

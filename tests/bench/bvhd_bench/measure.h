/* SPDX-License-Identifier: Apache-2.0 */
/* measure.h - all methods over one scene: interleaved, repeated. */
#ifndef BVHD_BENCH_MEASURE_H
#define BVHD_BENCH_MEASURE_H

#include "builder/facts.h"
#include "tests/bench/bvhd_bench/ray_sets.h"
#include "tests/bench/bvhd_bench/statistic.h"
#include "tests/bench/bvhd_bench/verdicts.h"

enum { MEASURE_METHODS = 32, MEASURE_STAGES = 8, MEASURE_CREWS = 2 };

struct measure_options {
    int runs; /* of builds and of rays, interleaved */
    /*
     * seconds of builds of one method, scene and number of threads, or of rays of one kind, after which 3 have to be
     * enough
     */
    double patience;
    uint32_t picture; /* rays of size x size */
    uint32_t size; /* triangles of a generated scene */
    uint32_t check_rays; /* against brute force; 0: none */
    uint64_t seed;
    unsigned threads; /* of the first crew; the second is one thread */
    bool calibrates; /* builds on one thread and rays, nothing else */
    const struct method *methods[MEASURE_METHODS];
    uint32_t method_count;
};

/* What one method did with one scene. */
struct figures {
    const struct method *method;
    char failure[400]; /* empty: all went well */
    struct statistic ms[MEASURE_CREWS]; /* of builds: by all threads, by one */
    struct statistic stages[MEASURE_CREWS][MEASURE_STAGES]; /* METHOD_OWN */
    struct build_stats stats; /* METHOD_OWN */
    uint64_t bytes, peak_resident, peak_bytes; /* subject.h, cell.h */
    double sah, overlap, refs; /* of its tree; refs: a primitive in it */
    uint32_t depth;
    struct tree_work work; /* diffuse rays in the neutral tracer */
    struct statistic mrays[RAY_KINDS]; /* million rays a second, one thread's processor time */
    struct traverse_counters counters; /* METHOD_OWN: diffuse rays through what it wrote */
    struct verdicts verdicts;
};

struct scene_figures {
    const char *name;
    uint32_t triangles, vertices;
    struct facts facts; /* by which auto chooses */
    uint32_t ray_counts[RAY_KINDS];
    struct figures methods[MEASURE_METHODS];
};

const char *measure_stage_name(int stage);

/* A file, or a generated scene. False, and a line on stderr, when it cannot be measured at all. */
bool measure_scene(const char *path, const struct measure_options *options, struct scene_figures *ret_figures);

/* Of the first (all threads) or second crew (one): million triangles a second; 0 where there is no measurement. */
double measure_rate(const struct scene_figures *scene, const struct figures *figures, int crew);

#endif

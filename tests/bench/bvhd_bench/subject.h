/* SPDX-License-Identifier: Apache-2.0 */
/* subject.h - one method's build over one mesh: times, sizes, a tree to look at, something to send rays through. */
#ifndef BVHD_BENCH_SUBJECT_H
#define BVHD_BENCH_SUBJECT_H

#include "builder/build.h"
#include "tests/bench/bvhd_bench/embree_scene.h"
#include "builder/facts.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "tests/bench/bvhd_bench/method.h"
#include "tests/bench/bvhd_bench/tree.h"
#include "builder/workers.h"

/* What builds run with. */
struct bench {
    struct memory memory;
    struct workers *workers;
    const struct parallel *parallel;
    unsigned threads;
};

/* False, and a line on stderr, when something does not start. */
bool bench_start(unsigned threads, struct bench *ret_bench);
void bench_stop(struct bench *bench);

struct subject {
    const struct method *method;
    double ms; /* METHOD_OWN: build(), from the canonical copy to the blob; Embree: its call alone */
    double prepare_ms; /* METHOD_OWN: before that, from the caller's bytes to the canonical copy */
    uint64_t bytes; /* all that is needed to trace it */
    uint64_t peak_bytes; /* METHOD_OWN: most memory taken on the way, blob included */
    struct build_stats stats; /* METHOD_OWN */
    struct facts facts; /* METHOD_OWN */
    struct tree tree; /* when wanted */
    /* What rays go through. */
    unsigned char *blob;
    struct portable_view portable;
    struct lavapipe_view lavapipe;
    struct embree_scene *scene;
    struct memory *memory;
    char failure[360]; /* empty: it was built */
};

struct subject_wants {
    bool tree, tracer;
};

/* Always to be ended, whatever became of it. False when `failure` says what went wrong. */
bool subject_build(struct bench *bench, const struct method *method, const struct ply *mesh, struct subject_wants wants,
                   struct subject *ret_subject);
void subject_finish(struct subject *subject);

/* As traverse(). `counters` only from METHOD_OWN. */
bool subject_trace(const struct subject *subject, const struct ray *ray, struct ray_hit *ret_hit,
                   struct traverse_counters *counters);

#endif

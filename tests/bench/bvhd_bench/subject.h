/* SPDX-License-Identifier: Apache-2.0 */
/*
 * subject.h - one method's build over one mesh: its times and sizes, a tree to inspect, and something to trace rays
 * through.
 */
#ifndef BVHD_BENCH_SUBJECT_H
#define BVHD_BENCH_SUBJECT_H

#include "builder/build.h"
#include "tests/bench/bvhd_bench/embree_scene.h"
#include "builder/facts.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "tests/bench/bvhd_bench/method.h"
#include "tests/bench/bvhd_bench/tree.h"
#include "builder/workers.h"

/* The resources that builds run with. */
struct bench {
    struct memory memory;
    struct workers *workers;
    const struct parallel *parallel;
    unsigned threads;
};

/* Returns false, with a line on stderr, when the workers do not start. */
bool bench_start(unsigned threads, struct bench *ret_bench);
void bench_stop(struct bench *bench);

struct subject {
    const struct method *method;
    double ms; /* METHOD_OWN: build(), from the canonical copy to the blob; Embree: its call alone */
    double prepare_ms; /* METHOD_OWN: before that, from the caller's bytes to the canonical copy */
    uint64_t bytes; /* all bytes that tracing needs */
    uint64_t peak_bytes; /* METHOD_OWN: peak of allocated memory during the build, blob included */
    struct build_stats stats; /* METHOD_OWN */
    struct facts facts; /* METHOD_OWN */
    struct tree tree; /* filled if wants.tree */
    /* The structures that rays are traced through; set if wants.tracer. */
    unsigned char *blob;
    struct portable_view portable;
    struct lavapipe_view lavapipe;
    struct embree_scene *scene;
    struct memory *memory;
    char failure[360]; /* empty: the build succeeded */
};

struct subject_wants {
    bool tree, tracer;
};

/* Builds. subject_finish has to be called also after a failure. Returns false when `failure` says what went wrong. */
bool subject_build(struct bench *bench, const struct method *method, const struct ply *mesh, struct subject_wants wants,
                   struct subject *ret_subject);
void subject_finish(struct subject *subject);

/* Works like traverse(). Only METHOD_OWN fills `counters`. */
bool subject_trace(const struct subject *subject, const struct ray *ray, struct ray_hit *ret_hit,
                   struct traverse_counters *counters);

#endif

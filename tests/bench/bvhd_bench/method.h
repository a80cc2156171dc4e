/* SPDX-License-Identifier: Apache-2.0 */
/* method.h - what is compared: our tiers by target, and what Embree offers. */
#ifndef BVHD_BENCH_METHOD_H
#define BVHD_BENCH_METHOD_H

#include <stdbool.h>

#include "proto/base/geometry.h"

enum method_kind {
    METHOD_OWN, /* a tier and a target */
    METHOD_BVH, /* rtcBuildBVH: a tree, nothing to trace it by */
    METHOD_SCENE, /* rtcCommitScene: something to trace, no tree to look at */
    METHOD_SWEEP, /* a full sweep, by which trees are measured */
};

enum method_effort { EFFORT_LOW, EFFORT_MEDIUM, EFFORT_HIGH };

struct method {
    const char *name;
    const char *label; /* in charts */
    enum method_kind kind;
    /* METHOD_OWN */
    enum build_quality quality;
    enum target target;
    uint32_t layout_flags;
    float rays_per_primitive; /* what auto is told */
    /* Embree's */
    enum method_effort effort;
    uint32_t arity; /* METHOD_BVH */
    bool robust, compact; /* METHOD_SCENE */
};

const struct method *method_all(uint32_t *ret_count);
/* NULL when there is none. */
const struct method *method_find(const char *name);
/* Whether rays can be sent through what it builds; whether its tree can be looked at. */
bool method_traces(const struct method *method);
bool method_has_tree(const struct method *method);

#endif

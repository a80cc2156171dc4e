/* SPDX-License-Identifier: Apache-2.0 */
/* method.h - lists the methods that are compared: our tiers by target and builder, and what Embree offers by itself. */
#ifndef BVHD_BENCH_METHOD_H
#define BVHD_BENCH_METHOD_H

#include <stdbool.h>

#include "proto/base/geometry.h"

enum method_kind {
    METHOD_OWN, /* a tier, a target and a builder */
    METHOD_BVH, /* rtcBuildBVH: has a tree, but no tracer */
    METHOD_SCENE, /* rtcCommitScene: has a tracer, but no tree to inspect */
    METHOD_SWEEP, /* a full sweep, the reference for trees */
};

enum method_effort { EFFORT_LOW, EFFORT_MEDIUM, EFFORT_HIGH };

struct method {
    const char *name;
    const char *label; /* in charts */
    enum method_kind kind;
    /* METHOD_OWN */
    enum build_quality quality;
    enum build_builder builder;
    enum target target;
    uint32_t layout_flags;
    float rays_per_primitive; /* the hint that auto is given */
    /* of Embree */
    enum method_effort effort;
    uint32_t arity; /* METHOD_BVH */
    bool robust, compact; /* METHOD_SCENE */
};

const struct method *method_all(uint32_t *ret_count);
/* Returns NULL when no method has this name. */
const struct method *method_find(const char *name);
/* Whether rays can be traced through the result; whether its tree can be inspected. */
bool method_traces(const struct method *method);
bool method_has_tree(const struct method *method);

#endif

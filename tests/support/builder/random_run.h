/* SPDX-License-Identifier: Apache-2.0 */
/* random_run.h - one run of random_inputs: its options, its counts and its failures. For test programs only. */
#ifndef BVHD_RANDOM_RUN_H
#define BVHD_RANDOM_RUN_H

#include "builder/context.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"
#include "tests/support/builder/random_input.h"

struct random_run {
    enum build_builder builder;
    enum random_choice kinds;
    enum build_quality quality; /* UNSPECIFIED: that of each request */
    struct memory memory;
    struct build_context context;
    struct limits limits;
    uint64_t seed; /* of the current case */
    uint64_t failures;
    uint64_t cases, rays, hits, uncertain, boxes, refused, natives;
    const struct lavapipe_scene *native; /* the scene that is traced, in the native layout; NULL: it was not built */
};

/* Counts a failure of the current case, and prints the first ones with the arguments that repeat them. */
void random_run_fail(struct random_run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif

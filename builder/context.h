/* SPDX-License-Identifier: Apache-2.0 */
/*
 * context.h - what a step of a build works with: memory, threads, and news of whether anybody still wants the result.
 */
#ifndef BVHD_CONTEXT_H
#define BVHD_CONTEXT_H

#include <stdatomic.h>
#include <stdbool.h>

#include "proto/base/memory.h"
#include "builder/format/output.h"
#include "proto/base/parallel.h"

struct build_context {
    struct memory *memory;
    const struct parallel *parallel;
    /* may be NULL; every step returns BVHD_CANCELLED within some milliseconds after it is set */
    const atomic_bool *cancel;
    /*
     * Called from any thread, with done <= total in primitives (or what they were split into), after each piece and at
     * the end; calls may overtake each other. May be NULL.
     */
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
    struct build_output *output; /* NULL: blobs come from `memory` */
};

static inline bool context_cancelled(const struct build_context *context)
{
    return parallel_cancelled(context->cancel);
}

#endif

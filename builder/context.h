/* SPDX-License-Identifier: Apache-2.0 */
/*
 * context.h - the resources that every step of a build gets: memory, threads, a flag that cancels it, and where to
 * report progress.
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
    /* may be NULL; every step returns BVHD_CANCELLED within a few milliseconds after the flag is set */
    const atomic_bool *cancel;
    /*
     * Reports progress after each piece and at the end, with done <= total, counted in primitives (or in refs where
     * splits make more of those). May be called from any thread, and calls may overtake each other. May be NULL.
     */
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
    struct build_output *output; /* where the blob's bytes come from; NULL: from `memory` */
};

/* True when the build has been cancelled. */
static inline bool context_cancelled(const struct build_context *context)
{
    return parallel_cancelled(context->cancel);
}

#endif

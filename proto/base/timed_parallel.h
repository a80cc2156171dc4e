/* SPDX-License-Identifier: Apache-2.0 */
/*
 * timed_parallel.h - ends work on a moment: it runs tasks as another struct parallel does, and sets the flag that
 * cancels them when a task begins after that moment. So builds keep a deadline without a thread that watches it.
 */
#ifndef BVHD_TIMED_PARALLEL_H
#define BVHD_TIMED_PARALLEL_H

#include <stdint.h>

#include "proto/base/parallel.h"

#define TIMED_PARALLEL_NEVER UINT64_MAX

struct timed_parallel {
    struct parallel parallel; /* to give to the work; the first member */
    const struct parallel *inner; /* runs the tasks */
    const _Atomic uint64_t *moment; /* by clock_ns; TIMED_PARALLEL_NEVER: none. It may change at any time */
    atomic_bool *cancel;
};

/* Prepares the struct, which borrows all of its arguments and must not move. */
void timed_parallel_init(struct timed_parallel *timed, const struct parallel *inner, const _Atomic uint64_t *moment,
                         atomic_bool *cancel);

#endif

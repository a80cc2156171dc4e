/* SPDX-License-Identifier: Apache-2.0 */
/*
 * workers.h - a struct parallel over threads of its own, for programs that build in process. The daemon brings its own
 * pool.
 *
 * A call's tasks are handed out one by one, from an atomic counter, to the caller and to whichever workers are free. A
 * caller whose last tasks run elsewhere works on the calls that those tasks make meanwhile, and on no others; so nested
 * calls use all threads and never wait for each other in a circle. Free workers look for work for some microseconds,
 * then sleep. They block all signals.
 */
#ifndef BVHD_WORKERS_H
#define BVHD_WORKERS_H

#include "proto/base/parallel.h"
#include "proto/base/status.h"

enum { WORKERS_MAX_THREADS = 1024 };

struct workers;

/*
 * `threads` counts the caller's thread, which works too; 0 means one for each processor that this process may use.
 * BVHD_TOO_LARGE over WORKERS_MAX_THREADS, BVHD_NO_MEMORY, BVHD_IO when the system starts no more threads. All threads
 * are up and idle on return, so the process may fork.
 */
enum bvhd_status workers_create(unsigned threads, struct workers **ret_workers, struct bvhd_error *error);

/* Waits for its threads. No for_each may be running. NULL-safe. */
void workers_destroy(struct workers *workers);

/* The interface; lives as long as the workers do. Safe to use from several threads at once. */
const struct parallel *workers_parallel(const struct workers *workers);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * workers.h - a pool of threads behind a struct parallel, for programs that build in process. The daemon brings its own
 * pool (daemon/pool).
 *
 * The tasks of a for_each call are handed out one by one, from an atomic counter, to the caller and to the workers that
 * are free. Tasks may call for_each themselves. A caller that has no task left to start, but whose last tasks still run
 * on other threads, helps with the nested calls of those tasks, and with no other calls. So nested calls use all
 * threads, and there is no deadlock. Where more calls are open at once than four for each thread, the latest run on
 * their callers alone. A free worker spins before it sleeps, for as long as it has worked since it last slept, but at
 * least 50 microseconds and at most one millisecond. Workers block all signals.
 */
#ifndef BVHD_WORKERS_H
#define BVHD_WORKERS_H

#include "proto/base/parallel.h"
#include "proto/base/status.h"

enum { WORKERS_MAX_THREADS = 1024 };

struct workers;

/*
 * Starts the threads. `threads` counts the caller's thread, which works too; 0 means one for each processor that this
 * process may use. Returns BVHD_TOO_LARGE over WORKERS_MAX_THREADS, BVHD_NO_MEMORY, or BVHD_IO when the system starts
 * no more threads. On return all threads are up and idle, so that the process may fork: a thread that is still starting
 * can hold a lock of the allocator. A forked child has none of the threads. The caller ends *ret_workers with
 * workers_destroy.
 */
enum bvhd_status workers_create(unsigned threads, struct workers **ret_workers, struct bvhd_error *error);

/* Waits for the threads to end, and frees the pool. No for_each may be running. `workers` may be NULL. */
void workers_destroy(struct workers *workers);

/*
 * Returns the interface through which builds use the pool. It lives as long as the workers, and any number of threads
 * may use it at once.
 */
const struct parallel *workers_parallel(const struct workers *workers);

#endif

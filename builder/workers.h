/* SPDX-License-Identifier: Apache-2.0 */
/* workers.h - a struct parallel over threads of its own, for programs that build in process. The daemon brings its own pool. */
#ifndef BVHD_WORKERS_H
#define BVHD_WORKERS_H

#include "parallel.h"
#include "status.h"

struct workers;

/* `threads` counts the caller's thread, which works too; 0 means one for each processor that this process may use. */
enum bvhd_status workers_create(unsigned threads, struct workers **ret_workers, struct bvhd_error *error);

/* Waits for its threads. No for_each may be running. NULL-safe. */
void workers_destroy(struct workers *workers);

/* The interface; lives as long as the workers do. Safe to use from several threads at once. */
const struct parallel *workers_parallel(const struct workers *workers);

#endif

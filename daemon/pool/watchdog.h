/* SPDX-License-Identifier: Apache-2.0 */
/*
 * watchdog.h - whether the service still gets anywhere. That the loop does shows by itself: it is the one that asks.
 * The threads are asked by a job that does nothing: they are stuck when it has not come back in `patience_ms`. Whatever
 * runs lets it through between two tasks, or on a spare thread, so only something that holds every thread for so long,
 * without end or not, is in its way. Loop thread only.
 */
#ifndef BVHD_WATCHDOG_H
#define BVHD_WATCHDOG_H

#include "daemon/pool/pool.h"

enum { WATCHDOG_PATIENCE_MS = 300 * 1000 };

struct watchdog {
    struct pool *pool;
    struct pool_job probe; /* its flow is the watchdog's */
    uint64_t patience_ms;
    uint64_t sent_ms;
    bool under_way;
};

/* BVHD_NO_MEMORY. `pool` must outlive it. */
enum bvhd_status watchdog_init(struct watchdog *watchdog, struct pool *pool, uint64_t patience_ms,
                               struct bvhd_error *error);

/* Takes the job back, with pool_collect. NULL-safe, also when zeroed. */
void watchdog_finish(struct watchdog *watchdog);

/* Asks anew when the last job is back. `now_ms` is monotonic. */
bool watchdog_is_alive(struct watchdog *watchdog, uint64_t now_ms);

#endif

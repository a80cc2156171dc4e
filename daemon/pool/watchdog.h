/* SPDX-License-Identifier: Apache-2.0 */
/*
 * watchdog.h - checks whether the service still makes progress. The loop proves it by calling this module. The pool's
 * threads are checked with a probe: a job that does nothing. They are stuck when the probe has not come back within
 * `patience_ms`. Other jobs let the probe run between two of their tasks, or it runs on a spare thread, so it is late
 * only if every thread has been held for that long. The server sends notify_alive only while watchdog_is_alive returns
 * true, so that the service manager notices a daemon that is stuck. Loop thread only.
 */
#ifndef BVHD_WATCHDOG_H
#define BVHD_WATCHDOG_H

#include "daemon/pool/pool.h"

enum { WATCHDOG_PATIENCE_MS = 300 * 1000 };

struct watchdog {
    struct pool *pool;
    struct pool_job probe; /* its flow belongs to the watchdog */
    uint64_t patience_ms;
    uint64_t sent_ms; /* when the probe was last submitted */
    bool under_way; /* the probe was submitted and is not done */
};

/* `pool` must outlive the watchdog. Fails with BVHD_NO_MEMORY only. */
enum bvhd_status watchdog_init(struct watchdog *watchdog, struct pool *pool, uint64_t patience_ms,
                               struct bvhd_error *error);

/* Waits for the probe, by calls of pool_collect. `watchdog` may be NULL or zeroed. */
void watchdog_finish(struct watchdog *watchdog);

/*
 * Returns false while a probe has been under way for `patience_ms` or longer. When the last probe is back, it submits
 * the next one. `now_ms` is the time of a monotonic clock, in milliseconds.
 */
bool watchdog_is_alive(struct watchdog *watchdog, uint64_t now_ms);

#endif

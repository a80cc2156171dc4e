/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/watchdog.h"

#include <time.h>

#include "proto/base/container_of.h"

static struct watchdog *owner(struct pool_job *job)
{
    return container_of(job, struct watchdog, probe);
}

static void run_probe(struct pool_job *job, const struct parallel *parallel)
{
    (void)job;
    (void)parallel;
}

static void probe_done(struct pool_job *job)
{
    owner(job)->under_way = false;
}

enum bvhd_status watchdog_init(struct watchdog *watchdog, struct pool *pool, uint64_t patience_ms,
                               struct bvhd_error *error)
{
    struct pool_flow *flow = pool_flow_create(pool, NULL);
    if (!flow)
        return bvhd_error_no_memory(error, "watchdog", "no memory for its flow");
    *watchdog = (struct watchdog){.pool = pool, .patience_ms = patience_ms, .probe.flow = flow};
    return BVHD_OK;
}

void watchdog_finish(struct watchdog *watchdog)
{
    if (!watchdog || !watchdog->pool)
        return;
    if (watchdog->under_way)
        pool_cancel(watchdog->pool, &watchdog->probe);
    while (watchdog->under_way) { /* not for long: the probe was withdrawn, or is running and does nothing */
        pool_collect(watchdog->pool);
        nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
    }
    pool_flow_end(watchdog->pool, watchdog->probe.flow);
    watchdog->pool = NULL;
}

bool watchdog_is_alive(struct watchdog *watchdog, uint64_t now_ms)
{
    if (watchdog->under_way)
        return now_ms - watchdog->sent_ms < watchdog->patience_ms;
    watchdog->probe = (struct pool_job){.run = run_probe, .done = probe_done, .flow = watchdog->probe.flow};
    watchdog->under_way = true;
    watchdog->sent_ms = now_ms;
    pool_submit(watchdog->pool, &watchdog->probe);
    return true;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_internal.h - the inside of the service, for the sessions and their requests.
 *
 * Most members are modules, which are used through their own functions. The counters may be incremented directly.
 */
#ifndef BVHD_SERVICE_INTERNAL_H
#define BVHD_SERVICE_INTERNAL_H

#include "daemon/service/admission.h"
#include "daemon/service/counters.h"
#include "daemon/service/deferred.h"
#include "daemon/service/disposal.h"
#include "daemon/service/flight.h"
#include "daemon/service/latency.h"
#include "daemon/service/memory_queue.h"
#include "daemon/service/service.h"
#include "daemon/service/user.h"
#include "daemon/system/log.h"
#include "proto/base/list.h"

/*
 * All sessions, and what they have under way together. The session layer keeps these up to date and enforces its quotas
 * by them; the service only reads them.
 */
struct session_totals {
    struct list all; /* every session that exists */
    uint32_t open; /* sessions that are not closed */
    uint32_t closing; /* closed sessions whose items a worker still prepares */
};

struct service {
    /* constant after the start */
    struct service_options options;
    void (*wake)(void *context);
    void *wake_context;
    uint64_t started_ns;
    uint32_t builders; /* bits 1 << BUILDER_ of those that can be asked for */

    /* accounts of memory */
    struct memory memory; /* the budget, of which the next two are shares */
    struct memory inlines; /* for inline payloads */
    struct memory large; /* for large prepares and builds */
    /* replies, frames that arrive, results: no budget may be in their way, since credits and quotas bound them */
    struct memory unlimited;
    struct descriptors descriptors;
    struct blob_account account;

    /* modules */
    struct pool *pool;
    struct cache *cache;
    struct disk *disk; /* NULL: results are not kept on disk */
    struct admission admission;
    struct memory_queue preparing; /* items that wait for memory to be prepared */
    struct users users; /* the shares of all sessions */
    struct disposals disposals;
    struct flights flights;
    struct deferred_calls deferred; /* run by service_pump */
    struct counters counters; /* only the sums are kept here; service_counters fills in the levels */
    struct latency latencies[LATENCY_STAGE_COUNT];
    /* for log lines about slow items, items that the system failed, requests that are refused, and sessions that end */
    struct log_limit slow_log, failed_log, refused_log, ended_log;

    /* kept by others */
    struct session_totals sessions;
    uint32_t connections;
    uint32_t cache_tasks; /* trims and clears of the disk that are with a worker */
    uint32_t with_deadline; /* requests that have one */
    bool draining;
};

/*
 * Starts the prepares and builds that memory now allows, then runs the deferred calls. It is called at the end of
 * everything that queues work or frees memory: a frame, the end of a session, an iteration of the loop.
 */
void service_pump(struct service *service);

/* Returns what all sessions together use. */
static inline uint64_t service_uses(const struct service *service, enum share_kind kind)
{
    return service->users.root.used[kind];
}

/* Returns the counters, sums and levels. */
struct counters service_counters(const struct service *service);

#endif

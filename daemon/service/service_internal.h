/* SPDX-License-Identifier: Apache-2.0 */
/* service_internal.h - the inside of a service, for its sessions and their requests. */
#ifndef BVHD_SERVICE_INTERNAL_H
#define BVHD_SERVICE_INTERNAL_H

#include "daemon/service/admission.h"
#include "daemon/service/counters.h"
#include "daemon/service/fair_queue.h"
#include "daemon/service/flight.h"
#include "daemon/service/service.h"

struct session;
struct request;

/* Requests with payloads that are not needed any more, of which their clients do not know yet. */
struct request_news {
    struct request *first, *last;
};

struct service {
    struct service_options options;
    void (*wake)(void *context);
    void *wake_context;
    struct memory memory; /* the budget */
    struct memory inlines; /* of inline payloads, a share of it */
    struct memory large; /* of prepares and builds that are not small, a share of it */
    /* and frames that arrive; without limit: bounded by connections and credits, and no budget may be in the way */
    struct memory replies;
    struct descriptors descriptors;
    struct blob_account account;
    struct pool *pool;
    struct pool_flow *housekeeping;
    struct cache *cache;
    struct admission admission;
    struct fair_queue preparing[ADMISSION_CLASSES]; /* items that wait for memory */
    struct flights flights;
    struct request_news news;
    struct counters counters;
    struct session *sessions; /* all that exist */
    uint32_t session_count; /* those that are not closed */
    uint32_t closing_count; /* closed, but a worker has something of theirs */
    uint32_t under_way; /* items of those that are not closed */
    uint32_t connections;
    uint64_t pool_bytes;
    uint64_t backlog_bytes; /* of results that have not left, all sessions together */
    uint64_t started_ns;
    bool draining;
};

/*
 * Whoever has asked for something, or let go of something, calls it before the loop goes on: starts what memory now
 * allows, and tells clients of payloads that are free.
 */
void service_pump(struct service *service);

/* The counters with their levels. */
struct counters service_counters(const struct service *service);

#endif

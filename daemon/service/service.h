/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service.h - what all sessions share: worker threads, memory, in-flight builds, the cache, counters. It knows neither
 * sockets nor the protocol. For the loop thread only.
 */
#ifndef BVHD_SERVICE_H
#define BVHD_SERVICE_H

#include "daemon/service/blob.h"
#include "daemon/service/cache.h"
#include "daemon/system/descriptors.h"
#include "daemon/pool/pool.h"
#include "proto/base/request_limits.h"

/* The least budget in bytes: enough for the requests themselves, whatever is asked for. */
enum { SERVICE_LEAST_MEMORY = 16 << 20 };

struct service_options {
    unsigned workers; /* 0: one for each processor */
    /* the budget: bytes for requests and builds, at least SERVICE_LEAST_MEMORY; 0: half of machine_memory() */
    uint64_t memory;
    uint64_t cache; /* bytes of results that are kept in memory; 0: none are */
    const char *disk_directory; /* where results are kept on disk; NULL: nowhere */
    uint64_t disk_budget; /* bytes of results that are kept there */
    struct limits limits;
    uint32_t credits; /* the most items under way on one connection */
    uint64_t max_pool; /* the most bytes of one connection's pool */
    uint64_t slow_ms; /* structures that take as long are logged, with the reason; 0: none are */
    uint32_t max_queue; /* the most items under way in all; beyond it, requests are answered with BUSY */
};

struct service_options service_options_default(void);

struct service;

/*
 * `wake` is called on any thread; it has to bring about a call of service_collect on the loop. BVHD_NO_MEMORY; BVHD_IO
 * when threads cannot be started, or fewer than DESCRIPTORS_LEAST descriptors can be opened.
 */
enum bvhd_status service_create(const struct service_options *options, void (*wake)(void *context), void *wake_context,
                                struct service **ret_service, struct bvhd_error *error);

/* Takes over those options that a running service can change: `cache` and `slow_ms`. */
void service_reconfigure(struct service *service, const struct service_options *options);

/* All sessions must be closed. Waits for the jobs that still run, which have been told to stop. NULL-safe. */
void service_destroy(struct service *service);

/*
 * One iteration of the loop: collects what workers have finished, starts what memory allows, and reports to clients. It
 * does as much as the loop may stop for, and calls `wake` if anything is left. Returns whether more jobs have ended, or
 * more of the cache has to be evicted.
 */
bool service_collect(struct service *service);

/* Begins work that no client waits for. To be called when the replies of an iteration have been written. */
void service_rest(struct service *service);

/* From here on, sessions answer new requests with UNAVAILABLE. What is under way goes on. */
void service_drain(struct service *service);

/*
 * The number of items under way of all sessions. An item counts until its reply has left, so a service that drains is
 * done at 0.
 */
uint32_t service_pending(const struct service *service);

/*
 * The account for frames that arrive and for replies. It has no limit: connections, their credits and the limits of
 * frames bound it, and with a limit, clients that never finish a frame could use it up for all others.
 */
struct memory *service_frame_memory(struct service *service);

/* Returns the bytes for requests and builds. */
uint64_t service_memory_limit(const struct service *service);

struct descriptors *service_descriptors(struct service *service);

/* The worker threads, for jobs beside those of requests. Such jobs have to be done before service_destroy. */
struct pool *service_pool(struct service *service);

/* Returns whether workers build anything, so that there is progress to report. */
bool service_is_building(const struct service *service);

/* Returns whether requests have deadlines that have to be checked. */
bool service_has_deadlines(const struct service *service);

/* Sets the number of open connections, for the counters. */
void service_count_connections(struct service *service, uint32_t open);

/* Counts a client that was turned away. */
void service_count_refusal(struct service *service);

#endif

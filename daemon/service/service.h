/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service.h - what all sessions share: threads, cache, running builds, memory, counters. No sockets. Loop thread only.
 */
#ifndef BVHD_SERVICE_H
#define BVHD_SERVICE_H

#include "daemon/service/blob.h"
#include "daemon/service/cache.h"
#include "daemon/system/descriptors.h"
#include "daemon/pool/pool.h"
#include "proto/base/request_limits.h"

/* Enough for the requests themselves, whatever is asked for. */
enum { SERVICE_LEAST_MEMORY = 16 << 20 };

struct service_options {
    unsigned workers; /* 0: one for each processor */
    /*
     * bytes for requests and builds, at least SERVICE_LEAST_MEMORY; 0: half of what the machine, or its control group,
     * has
     */
    uint64_t memory;
    uint64_t cache; /* bytes of results kept; 0: keep none */
    struct limits limits;
    uint32_t credits; /* items under way on a connection */
    uint64_t max_pool; /* bytes of one connection's pool */
    uint32_t max_queue; /* items under way in all; beyond it requests are answered BUSY */
};

struct service_options service_options_default(void);

struct service;

/* `wake` comes from any thread and asks for a call of service_collect on the loop. */
enum bvhd_status service_create(const struct service_options *options, void (*wake)(void *context), void *wake_context,
                                struct service **ret_service, struct bvhd_error *error);

/* All sessions must be closed; waits for what still runs, which has been told to stop. NULL-safe. */
void service_destroy(struct service *service);

/*
 * Takes up what workers have finished, and starts what may start: as much as fits in a turn of the loop. Returns
 * whether more has finished.
 */
bool service_collect(struct service *service);

/* No new requests: sessions answer them with UNAVAILABLE. What is under way goes on. */
void service_drain(struct service *service);

/* Items under way, of all sessions, replies that have not left included: a drained service is done at 0. */
uint32_t service_pending(const struct service *service);

/*
 * For frames, in and out. No budget is in their way: connections, their credits and the limits of frames bound them,
 * and a budget would let clients who never finish a frame take it from the others.
 */
struct memory *service_frame_memory(struct service *service);

struct descriptors *service_descriptors(struct service *service);

/* For jobs beside those of requests; they have to be done before service_destroy. */
struct pool *service_pool(struct service *service);

/* Told by whoever owns connections, for the counters. */
void service_count_connections(struct service *service, uint32_t open);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * counters.h - what the service has done, and its current state, as numbers with stable names: the answer to STATS.
 *
 * Sums count from the start of the service. Levels are filled in when STATS is answered. For the loop thread only.
 */
#ifndef BVHD_COUNTERS_H
#define BVHD_COUNTERS_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* New counters are appended to their group. A name never changes its meaning. */
#define COUNTERS(X)                                                                                                    \
    /* sums */                                                                                                         \
    X(requests) /* BUILD and GET that were taken */                                                                    \
    X(items) /* in them */                                                                                             \
    X(refused) /* requests answered by BUSY, or by UNAVAILABLE while the service ends */                               \
    X(request_errors) /* requests answered by ERROR for what they say */                                               \
    X(protocol_errors) /* connections that ended for what was sent */                                                  \
    X(cancelled) /* items that were cancelled, or whose client went before their result */                             \
    X(prepares_started) /* one whose rows ask for more memory than it was promised begins again */                     \
    X(prepares_done)                                                                                                   \
    X(prepares_failed)                                                                                                 \
    X(builds_started)                                                                                                  \
    X(builds_done)                                                                                                     \
    X(builds_failed)                                                                                                   \
    X(builds_cancelled)                                                                                                \
    X(builds_retried) /* short of memory beside others, tried again alone */                                           \
    X(hits_memory) /* items answered from the cache */                                                                 \
    X(hits_disk)                                                                                                       \
    X(coalesced) /* items that waited for another one's build */                                                       \
    X(misses) /* items whose key was neither cached nor being built */                                                 \
    X(payload_bytes) /* of items that were taken */                                                                    \
    X(result_bytes) /* of results that were sent */                                                                    \
    X(busy_ns) /* time that threads have spent in jobs */                                                              \
    X(active_ns) /* wall time with jobs queued or running, short pauses included */                                    \
    X(cache_evicted)                                                                                                   \
    /* levels */                                                                                                       \
    X(uptime_ms)                                                                                                       \
    X(workers)                                                                                                         \
    X(connections)                                                                                                     \
    X(sessions) /* with those whose client is gone while a worker still has something of it */                         \
    X(queue_depth) /* items under way */                                                                               \
    X(prepares_waiting) /* for memory */                                                                               \
    X(builds_waiting) /* for memory */                                                                                 \
    X(builds_running)                                                                                                  \
    X(jobs_queued)                                                                                                     \
    X(jobs_running)                                                                                                    \
    X(live_results)                                                                                                    \
    X(live_result_bytes)                                                                                               \
    X(cache_entries)                                                                                                   \
    X(cache_bytes)                                                                                                     \
    X(cache_budget)                                                                                                    \
    X(memory_live)                                                                                                     \
    X(memory_peak)                                                                                                     \
    X(memory_limit)                                                                                                    \
    X(memory_promised) /* to steps under way */                                                                        \
    X(pool_bytes) /* of clients' pools */                                                                              \
    X(descriptors_used)                                                                                                \
    X(descriptors_limit)

struct counters {
#define COUNTER(name) uint64_t name;
    COUNTERS(COUNTER)
#undef COUNTER
};

/* Packs the control message of FRAME_COUNTERS, in `memory`. */
enum bvhd_status counters_pack(const struct counters *counters, struct memory *memory, struct bytes *ret_bytes,
                               struct bvhd_error *error);

#endif

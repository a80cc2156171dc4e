/* SPDX-License-Identifier: Apache-2.0 */
/*
 * counters.h - what the service has done, and its current state, as numbers with stable names: the answer to STATS.
 *
 * Sums count from the start of the service, where the work is done (service->counters.NAME++); levels describe the
 * moment in which STATS is answered. service_counters (service.c) fills in the levels, and the sums that the pool, the
 * cache and the disk keep. Names that end in _ms, _us, _ns or _bytes are in these units; memory_*, cache_budget and
 * disk_budget are bytes; all others are numbers of things. For the loop thread only.
 */
#ifndef BVHD_COUNTERS_H
#define BVHD_COUNTERS_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* Sums since the start. New counters are appended to their group; a name never changes its meaning. */
#define COUNTERS_OF_SUMS(X)                                                                                            \
    X(requests) /* BUILD and GET requests that were accepted */                                                        \
    X(items) /* items of those requests */                                                                             \
    X(refused) /* requests answered by BUSY, or by UNAVAILABLE while the service ends */                               \
    X(request_errors) /* requests answered by ERROR because of what they say */                                        \
    X(protocol_errors) /* connections that ended because the client broke the protocol */                              \
    X(cancelled) /* items that were cancelled, or whose client left before their result */                             \
    X(prepares_started) /* a prepare that begins again, with a larger promise or its micromaps, counts again */        \
    X(prepares_done)                                                                                                   \
    X(prepares_failed)                                                                                                 \
    X(builds_started)                                                                                                  \
    X(builds_done)                                                                                                     \
    X(builds_failed)                                                                                                   \
    X(builds_cancelled)                                                                                                \
    X(builds_retried) /* builds that ran short of memory beside others and were tried again alone */                   \
    X(hits_memory) /* items answered from the cache */                                                                 \
    X(hits_disk) /* items answered from disk */                                                                        \
    X(coalesced) /* items that waited for a build that another item had started */                                     \
    X(misses) /* items whose key was neither kept nor being built */                                                   \
    X(payload_bytes) /* of items that were accepted */                                                                 \
    X(result_bytes) /* of results that were sent */                                                                    \
    X(busy_ns) /* time that threads have spent in jobs */                                                              \
    X(active_ns) /* wall time with jobs queued or running, short pauses included */                                    \
    X(cache_evicted) /* entries */                                                                                     \
    X(disk_written) /* results that were written to disk */                                                            \
    X(disk_write_errors) /* results that could not be written */                                                       \
    X(disk_write_dropped) /* results that were not written because too much was waiting */                             \
    X(disk_read_errors) /* results that could not be read, for other reasons than damage */                            \
    X(disk_damaged) /* results on disk that were found damaged and set aside */                                        \
    X(disk_evicted) /* entries */                                                                                      \
    X(connections_refused) /* clients that were turned away: too many connections, no memory, no descriptors */        \
    X(refits_started) /* updates, which are not among the builds */                                                    \
    X(refits_done)                                                                                                     \
    X(refits_failed)                                                                                                   \
    X(refits_cancelled)                                                                                                \
    X(refits_retried) /* updates that ran short of memory beside others and were tried again alone */

#define COUNTERS_OF_LEVELS(X)                                                                                          \
    X(pid)                                                                                                             \
    X(uptime_ms)                                                                                                       \
    X(workers)                                                                                                         \
    X(connections)                                                                                                     \
    X(sessions) /* including those whose client has left while a worker still prepares one of their items */           \
    X(queue_depth) /* items under way */                                                                               \
    X(prepares_waiting) /* items that wait for memory to be prepared */                                                \
    X(builds_waiting) /* builds that wait for memory */                                                                \
    X(builds_running)                                                                                                  \
    X(jobs_queued)                                                                                                     \
    X(jobs_running)                                                                                                    \
    X(live_results) /* results in memory, whether the cache or a reply holds them */                                   \
    X(live_result_bytes)                                                                                               \
    X(results_held_bytes) /* of results that clients have not read or have not released, for each that holds them */   \
    X(cache_entries)                                                                                                   \
    X(cache_bytes)                                                                                                     \
    X(cache_budget)                                                                                                    \
    X(disk_entries)                                                                                                    \
    X(disk_bytes)                                                                                                      \
    X(disk_budget)                                                                                                     \
    X(disk_queue_bytes) /* of results that wait to be written */                                                       \
    X(disk_ready_bytes) /* of memfds whose pages are ready for results to be read */                                   \
    X(memory_live)                                                                                                     \
    X(memory_peak)                                                                                                     \
    X(memory_limit)                                                                                                    \
    X(memory_promised) /* to prepares and builds under way (admission.h) */                                            \
    X(pool_bytes) /* of clients' pools */                                                                              \
    X(descriptors_used)                                                                                                \
    X(descriptors_limit)

/* How long items took lately, by stage (latency.h). */
#define COUNTERS_OF_LATENCIES(X)                                                                                       \
    COUNTERS_OF_LATENCY(X, waiting)                                                                                    \
    COUNTERS_OF_LATENCY(X, prepare)                                                                                    \
    COUNTERS_OF_LATENCY(X, disk) COUNTERS_OF_LATENCY(X, build) COUNTERS_OF_LATENCY(X, total)

#define COUNTERS_OF_LATENCY(X, stage)                                                                                  \
    X(latency_##stage##_items)                                                                                         \
    X(latency_##stage##_p50_us) X(latency_##stage##_p90_us) X(latency_##stage##_p99_us) X(latency_##stage##_max_us)

#define COUNTERS(X) COUNTERS_OF_SUMS(X) COUNTERS_OF_LEVELS(X) COUNTERS_OF_LATENCIES(X)

struct counters {
#define COUNTER(name) uint64_t name;
    COUNTERS(COUNTER)
#undef COUNTER
};

/* Packs the control message of FRAME_COUNTERS, in `memory`. */
enum bvhd_status counters_pack(const struct counters *counters, struct memory *memory, struct bytes *ret_bytes,
                               struct bvhd_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * batch.h - builds and updates all entries of one call in process. Each entry succeeds or fails by itself, as with
 * several build infos in one vkBuildAccelerationStructuresKHR; entries with equal keys are built once and share one
 * blob.
 */
#ifndef BVHD_BATCH_H
#define BVHD_BATCH_H

#include "builder/update/build_entry.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"

struct batch_item {
    enum bvhd_status status;
    struct bvhd_error error; /* filled when `status` is not BVHD_OK */
    struct key key;
    bool cached; /* it comes from the batch's cache: nothing was built */
    bool coalesced; /* an earlier item of this call has the same key: `blob` is that item's */
    unsigned char *blob; /* 64-byte aligned; owned by this item, or by the item that built it when `coalesced` */
    uint64_t size;
    struct bytes record; /* with ALLOW_UPDATE: what updates of it need (record.h), owned as the blob is */
    double prepare_ms, build_ms; /* build_ms is 0 when the item is cached or coalesced */
    struct summary summary; /* its peak_bytes: of preparing and building this item, also when it is not built */
};

/*
 * Prepares and builds every input, and fills ret_items[count]. Returns BVHD_OK when every item has been tried: each
 * item's own `status` says how it went. Otherwise, which means BVHD_NO_MEMORY for the batch itself, ret_items must not
 * be read. The caller ends the items with batch_finish. context->output must be NULL. Blocks the calling thread; the
 * stages of each build run on context->parallel. An update is BVHD_SOURCE_LOST, since only batch_run knows sources.
 */
enum bvhd_status batch_build(const struct build_input *inputs, uint32_t count, const struct limits *limits,
                             const struct build_context *context, struct batch_item *ret_items,
                             struct bvhd_error *error);

/* A result of a cache. Its bytes are allocated from the memory that the cache was given. */
struct batch_cached {
    unsigned char *blob; /* 64-byte aligned */
    uint64_t size;
    struct bytes record; /* 8-byte aligned; a complete one, if it was asked for */
    struct summary summary;
};

/*
 * Keeps results for later batches. `get` returns whether it has the result, and also its record if that is wanted.
 * `put` gets each result that was built, and its record if there is one, but no errors and no updates. Both are called
 * on the thread that calls batch_run.
 */
struct batch_cache {
    bool (*get)(struct batch_cache *cache, const struct key *key, bool wants_record, struct memory *memory,
                struct batch_cached *ret_cached);
    void (*put)(struct batch_cache *cache, const struct key *key, struct bytes blob, struct bytes record,
                const struct summary *summary);
};

/* Finds the sources of updates among the results of earlier batches; NULL: there is none of this key. */
struct batch_held {
    const struct batch_item *(*find)(struct batch_held *held, const struct key *key);
};

struct batch_call {
    const struct build_input *inputs;
    uint32_t count;
    const struct limits *limits;
    struct batch_cache *cache; /* NULL: every result is built */
    struct batch_held *held; /* NULL: the sources of updates are those of the cache */
};

/*
 * Does what batch_build does, takes results from a cache, and updates what is held or in the cache. An update whose
 * source is in neither of them is BVHD_SOURCE_LOST.
 */
enum bvhd_status batch_run(const struct batch_call *call, const struct build_context *context,
                           struct batch_item *ret_items, struct bvhd_error *error);

/* Frees blobs and records; `memory` is the one of the batch's context. `items` may be NULL. */
void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory);

#endif

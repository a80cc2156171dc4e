/* SPDX-License-Identifier: Apache-2.0 */
/*
 * batch.h - builds all entries of one call in process. Each entry succeeds or fails by itself, as with several build
 * infos in one vkBuildAccelerationStructuresKHR; entries with equal keys are built once and share one blob.
 */
#ifndef BVHD_BATCH_H
#define BVHD_BATCH_H

#include "builder/build.h"
#include "builder/summary.h"
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
    double prepare_ms, build_ms; /* build_ms is 0 when the item is cached or coalesced */
    struct summary summary; /* its peak_bytes: of preparing and building this item, also when it is not built */
};

/*
 * Prepares and builds every input, and fills ret_items[count]. Returns BVHD_OK when every item has been tried: each
 * item's own `status` says how it went. Otherwise, which means BVHD_NO_MEMORY for the batch itself, ret_items must not
 * be read. The caller ends the items with batch_finish. context->output must be NULL. Blocks the calling thread; the
 * stages of each build run on context->parallel.
 */
enum bvhd_status batch_build(const struct build_input *inputs, uint32_t count, const struct limits *limits,
                             const struct build_context *context, struct batch_item *ret_items,
                             struct bvhd_error *error);

/*
 * Keeps results for later batches. `get` returns whether it knows the key, and then fills in the blob, allocated from
 * `memory` and 64-byte aligned, its size and what is known about it. `put` gets each result that was built, and never
 * an error. Both are called on the thread that calls batch_run.
 */
struct batch_cache {
    bool (*get)(struct batch_cache *cache, const struct key *key, struct memory *memory, unsigned char **ret_blob,
                uint64_t *ret_size, struct summary *ret_summary);
    void (*put)(struct batch_cache *cache, const struct key *key, struct bytes blob, const struct summary *summary);
};

struct batch_call {
    const struct build_input *inputs;
    uint32_t count;
    const struct limits *limits;
    struct batch_cache *cache; /* NULL: every result is built */
};

/* Does what batch_build does, and takes results from a cache. */
enum bvhd_status batch_run(const struct batch_call *call, const struct build_context *context,
                           struct batch_item *ret_items, struct bvhd_error *error);

/* Frees the blobs; `memory` is the one of the batch's context. `items` may be NULL. */
void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory);

#endif

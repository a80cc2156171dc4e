/* SPDX-License-Identifier: Apache-2.0 */
/*
 * batch.h - builds all entries of one call in process. Each entry succeeds or fails by itself, as with several build
 * infos in one vkBuildAccelerationStructuresKHR; entries with equal keys are built once and share one blob.
 */
#ifndef BVHD_BATCH_H
#define BVHD_BATCH_H

#include "builder/build.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"

struct batch_item {
    enum bvhd_status status;
    struct bvhd_error error; /* filled when `status` is not BVHD_OK */
    struct key key;
    bool coalesced; /* an earlier item of this call has the same key: `blob` is that item's */
    unsigned char *blob; /* 64-byte aligned; owned by this item, or by the item that built it when `coalesced` */
    uint64_t size;
    double prepare_ms, build_ms;
    uint64_t peak_bytes; /* most bytes of memory that preparing and building this item held at once */
    struct build_stats stats;
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

/* Frees the blobs; `memory` is the one of the batch's context. `items` may be NULL. */
void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory);

#endif

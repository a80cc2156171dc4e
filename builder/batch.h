/* SPDX-License-Identifier: Apache-2.0 */
/*
 * batch.h - several builds of one call, in process (row F17): each entry succeeds or fails alone, equal entries are
 * built once.
 */
#ifndef BVHD_BATCH_H
#define BVHD_BATCH_H

#include "builder/build.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"

struct batch_item {
    enum bvhd_status status;
    struct bvhd_error error; /* when status is not BVHD_OK */
    struct key key;
    bool coalesced; /* the same bytes as an earlier item of this call, built once */
    unsigned char *blob; /* owned by the item; shared bytes are owned by the item that built them */
    uint64_t size;
    double prepare_ms, build_ms;
    uint64_t peak_bytes; /* most memory that this item took while it was prepared and built */
    struct build_stats stats;
};

/*
 * Fills ret_items[count]; returns BVHD_OK when every item was looked at, whatever became of it. Ended with
 * batch_finish. context->output is NULL.
 */
enum bvhd_status batch_build(const struct build_input *inputs, uint32_t count, const struct limits *limits,
                             const struct build_context *context, struct batch_item *ret_items,
                             struct bvhd_error *error);

void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * repair.h - makes the sizes in a mutated native structure consistent, so that the code after the reader's check of
 * sizes is fuzzed, too.
 */
#ifndef BVHD_FUZZ_REPAIR_H
#define BVHD_FUZZ_REPAIR_H

#include "builder/format/lavapipe.h"
#include "builder/format/serialized.h"

enum { REPAIR_SMALLEST = LAVAPIPE_HEADER + sizeof(struct lavapipe_box), REPAIR_HANDLES = 64 };

/* The offset of the leaves and all links between nodes stay unchanged. */
static inline void repair_structure(uint8_t *blob, uint64_t size, uint32_t variant)
{
    if (size < SERIALIZED_HANDLES + REPAIR_SMALLEST)
        return;
    uint64_t most = (size - SERIALIZED_HANDLES - REPAIR_SMALLEST) / 8,
             handles = bytes_get64(blob + 48) % REPAIR_HANDLES;
    handles = handles < most ? handles : most;
    uint8_t *body = blob + SERIALIZED_HANDLES + 8 * handles, *at = body + 24;
    uint64_t body_size = size - SERIALIZED_HANDLES - 8 * handles;
    bytes_put64(blob + 32, size);
    bytes_put64(blob + 40, body_size);
    bytes_put64(blob + 48, handles);
    if (variant == LAVAPIPE_COMPACTED)
        bytes_put32(at, (uint32_t)body_size);
    else
        bytes_put32(at + 12, 0);
    at += variant == LAVAPIPE_COMPACTED ? 4 : 0;
    bytes_put32(at, (uint32_t)size);
    bytes_put32(at + 4, (uint32_t)handles);
}

#endif

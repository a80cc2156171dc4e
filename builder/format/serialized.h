/* SPDX-License-Identifier: Apache-2.0 */
/*
 * serialized.h - the header with which every serialized acceleration structure begins (Vulkan specification,
 * vkCmdCopyAccelerationStructureToMemoryKHR).
 *
 * Offsets, little-endian: 0 driver UUID, 16 compatibility UUID, 32 u64 serialized size (all bytes of the blob), 40 u64
 * deserialized size (what to create), 48 u64 handle count N, 56 N u64 handles, then the layout's own bytes.
 *
 * A bottom level that names micromaps has newer headers' block form: the high half of the count is all ones, the low
 * half counts the blocks, and at 56 there is one: u32 type 0, u32 0, u64 count N, at 72 N u64 addresses of micromaps.
 */
#ifndef BVHD_SERIALIZED_H
#define BVHD_SERIALIZED_H

#include "proto/base/bytes.h"
#include "proto/base/status.h"

enum { SERIALIZED_UUID_SIZE = 16, SERIALIZED_HANDLES = 56, SERIALIZED_MICROMAPS = 72 };

/* The fields of the header. */
struct serialized_header {
    uint8_t driver_uuid[SERIALIZED_UUID_SIZE];
    uint8_t compatibility_uuid[SERIALIZED_UUID_SIZE];
    uint64_t serialized_size;
    uint64_t deserialized_size;
    uint64_t handle_count; /* of a top level */
    uint64_t micromap_count; /* of a bottom level: addresses in its block; it then has no handles */
};

/* Returns where the handles or addresses end, and the layout's own bytes begin. */
static inline uint64_t serialized_end(const struct serialized_header *header)
{
    return header->micromap_count > 0 ? SERIALIZED_MICROMAPS + 8 * header->micromap_count
                                      : SERIALIZED_HANDLES + 8 * header->handle_count;
}

/*
 * Reads and checks the header of a hostile blob of any alignment: its size field is the blob's size, and the handles
 * lie inside. BVHD_CORRUPT names the field ("header.serializedSize"); BVHD_INCOMPATIBLE means blocks other than one of
 * micromaps. The layout's reader checks the UUIDs and the deserialized size.
 */
enum bvhd_status serialized_read(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error);

/* Writes the bytes before the handles or addresses, which the caller writes. */
void serialized_write(unsigned char *blob, const struct serialized_header *header);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * serialized.h - the header with which every serialized acceleration structure begins (Vulkan specification,
 * vkCmdCopyAccelerationStructureToMemoryKHR).
 *
 * Offsets, little-endian: 0 driver UUID, 16 compatibility UUID, 32 u64 serialized size (all bytes of the blob), 40 u64
 * deserialized size (what to create), 48 u64 handle count N, 56 N u64 handles, then the layout's own bytes. The block
 * form of newer headers (the high half of the count is all ones: micromap blocks) is reserved and refused.
 */
#ifndef BVHD_SERIALIZED_H
#define BVHD_SERIALIZED_H

#include "proto/base/bytes.h"
#include "proto/base/status.h"

enum { SERIALIZED_UUID_SIZE = 16, SERIALIZED_HANDLES = 56 };

/* The fields of the header. */
struct serialized_header {
    uint8_t driver_uuid[SERIALIZED_UUID_SIZE];
    uint8_t compatibility_uuid[SERIALIZED_UUID_SIZE];
    uint64_t serialized_size;
    uint64_t deserialized_size;
    uint64_t handle_count;
};

/*
 * Reads and checks the header of a hostile blob of any alignment: its size field is the blob's size, and the handles
 * lie inside. BVHD_CORRUPT names the field ("header.serializedSize"); BVHD_INCOMPATIBLE means the block form. The
 * layout's reader checks the UUIDs and the deserialized size.
 */
enum bvhd_status serialized_read(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error);

/* Writes the first 56 bytes; the caller writes the handles. */
void serialized_write(unsigned char *blob, const struct serialized_header *header);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/serialized.h"

#include <inttypes.h>
#include <stdbool.h>

static const uint64_t blocks_of_one = UINT64_C(0xffffffff00000001);

static bool has_blocks(uint64_t count)
{
    return count >> 32 == 0xffffffff;
}

/* Reads the block of a header in block form, of which the first 56 bytes are there. */
static enum bvhd_status read_block(struct bytes blob, uint64_t count, struct serialized_header *header,
                                   struct bvhd_error *error)
{
    static const char where[] = "header.blocks";
    if (count != blocks_of_one)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.handleCount", "%" PRIu32 " blocks, known is one",
                              (uint32_t)count);
    if (blob.size < SERIALIZED_MICROMAPS)
        return bvhd_error_set(error, BVHD_CORRUPT, where, "%" PRIu64 " bytes are too few for a block", blob.size);
    if (bytes_get64(blob.data + SERIALIZED_HANDLES) != 0)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, where, "a block of another type than micromaps");
    header->micromap_count = bytes_get64(blob.data + SERIALIZED_HANDLES + 8);
    if (header->micromap_count == 0 || header->micromap_count > (blob.size - SERIALIZED_MICROMAPS) / 8)
        return bvhd_error_set(error, BVHD_CORRUPT, where, "%" PRIu64 " addresses do not fit into %" PRIu64 " bytes",
                              header->micromap_count, blob.size);
    return BVHD_OK;
}

enum bvhd_status serialized_read(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error)
{
    if (blob.size < SERIALIZED_HANDLES)
        return bvhd_error_set(error, BVHD_CORRUPT, "header", "%" PRIu64 " bytes are too few for a serialized structure",
                              blob.size);

    struct serialized_header header = {.handle_count = 0};
    memcpy(header.driver_uuid, blob.data, SERIALIZED_UUID_SIZE);
    memcpy(header.compatibility_uuid, blob.data + 16, SERIALIZED_UUID_SIZE);
    header.serialized_size = bytes_get64(blob.data + 32);
    header.deserialized_size = bytes_get64(blob.data + 40);
    const uint64_t count = bytes_get64(blob.data + 48);

    if (header.serialized_size != blob.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.serializedSize",
                              "says %" PRIu64 " bytes, but there are %" PRIu64, header.serialized_size, blob.size);
    if (!has_blocks(count) && count > (blob.size - SERIALIZED_HANDLES) / 8)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.handleCount",
                              "%" PRIu64 " handles do not fit into %" PRIu64 " bytes", count, blob.size);
    enum bvhd_status status = has_blocks(count) ? read_block(blob, count, &header, error) : BVHD_OK;
    header.handle_count = has_blocks(count) ? 0 : count;
    if (status == BVHD_OK)
        *ret_header = header;
    return status;
}

void serialized_write(unsigned char *blob, const struct serialized_header *header)
{
    memcpy(blob, header->driver_uuid, SERIALIZED_UUID_SIZE);
    memcpy(blob + 16, header->compatibility_uuid, SERIALIZED_UUID_SIZE);
    bytes_put64(blob + 32, header->serialized_size);
    bytes_put64(blob + 40, header->deserialized_size);
    bytes_put64(blob + 48, header->micromap_count > 0 ? blocks_of_one : header->handle_count);
    if (header->micromap_count == 0)
        return;
    bytes_put64(blob + SERIALIZED_HANDLES, 0);
    bytes_put64(blob + SERIALIZED_HANDLES + 8, header->micromap_count);
}

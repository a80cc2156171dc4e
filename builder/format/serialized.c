/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/serialized.h"

#include <inttypes.h>

enum bvhd_status serialized_read(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error)
{
    if (blob.size < SERIALIZED_HANDLES)
        return bvhd_error_set(error, BVHD_CORRUPT, "header", "%" PRIu64 " bytes are too few for a serialized structure",
                              blob.size);

    struct serialized_header header;
    memcpy(header.driver_uuid, blob.data, SERIALIZED_UUID_SIZE);
    memcpy(header.compatibility_uuid, blob.data + 16, SERIALIZED_UUID_SIZE);
    header.serialized_size = bytes_get64(blob.data + 32);
    header.deserialized_size = bytes_get64(blob.data + 40);
    header.handle_count = bytes_get64(blob.data + 48);

    if (header.serialized_size != blob.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.serializedSize",
                              "says %" PRIu64 " bytes, but there are %" PRIu64, header.serialized_size, blob.size);
    if (header.handle_count >> 32 == 0xffffffff)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.handleCount", "blocks of micromaps are not supported");
    if (header.handle_count > (blob.size - SERIALIZED_HANDLES) / 8)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.handleCount",
                              "%" PRIu64 " handles do not fit into %" PRIu64 " bytes", header.handle_count, blob.size);
    *ret_header = header;
    return BVHD_OK;
}

void serialized_write(unsigned char *blob, const struct serialized_header *header)
{
    memcpy(blob, header->driver_uuid, SERIALIZED_UUID_SIZE);
    memcpy(blob + 16, header->compatibility_uuid, SERIALIZED_UUID_SIZE);
    bytes_put64(blob + 32, header->serialized_size);
    bytes_put64(blob + 40, header->deserialized_size);
    bytes_put64(blob + 48, header->handle_count);
}

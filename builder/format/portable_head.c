/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_head.h"

#include "builder/format/record_kind.h"
#include "builder/format/serialized.h"

const uint8_t portable_driver_uuid[16] = "bvhd portable";

void portable_compatibility_uuid(uint32_t version, uint8_t ret_uuid[16])
{
    memcpy(ret_uuid, portable_driver_uuid, sizeof portable_driver_uuid);
    ret_uuid[15] = (uint8_t)version;
}

uint32_t portable_version_of(const uint8_t uuid[16])
{
    const uint32_t version = uuid[15];
    const bool is_named = memcmp(uuid, portable_driver_uuid, sizeof portable_driver_uuid - 1) == 0;
    return is_named && version <= PORTABLE_NEWEST ? version : 0;
}

uint32_t portable_head_handles(const struct portable_header *header, const struct canonical *canonical)
{
    return record_kind_is_top(header->content) ? canonical->reference_count : 0;
}

/* A bottom level has no handles, and a top level has no micromaps. */
static struct serialized_header head_of(const struct portable_header *header, uint32_t handles)
{
    return (struct serialized_header){.handle_count = handles, .micromap_count = header->micromap_count};
}

uint64_t portable_head_body(const struct portable_header *header, uint32_t handles)
{
    const struct serialized_header head = head_of(header, handles);
    return portable_body_of(&head);
}

void portable_head_write(unsigned char *blob, const struct portable_header *header, uint32_t handles)
{
    const uint64_t body = portable_head_body(header, handles);
    struct serialized_header serialized = head_of(header, handles);
    serialized.serialized_size = body + header->body_size;
    serialized.deserialized_size = header->body_size;
    memcpy(serialized.driver_uuid, portable_driver_uuid, sizeof serialized.driver_uuid);
    portable_compatibility_uuid(header->version, serialized.compatibility_uuid);
    memset(blob, 0, body);
    serialized_write(blob, &serialized);
    const uint32_t count = handles + header->micromap_count;
    for (uint32_t i = 0; i < count; i++)
        bytes_put64(blob + serialized_end(&serialized) - (uint64_t)8 * (count - i), i + 1);
}

struct layout_sizes portable_head_sizes(const struct portable_header *header, uint32_t handles)
{
    const uint64_t body = portable_head_body(header, handles);
    return (struct layout_sizes){
        .total = body + header->body_size,
        .header = body + header->node_offset,
        .nodes = header->record_offset - header->node_offset,
        .records = header->vertex_offset - header->record_offset,
        .vertices = header->geometry_offset - header->vertex_offset,
        .geometries = header->body_size - header->geometry_offset,
    };
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_micromap.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>

/* ---- Writing ---- */

/* Places the sections behind a header that has all counts and states_size. */
static void place_sections(struct portable_micromap_header *header)
{
    header->triangle_offset = sizeof *header;
    header->states_offset =
        bytes_align(header->triangle_offset + (uint64_t)header->triangle_count * sizeof(struct micromap_triangle), 16);
    header->index_offset = bytes_align(header->states_offset + header->states_size, 16);
    header->body_size = header->index_offset + (uint64_t)header->index_count * sizeof(uint32_t);
}

static struct portable_micromap_header header_of(const struct layout_micromap *input)
{
    struct portable_micromap_header header = {
        .magic = PORTABLE_MICROMAP_MAGIC,
        .version = PORTABLE_MICROMAP_VERSION,
        .build_flags = input->flags,
        .triangle_count = input->triangle_count,
        .index_count = input->index_count,
        .states_size = input->states_size,
    };
    _Static_assert(sizeof header.baked == sizeof input->baked, "states");
    memcpy(header.baked, input->baked, sizeof header.baked);
    place_sections(&header);
    return header;
}

/* Copies an array, which is NULL if it is empty, and writes zeros behind it up to `end`. */
static void write_section(unsigned char *body, uint64_t offset, const void *data, uint64_t size, uint64_t end)
{
    if (size > 0)
        memcpy(body + offset, data, size);
    memset(body + offset + size, 0, end - offset - size);
}

enum bvhd_status portable_micromap_write(const struct layout_micromap *input, unsigned char **ret_blob,
                                         struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    const struct portable_micromap_header header = header_of(input);
    const uint64_t total = PORTABLE_MICROMAP_BODY + header.body_size;
    unsigned char *blob = output_allocate(input->output, input->memory, total, error);
    if (!blob)
        return BVHD_NO_MEMORY;
    unsigned char *body = blob + PORTABLE_MICROMAP_BODY;
    memset(blob, 0, PORTABLE_MICROMAP_BODY);
    memcpy(blob, portable_driver_uuid, sizeof portable_driver_uuid);
    portable_compatibility_uuid(header.version, blob + sizeof portable_driver_uuid);
    memcpy(body, &header, sizeof header);
    write_section(body, header.triangle_offset, input->triangles,
                  (uint64_t)header.triangle_count * sizeof *input->triangles, header.states_offset);
    write_section(body, header.states_offset, input->states, header.states_size, header.index_offset);
    write_section(body, header.index_offset, input->indices, (uint64_t)header.index_count * sizeof *input->indices,
                  header.body_size);
    *ret_blob = blob;
    *ret_sizes = (struct layout_sizes){
        .total = total,
        .header = PORTABLE_MICROMAP_BODY + header.triangle_offset,
        .records = header.states_offset - header.triangle_offset,
        .vertices = header.index_offset - header.states_offset,
        .geometries = header.body_size - header.index_offset,
    };
    return BVHD_OK;
}

/* The counts are below 2^32, and states are bytes in memory. */
uint64_t portable_micromap_bound(uint64_t triangles, uint64_t states, uint64_t indices)
{
    return sizeof(struct portable_micromap_header) + bytes_align(triangles * sizeof(struct micromap_triangle), 16) +
           bytes_align(states, 16) + indices * sizeof(uint32_t);
}

/* ---- Reading ---- */

struct micromap_reader {
    struct bytes body;
    const struct portable_micromap_header *header;
    struct bvhd_error *error;
};

static enum bvhd_status corrupt(const struct micromap_reader *r, const char *where, const char *reason)
{
    return bvhd_error_set(r->error, BVHD_CORRUPT, where, "%s", reason);
}

static enum bvhd_status corrupt_at(const struct micromap_reader *r, const char *section, uint32_t row,
                                   const char *reason)
{
    char where[48];
    snprintf(where, sizeof where, "%s[%" PRIu32 "]", section, row);
    return corrupt(r, where, reason);
}

static enum bvhd_status find_body(struct micromap_reader *r, struct bytes blob)
{
    uint8_t uuid[16];
    if (blob.size < PORTABLE_MICROMAP_BODY + sizeof *r->header)
        return corrupt(r, "body", "too short");
    if (memcmp(blob.data, portable_driver_uuid, sizeof portable_driver_uuid) != 0)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "header.driverUUID", "written for another driver");
    portable_compatibility_uuid(PORTABLE_MICROMAP_VERSION, uuid);
    if (memcmp(blob.data + sizeof portable_driver_uuid, uuid, sizeof uuid) != 0)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "header.compatibilityUUID", "written by another version");
    for (uint64_t i = 2 * sizeof uuid; i < PORTABLE_MICROMAP_BODY; i++)
        if (blob.data[i] != 0)
            return corrupt(r, "header.padding", "not zero");
    r->body = (struct bytes){blob.data + PORTABLE_MICROMAP_BODY, blob.size - PORTABLE_MICROMAP_BODY};
    r->header = (const struct portable_micromap_header *)(const void *)r->body.data;
    return BVHD_OK;
}

static enum bvhd_status check_header(const struct micromap_reader *r)
{
    const struct portable_micromap_header *h = r->header;
    uint64_t reserved = 0;
    if (h->magic != PORTABLE_MICROMAP_MAGIC)
        return corrupt(r, "body.magic", "this is no portable micromap");
    if (h->version != PORTABLE_MICROMAP_VERSION)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "body.version", "version %" PRIu32 ", known is %d",
                              h->version, PORTABLE_MICROMAP_VERSION);
    for (int i = 0; i < 3; i++)
        reserved |= h->reserved[i] | h->reserved_end[i];
    if (reserved != 0)
        return corrupt(r, "body.reserved", "not zero");
    if (h->body_size != r->body.size)
        return corrupt(r, "body.bodySize", "not what follows the header");
    if (h->triangle_count > PORTABLE_ID_MASK || h->index_count > PORTABLE_ID_MASK)
        return corrupt(r, "body.triangleCount", "does not fit into 29 bits");
    return BVHD_OK;
}

/* Checks that a section begins at or after *end and lies inside the body; then moves *end to its end. */
static bool take_section(const struct micromap_reader *r, uint64_t offset, uint64_t size, uint64_t *end)
{
    if (offset % 16 != 0 || offset < *end || offset > r->body.size || size > r->body.size - offset)
        return false;
    *end = offset + size;
    return true;
}

static enum bvhd_status check_sections(const struct micromap_reader *r)
{
    const struct portable_micromap_header *h = r->header;
    uint64_t end = sizeof *h;
    if (!take_section(r, h->triangle_offset, (uint64_t)h->triangle_count * sizeof(struct micromap_triangle), &end))
        return corrupt(r, "body.triangleOffset", "triangles are misplaced");
    if (!take_section(r, h->states_offset, h->states_size, &end))
        return corrupt(r, "body.statesOffset", "states are misplaced");
    if (!take_section(r, h->index_offset, (uint64_t)h->index_count * sizeof(uint32_t), &end))
        return corrupt(r, "body.indexOffset", "indices are misplaced");
    return BVHD_OK;
}

static bool triangle_is_sound(const struct micromap_triangle *triangle, uint64_t states_size)
{
    if (triangle->level > MICRO_LEVEL_MAX || (triangle->format != MICRO_2_STATE && triangle->format != MICRO_4_STATE))
        return false;
    return (uint64_t)triangle->offset + micro_triangle_bytes((enum micro_format)triangle->format, triangle->level) <=
           states_size;
}

static enum bvhd_status check_rows(const struct micromap_reader *r, const struct portable_micromap_view *view)
{
    for (uint32_t i = 0; i < r->header->triangle_count; i++)
        if (!triangle_is_sound(&view->triangles[i], r->header->states_size))
            return corrupt_at(r, "triangles", i, "its level, its format, or its states' place is out of range");
    for (uint32_t i = 0; i < r->header->index_count; i++)
        if (view->indices[i] >= r->header->triangle_count && view->indices[i] < MICROMAP_FULLY_UNKNOWN_OPAQUE)
            return corrupt_at(r, "indices", i, "there is no such triangle");
    return BVHD_OK;
}

enum bvhd_status portable_micromap_open(struct bytes blob, struct portable_micromap_view *ret_view,
                                        struct bvhd_error *error)
{
    struct micromap_reader r = {.error = error};
    assert((uintptr_t)blob.data % 16 == 0);
    enum bvhd_status status = find_body(&r, blob);
    if (status == BVHD_OK)
        status = check_header(&r);
    if (status == BVHD_OK)
        status = check_sections(&r);
    if (status != BVHD_OK)
        return status;
    const struct portable_micromap_view view = {
        .header = r.header,
        .triangles = (const struct micromap_triangle *)(const void *)(r.body.data + r.header->triangle_offset),
        .states = r.body.data + r.header->states_offset,
        .indices = (const uint32_t *)(const void *)(r.body.data + r.header->index_offset),
    };
    status = check_rows(&r, &view);
    if (status == BVHD_OK)
        *ret_view = view;
    return status;
}

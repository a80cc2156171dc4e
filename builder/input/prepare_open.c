/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/canonical_form.h"
#include "builder/input/input_kind.h"
#include "proto/base/kind.h"
#include "proto/base/request_limits.h"
#include "proto/base/place.h"
#include "builder/input/prepare.h"
#include "builder/input/triangle_micromap.h"
#include "builder/input/validate.h"

/* The flags of builds, and those that came with micromaps. */
enum { KNOWN_FLAGS = 0x83f, MICROMAP_FLAGS = 0x5c0 };

enum { KNOWN_GEOMETRY_FLAGS = GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT };

/* A block that is being checked. Its bytes do not change meanwhile, so each is checked once. */
struct block_reader {
    struct bytes block;
    struct memory *memory;
    struct bvhd_error *error;
    const struct form_header *header;
    const struct form_geometry *rows;
};

static bool all_zero(const void *data, uint64_t size)
{
    const unsigned char *bytes = data;
    unsigned char any = 0;
    for (uint64_t i = 0; i < size; i++)
        any |= bytes[i];
    return any == 0;
}

static enum bvhd_status check_header(const struct block_reader *reader)
{
    const struct form_header *header = reader->header;
    if (memcmp(header->magic, form_magic, sizeof form_magic) != 0)
        return form_corrupt(reader->error, "magic", "no canonical copy");
    if (header->version < CANONICAL_VERSION || header->version > CANONICAL_VERSION_MICROMAP)
        return bvhd_error_set(reader->error, BVHD_INCOMPATIBLE, "version", "version %u, known are %d to %d",
                              header->version, CANONICAL_VERSION, CANONICAL_VERSION_MICROMAP);
    if (header->size != reader->block.size)
        return form_corrupt(reader->error, "size", "not the number of bytes given");
    if (header->type != STRUCTURE_TOP && header->type != STRUCTURE_BOTTOM && header->type != STRUCTURE_MICROMAP)
        return form_corrupt(reader->error, "type", "neither top nor bottom level, nor a micromap");
    if (header->flags & ~(uint32_t)(KNOWN_FLAGS | MICROMAP_FLAGS) ||
        (header->flags & BUILD_PREFER_FAST_TRACE && header->flags & BUILD_PREFER_FAST_BUILD))
        return form_corrupt(reader->error, "flags", "flags that no build has");
    if (header->geometry_count > LIMIT_MAX_GEOMETRIES ||
        (header->type != STRUCTURE_BOTTOM && header->geometry_count != 1))
        return form_corrupt(reader->error, "geometryCount", "too many");
    if (header->primitive_count > (header->type == STRUCTURE_TOP ? LIMIT_MAX_INSTANCES : LIMIT_MAX_PRIMITIVES))
        return form_corrupt(reader->error, "primitiveCount", "too many");
    if (!all_zero(header->reserved, sizeof header->reserved))
        return form_corrupt(reader->error, "reserved", "not 0");
    return BVHD_OK;
}

static bool update_is_valid(const struct form_geometry *row, uint32_t flags)
{
    const struct input_kind *kind = input_kind_of(row->type);
    if (!(flags & BUILD_ALLOW_UPDATE) || !kind->update_is_sound)
        return row->update == 0 && row->vertex_format == 0 && row->max_vertex == 0 && row->index_type == 0 &&
               row->lowest_index == 0 && (form_may_have_micromap(row->type) || row->micromap_offset == 0);
    return kind->update_is_sound(row) &&
           (row->index_type == INDEX_NONE || row->index_type == INDEX_UINT16 || row->index_type == INDEX_UINT32);
}

/*
 * All geometries are of one kind, apart from whether they move. Those of bottom levels may move if the flag is there,
 * those of top levels then all do.
 */
static bool belongs_here(const struct block_reader *reader, const struct kind *kind)
{
    const bool is_top = reader->header->type == STRUCTURE_TOP, has_motion = reader->header->flags & BUILD_MOTION;
    return kind->is_top == is_top && kind->is_micromap == (reader->header->type == STRUCTURE_MICROMAP) &&
           kind->vulkan_type == kind_find(reader->rows[0].type)->vulkan_type &&
           (is_top ? kind->moves == has_motion : kind->moves <= has_motion);
}

static enum bvhd_status check_row(const struct block_reader *reader, uint32_t index)
{
    const struct form_geometry *row = &reader->rows[index];
    const struct kind *kind = kind_find(row->type);
    if (!kind || !belongs_here(reader, kind))
        return form_corrupt_row(reader->error, index, "type", "does not belong here");
    if (row->flags & ~(uint32_t)KNOWN_GEOMETRY_FLAGS)
        return form_corrupt_row(reader->error, index, "flags", "unknown bits");
    uint32_t corners = input_kind_of(row->type)->corners;
    bool has_vertices = corners > 0;
    if (row->indexed > (has_vertices && row->primitive_count > 0))
        return form_corrupt_row(reader->error, index, "indexed", "not 0");
    if (!has_vertices && row->index_offset != 0)
        return form_corrupt_row(reader->error, index, "indexOffset", "not 0");
    uint64_t vertices = (uint64_t)corners * row->primitive_count;
    if (row->indexed ? row->vertex_count == 0 : row->vertex_count != vertices)
        return form_corrupt_row(reader->error, index, "vertexCount", "does not fit the primitives");
    if (row->micromap_offset != 0 && !input_kind_of(row->type)->has_radii && !form_may_have_micromap(row->type))
        return form_corrupt_row(reader->error, index, "reserved", "not 0");
    if (!update_is_valid(row, reader->header->flags))
        return form_corrupt_row(reader->error, index, "update", "fields that no build has");
    return BVHD_OK;
}

static enum bvhd_status check_rows(const struct block_reader *reader)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t primitives = 0, vertices = 0;
    for (uint32_t i = 0; status == BVHD_OK && i < reader->header->geometry_count; i++) {
        status = check_row(reader, i);
        primitives += reader->rows[i].primitive_count;
        vertices += reader->rows[i].vertex_count;
    }
    if (status != BVHD_OK)
        return status;
    if (reader->header->version != form_version(reader->rows, reader->header->geometry_count, reader->header->flags))
        return form_corrupt(reader->error, "version", "not that of blocks with such geometries");
    if (primitives != reader->header->primitive_count)
        return form_corrupt(reader->error, "primitiveCount", "not the sum over the geometries");
    if (vertices != reader->header->vertex_count)
        return form_corrupt(reader->error, "vertexCount", "not the sum over the geometries");
    return BVHD_OK;
}

/* Checks that the array is where a writer would have put it, inside the block, with zeros up to the next section. */
static enum bvhd_status check_place(const struct block_reader *reader, uint32_t index, enum form_section section,
                                    uint64_t *at)
{
    struct form_geometry row = reader->rows[index];
    uint64_t *offset = form_offset(&row, section), given = offset ? *offset : 0, end;
    if (!form_place(&row, 1, section, *at, &end))
        return form_corrupt_row(reader->error, index, "primitiveCount", "over 2^64 bytes");
    if (end > reader->block.size)
        return form_corrupt_row(reader->error, index, "primitiveCount", "does not fit the block");
    if (offset && *offset != given)
        return form_corrupt_row(reader->error, index,
                                offset == &row.index_offset      ? "indexOffset"
                                : offset == &row.micromap_offset ? "micromapOffset"
                                                                 : "dataOffset",
                                "not where the counts put it");
    uint64_t used = *at + form_bytes(&row, section);
    if (!all_zero(reader->block.data + used, end - used))
        return form_corrupt_row(reader->error, index, "padding", "not 0");
    *at = end;
    return BVHD_OK;
}

static enum bvhd_status check_places(const struct block_reader *reader)
{
    const struct form_header *header = reader->header;
    uint64_t at = sizeof *header + (uint64_t)header->geometry_count * sizeof *reader->rows, end;
    enum bvhd_status status = BVHD_OK;
    for (int section = FORM_PRIMITIVES; section <= FORM_POSITIONS; section++)
        for (uint32_t i = 0; status == BVHD_OK && i < header->geometry_count; i++)
            status = check_place(reader, i, (enum form_section)section, &at);
    if (status != BVHD_OK)
        return status;
    uint64_t references = (uint64_t)header->reference_count * sizeof(struct form_reference);
    if (header->reference_offset != (references ? at : 0))
        return form_corrupt(reader->error, "referenceOffset", "not where the counts put it");
    if (!bytes_add(at, references, &end) || end != header->size)
        return form_corrupt(reader->error, "size", "not what the counts say");
    return BVHD_OK;
}

/* A micromap has nothing but a key and a number of triangles. */
static bool reference_is_sound(const struct form_reference *row, uint32_t type)
{
    const struct form_reference micromap = form_micromap_reference(&row->key, row->triangle_count);
    if (type != STRUCTURE_TOP)
        return memcmp(row, &micromap, sizeof micromap) == 0;
    return row->kind == REFERENCE_BLAS && row->triangle_count == 0 && form_bounds_valid(&row->bounds) &&
           form_slabs_valid(&row->slabs, &row->bounds);
}

static enum bvhd_status check_references(const struct block_reader *reader)
{
    const struct form_reference *rows = (const void *)(reader->block.data + reader->header->reference_offset);
    for (uint32_t i = 0; i < reader->header->reference_count; i++)
        if (!reference_is_sound(&rows[i], reader->header->type))
            return form_corrupt(reader->error, place("references[%u]", i).text,
                                "kind, bounds or slabs that no reference has");
    return BVHD_OK;
}

static enum bvhd_status check_contents(const struct block_reader *reader, const struct canonical *view)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < view->geometry_count; i++)
        status = input_kind_of(view->geometries[i].type)->check_foreign(view, i, reader->error);
    if (status == BVHD_OK && view->type != STRUCTURE_TOP)
        status = triangle_micromap_check_references(view, reader->error);
    return status == BVHD_OK ? validate_canonical(view, 0, NULL, reader->error) : status;
}

static enum bvhd_status make_view(const struct block_reader *reader, struct canonical *view)
{
    const struct form_header *header = reader->header;
    view->geometries = memory_array(reader->memory, header->geometry_count, sizeof *view->geometries);
    view->references = memory_array(reader->memory, header->reference_count, sizeof *view->references);
    if ((header->geometry_count > 0 && !view->geometries) || (header->reference_count > 0 && !view->references))
        return bvhd_error_no_memory(reader->error, "", "no memory for the tables of a canonical copy");
    form_view(reader->block.data, view);
    return check_contents(reader, view);
}

enum bvhd_status prepare_open(struct bytes block, struct memory *memory, struct canonical *ret_canonical,
                              struct bvhd_error *error)
{
    struct block_reader reader = {.block = block, .memory = memory, .error = error, .header = (const void *)block.data};
    struct canonical view = {0};
    if (block.size < sizeof *reader.header)
        return form_corrupt(error, "size", "shorter than a header");
    enum bvhd_status status = check_header(&reader);
    if (status == BVHD_OK &&
        !bytes_reach(block.size, sizeof *reader.header, sizeof *reader.rows, reader.header->geometry_count, 0))
        status = form_corrupt(error, "geometryCount", "does not fit the block");
    if (status != BVHD_OK)
        return status;

    reader.rows = (const void *)(block.data + sizeof *reader.header);
    status = check_rows(&reader);
    if (status == BVHD_OK)
        status = check_places(&reader);
    if (status == BVHD_OK)
        status = check_references(&reader);
    if (status == BVHD_OK)
        status = make_view(&reader, &view);
    if (status == BVHD_OK)
        *ret_canonical = view;
    else
        prepare_finish(&view, memory);
    return status;
}

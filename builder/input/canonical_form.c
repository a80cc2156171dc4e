/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/canonical_form.h"

#include <math.h>

#include "builder/input/input_kind.h"
#include "proto/base/kind.h"
#include "proto/base/place.h"

bool form_may_have_micromap(uint32_t type)
{
    return kind_find(type)->vulkan_type == GEOMETRY_TRIANGLES;
}

static bool has_micromap(const struct form_geometry *row)
{
    return row->micromap_offset != 0 && form_may_have_micromap(row->type);
}

struct form_reference form_micromap_reference(const struct key *key, uint32_t triangle_count)
{
    return (struct form_reference){
        .kind = REFERENCE_MICROMAP, .triangle_count = triangle_count, .key = *key, .bounds = box_empty()};
}

uint32_t form_version(const struct form_geometry *rows, uint32_t count, uint32_t flags)
{
    const uint32_t least = flags & BUILD_MOTION ? CANONICAL_VERSION_ROUND : CANONICAL_VERSION;
    for (uint32_t i = 0; i < count; i++)
        if (has_micromap(&rows[i]))
            return CANONICAL_VERSION_MICROMAP;
    return count > 0 && input_kind_of(rows[0].type)->version > least ? input_kind_of(rows[0].type)->version : least;
}

uint64_t form_bytes(const struct form_geometry *row, enum form_section section)
{
    const struct kind *kind = kind_find(row->type);
    if (section == FORM_POSITIONS)
        return (uint64_t)row->vertex_count * kind->vertex_bytes;
    if (section == FORM_MICROMAPS)
        return has_micromap(row) ? sizeof(struct form_micromap) + (uint64_t)row->primitive_count * sizeof(uint32_t) : 0;
    return kind->vertex_bytes > 0 && !row->indexed ? 0 : (uint64_t)row->primitive_count * kind->primitive_bytes;
}

uint64_t *form_offset(struct form_geometry *row, enum form_section section)
{
    bool has_vertices = input_kind_of(row->type)->corners > 0;
    if (section == FORM_POSITIONS)
        return has_vertices ? &row->data_offset : NULL;
    if (section == FORM_MICROMAPS)
        return form_may_have_micromap(row->type) ? &row->micromap_offset : NULL;
    return has_vertices ? &row->index_offset : &row->data_offset;
}

bool form_place(struct form_geometry *rows, uint32_t count, enum form_section section, uint64_t at, uint64_t *ret_end)
{
    for (uint32_t i = 0; i < count; i++) {
        uint64_t *offset = form_offset(&rows[i], section), size = form_bytes(&rows[i], section), end;
        if (!offset)
            continue;
        *offset = size ? at : 0;
        if (!bytes_add(at, size, &end) || !bytes_add(end, FORM_ALIGNMENT, &end))
            return false;
        at = bytes_align(end - FORM_ALIGNMENT, FORM_ALIGNMENT);
    }
    *ret_end = at;
    return true;
}

/* The states of whole triangles are final where instances cannot change what they mean, and nothing is updated. */
static void view_micromap(const unsigned char *block, const struct form_geometry *row, uint32_t flags,
                          struct canonical_geometry *geometry)
{
    const uint32_t changes = BUILD_ALLOW_MICROMAP_UPDATE | BUILD_ALLOW_DISABLE_MICROMAPS |
                             BUILD_ALLOW_MICROMAP_DATA_UPDATE | BUILD_ALLOW_UPDATE;
    const struct form_micromap *micromap = (const void *)(block + row->micromap_offset);
    geometry->has_micromaps = true;
    geometry->micromap = micromap->reference;
    geometry->micromap_indices = row->primitive_count > 0 ? (const void *)(micromap + 1) : NULL;
    geometry->resolves_micromaps = row->primitive_count > 0 && !(flags & changes);
}

static struct canonical_geometry geometry_view(const unsigned char *block, const struct form_geometry *row,
                                               uint32_t flags)
{
    struct canonical_geometry geometry = {
        .type = row->type,
        .flags = row->flags,
        .primitive_count = row->primitive_count,
        .vertex_count = row->vertex_count,
    };
    if (row->indexed)
        geometry.indices = (const void *)(block + row->index_offset);
    input_kind_of(row->type)->view(row->data_offset ? block + row->data_offset : NULL, &geometry);
    if (has_micromap(row))
        view_micromap(block, row, flags, &geometry);
    return geometry;
}

static void view_references(const unsigned char *block, const struct form_header *header, struct canonical *view)
{
    const struct form_reference *rows = (const void *)(block + header->reference_offset);
    for (uint32_t i = 0; i < header->reference_count; i++)
        view->references[i] = (struct canonical_reference){rows[i].kind, rows[i].triangle_count, rows[i].key,
                                                           rows[i].bounds, rows[i].slabs};
}

void form_view(const unsigned char *block, struct canonical *view)
{
    const struct form_header *header = (const void *)block;
    const struct form_geometry *rows = (const void *)(block + sizeof *header);
    uint32_t primitives = 0, vertices = 0;

    view->bytes = block;
    view->size = header->size;
    view->type = header->type;
    view->flags = header->flags;
    view->geometry_count = header->geometry_count;
    view->reference_count = header->reference_count;
    view->primitive_count = header->primitive_count;
    view->vertex_count = header->vertex_count;
    for (uint32_t i = 0; i < header->geometry_count; i++) {
        view->geometries[i] = geometry_view(block, &rows[i], header->flags);
        view->geometries[i].first_primitive = primitives;
        view->geometries[i].first_vertex = vertices;
        primitives += rows[i].primitive_count;
        vertices += rows[i].vertex_count;
    }
    view_references(block, header, view);
}

bool form_bounds_valid(const struct box *bounds)
{
    struct box empty = box_empty();
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(bounds->min[axis]) || !isfinite(bounds->max[axis]))
            return false;
    return !box_is_empty(bounds) || memcmp(bounds, &empty, sizeof empty) == 0;
}

bool form_slabs_valid(const struct slabs *slabs, const struct box *bounds)
{
    static const struct slabs none;
    if (!slabs_are_known(slabs))
        return memcmp(slabs, &none, sizeof none) == 0;
    return slabs_are_valid(slabs) && !box_is_empty(bounds);
}

enum bvhd_status form_corrupt(struct bvhd_error *error, const char *where, const char *text)
{
    return bvhd_error_set(error, BVHD_CORRUPT, where, "%s", text);
}

enum bvhd_status form_corrupt_row(struct bvhd_error *error, uint32_t row, const char *field, const char *text)
{
    return form_corrupt(error, place("geometries[%u].%s", row, field).text, text);
}

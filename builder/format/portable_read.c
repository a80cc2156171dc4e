/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

#include "builder/format/record_kind.h"
#include "builder/format/serialized.h"
#include "proto/base/kind.h"
#include "proto/base/prefix.h"

struct portable_reader {
    uint32_t version; /* that the compatibility UUID names */
    uint64_t micromap_count; /* addresses in the serialized header */
    struct bytes body;
    struct portable_view view;
    const struct record_kind *kind; /* of the header's content */
    uint8_t *levels; /* of each node, 1 for the root; 0 until a parent refers to it */
    struct bvhd_error *error;
};

static enum bvhd_status corrupt_at(const struct portable_reader *r, const char *section, uint32_t row,
                                   const char *field, const char *reason)
{
    char where[64];
    snprintf(where, sizeof where, "%s[%" PRIu32 "]%s%s", section, row, *field ? "." : "", field);
    return bvhd_error_set(r->error, BVHD_CORRUPT, where, "%s", reason);
}

static enum bvhd_status corrupt(const struct portable_reader *r, const char *where, const char *reason)
{
    return bvhd_error_set(r->error, BVHD_CORRUPT, where, "%s", reason);
}

/* Checks whether the header is one of this layout, and finds the kind of its records. */
static enum bvhd_status check_content(struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    if (h->magic != PORTABLE_MAGIC)
        return corrupt(r, "body.magic", "this is no portable structure");
    if (h->version == 0 || h->version > PORTABLE_NEWEST)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "body.version", "version %" PRIu32 ", known are 1 to %d",
                              h->version, PORTABLE_NEWEST);
    if (h->version != r->version)
        return corrupt(r, "body.version", "not that of the compatibility UUID");
    r->kind = record_kind_of(h->content);
    if (!r->kind)
        return corrupt(r, "body.content", "unknown content");
    if (h->version == PORTABLE_MICROMAP_VERSION)
        return kind_find(r->kind->type)->vulkan_type == GEOMETRY_TRIANGLES
                   ? BVHD_OK
                   : corrupt(r, "body.content", "not one that has micromaps");
    return r->kind->version == h->version ? BVHD_OK : corrupt(r, "body.content", "not one of this version");
}

static enum bvhd_status check_micromap_counts(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    if (h->micromap_count != r->micromap_count)
        return corrupt(r, "body.micromapCount", "not the number of addresses in the header");
    if (h->version < PORTABLE_MICROMAP_VERSION)
        return h->micromap_offset == 0 && h->micromap_index_count == 0
                   ? BVHD_OK
                   : corrupt(r, "body.micromapOffset", "this version has no micromaps");
    return h->micromap_index_count == h->primitive_count
               ? BVHD_OK
               : corrupt(r, "body.micromapIndexCount", "not the number of primitives");
}

/* Checks the header's other fields that can be judged by themselves. */
static enum bvhd_status check_counts(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    const bool is_top = record_kind_is_top(h->content);
    if (h->primitive_count > PORTABLE_ID_MASK)
        return corrupt(r, "body.primitiveCount", "does not fit into 29 bits");
    if (h->depth > PORTABLE_MAX_DEPTH || (h->depth == 0) != (h->node_count == 0))
        return corrupt(r, "body.depth", "too deep, or a depth that does not fit the number of nodes");
    if ((h->record_count == 0) != (h->node_count == 0))
        return corrupt(r, "body.recordCount", "records without nodes, or nodes without records");
    if (h->vertex_count != 0 && r->kind->vertex_size == 0)
        return corrupt(r, "body.vertexCount", "this content has no vertices");
    if (h->vertex_count != 0 && h->record_count == 0)
        return corrupt(r, "body.vertexCount", "vertices without records");
    if (h->geometry_count != 0 && is_top)
        return corrupt(r, "body.geometryCount", "a top level has no geometries");
    if (r->view.handle_count != 0 && !is_top)
        return corrupt(r, "header.handleCount", "a bottom level has no handles");
    if (h->reserved[0] != 0 || h->reserved[1] != 0)
        return corrupt(r, "body.reserved", "not zero");
    return check_micromap_counts(r);
}

static enum bvhd_status check_bounds(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    for (int axis = 0; axis < 3 && h->node_count > 0; axis++)
        if (!(h->bounds[axis] <= h->bounds[3 + axis]) || !isfinite(h->bounds[axis]) || !isfinite(h->bounds[3 + axis]))
            return corrupt(r, "body.bounds", "not a finite box");
    if (h->node_count == 0 && !(h->bounds[0] > h->bounds[3]))
        return corrupt(r, "body.bounds", "nothing has bounds");
    return BVHD_OK;
}

/*
 * Checks that the section [offset, offset + count * size) begins at or after *end and lies inside the body; then moves
 * *end to its end.
 */
static bool take_section(const struct portable_reader *r, uint64_t offset, uint32_t count, uint32_t size, uint64_t *end)
{
    if (offset % 16 != 0 || offset < *end || offset > r->body.size || (uint64_t)count * size > r->body.size - offset)
        return false;
    *end = offset + (uint64_t)count * size;
    return true;
}

/* Finds the section of micromaps and indices behind the geometries, and checks each micromap. */
static enum bvhd_status find_micromaps(struct portable_reader *r, uint64_t end)
{
    const struct portable_header *h = r->view.header;
    const uint64_t indices = h->micromap_offset + (uint64_t)h->micromap_count * sizeof *r->view.micromaps;
    if (!take_section(r, h->micromap_offset, h->micromap_count, sizeof *r->view.micromaps, &end) ||
        !take_section(r, indices, h->micromap_index_count, sizeof *r->view.micromap_indices, &end))
        return corrupt(r, "body.micromapOffset", "micromaps are misplaced");
    r->view.micromaps = (const struct portable_micromap *)(const void *)(r->body.data + h->micromap_offset);
    r->view.micromap_indices = (const uint32_t *)(const void *)(r->body.data + indices);
    for (uint32_t i = 0; i < h->micromap_count; i++)
        if (r->view.micromaps[i].handle != i || r->view.micromaps[i].location[0] != 0 ||
            r->view.micromaps[i].location[1] != 0)
            return corrupt_at(r, "micromaps", i, "", "not the address in its row, or on a device");
    return BVHD_OK;
}

static enum bvhd_status find_sections(struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    uint64_t end = sizeof *h;
    if (h->body_size != r->body.size)
        return corrupt(r, "body.bodySize", "not what follows the header");
    if (h->node_count > PORTABLE_MAX_ROWS || h->record_count > PORTABLE_MAX_ROWS)
        return corrupt(r, "body.nodeCount", "more nodes or records than 2^30");
    if (h->node_offset % 64 != 0 || !take_section(r, h->node_offset, h->node_count, r->kind->node_size, &end))
        return corrupt(r, "body.nodeOffset", "nodes are misplaced");
    if (!take_section(r, h->record_offset, h->record_count, r->kind->size, &end))
        return corrupt(r, "body.recordOffset", "records are misplaced");
    if (!take_section(r, h->vertex_offset, h->vertex_count, r->kind->vertex_size, &end))
        return corrupt(r, "body.vertexOffset", "vertices are misplaced");
    if (!take_section(r, h->geometry_offset, h->geometry_count, sizeof(struct portable_geometry), &end))
        return corrupt(r, "body.geometryOffset", "geometries are misplaced");
    r->view.nodes = (const struct portable_node *)(const void *)(r->body.data + h->node_offset);
    r->view.node_size = r->kind->node_size;
    r->view.records = r->body.data + h->record_offset;
    r->view.vertices = (const float *)(const void *)(r->body.data + h->vertex_offset);
    r->view.geometries = (const struct portable_geometry *)(const void *)(r->body.data + h->geometry_offset);
    return h->version < PORTABLE_MICROMAP_VERSION ? BVHD_OK : find_micromaps(r, end);
}

static enum bvhd_status check_geometries(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    uint32_t sum = 0;
    for (uint32_t i = 0; i < h->geometry_count; i++) {
        const struct portable_geometry *geometry = &r->view.geometries[i];
        if (geometry->first_primitive != sum)
            return corrupt_at(r, "geometries", i, "firstPrimitive", "not the sum of those before");
        if (geometry->primitive_count > h->primitive_count - sum)
            return corrupt_at(r, "geometries", i, "primitiveCount", "more than there are in all");
        if (geometry->micromap > h->micromap_count &&
            !(geometry->micromap == PORTABLE_NO_MICROMAP && h->version == PORTABLE_MICROMAP_VERSION))
            return corrupt_at(r, "geometries", i, "micromap", "there is no such micromap");
        sum += geometry->primitive_count;
    }
    if (!record_kind_is_top(h->content) && sum != h->primitive_count)
        return corrupt(r, "body.primitiveCount", "not the sum over the geometries");
    return BVHD_OK;
}

/*
 * Checks that every byte of `lo` is at most that of `hi` in slots whose bit is set, and that the others are 255 and 0.
 */
static bool sides_are_sound(const uint8_t lo[3][8], const uint8_t hi[3][8], unsigned occupied)
{
    for (int axis = 0; axis < 3; axis++) {
        unsigned inverted = 0, cleared = 0;
        for (unsigned slot = 0; slot < 8; slot++) {
            inverted |= (unsigned)(lo[axis][slot] > hi[axis][slot]) << slot;
            cleared |= (unsigned)(lo[axis][slot] == 255 && hi[axis][slot] == 0) << slot;
        }
        if (inverted != (~occupied & 0xff) || cleared != (~occupied & 0xff))
            return false;
    }
    return true;
}

/* Checks the grid and the boxes of a node, at t = 1 as at t = 0. */
static bool boxes_are_sound(const struct portable_reader *r, const struct portable_node *node, unsigned occupied)
{
    const struct portable_moving_node *moving = (const struct portable_moving_node *)(const void *)node;
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(node->origin[axis]) || node->exponent[axis] == 255)
            return false;
    return sides_are_sound(node->lo, node->hi, occupied) &&
           (!record_kind_moves(r->kind) || sides_are_sound(moving->end_lo, moving->end_hi, occupied));
}

/* Checks that each inner child has exactly one parent, which precedes it. */
static enum bvhd_status claim_children(const struct portable_reader *r, uint32_t i, unsigned count)
{
    const struct portable_header *h = r->view.header;
    uint32_t first = portable_node_at(&r->view, i)->first_child;
    if (first <= i || first >= h->node_count || count > h->node_count - first)
        return corrupt_at(r, "nodes", i, "firstChild", "children do not follow their parent");
    if (r->levels[i] == h->depth)
        return corrupt_at(r, "nodes", i, "firstChild", "deeper than the header says");
    for (unsigned k = 0; k < count; k++) {
        if (r->levels[first + k] != 0)
            return corrupt_at(r, "nodes", i, "firstChild", "a child has two parents");
        r->levels[first + k] = (uint8_t)(r->levels[i] + 1);
    }
    return BVHD_OK;
}

/* Checks a node and adds the number of its records to *records. Records are stored in the order of nodes and slots. */
static enum bvhd_status check_node(const struct portable_reader *r, uint32_t i, uint32_t *records)
{
    const struct portable_node *node = portable_node_at(&r->view, i);
    unsigned occupied = 0, inner = 0, leaf_records = 0;
    if (r->levels[i] == 0)
        return corrupt_at(r, "nodes", i, "", "has no parent");
    for (unsigned slot = 0; slot < 8; slot++) {
        unsigned meta = node->meta[slot], unary = meta >> 5;
        if (meta == 0)
            continue;
        occupied |= 1u << slot;
        if (meta == (0x20 | (24 + slot))) {
            inner |= 1u << slot;
            continue;
        }
        if ((unary != 1 && unary != 3 && unary != 7) || (meta & 31) != leaf_records)
            return corrupt_at(r, "nodes", i, "meta", "neither an inner child nor the next leaf");
        leaf_records += (unsigned)__builtin_popcount(unary);
    }
    if (occupied == 0 || inner != node->inner_mask)
        return corrupt_at(r, "nodes", i, "innerMask", "does not fit to the children");
    if (node->first_record != *records || leaf_records > r->view.header->record_count - *records)
        return corrupt_at(r, "nodes", i, "firstRecord", "records are not in order");
    if (!boxes_are_sound(r, node, occupied))
        return corrupt_at(r, "nodes", i, "boxes", "not finite, inverted, or in an empty slot");
    *records += leaf_records;
    if (inner == 0)
        return node->first_child == 0 ? BVHD_OK : corrupt_at(r, "nodes", i, "firstChild", "there are no children");
    return claim_children(r, i, (unsigned)__builtin_popcount(inner));
}

static enum bvhd_status check_nodes(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    uint32_t records = 0;
    uint8_t depth = 0;
    for (uint32_t i = 0; i < h->node_count; i++) {
        enum bvhd_status status = check_node(r, i, &records);
        if (status != BVHD_OK)
            return status;
        depth = r->levels[i] > depth ? r->levels[i] : depth;
    }
    if (records != h->record_count)
        return corrupt(r, "body.recordCount", "not what the nodes hold");
    if (depth != h->depth)
        return corrupt(r, "body.depth", "not the depth of the nodes");
    return BVHD_OK;
}

static enum bvhd_status check_records(const struct portable_reader *r)
{
    const struct portable_header *h = r->view.header;
    const uint32_t record = r->kind->find_unsound(&r->view);
    if (record < h->record_count)
        return corrupt_at(r, "records", record, "", "an id, an index, a box or a reserved field is out of range");
    const uint32_t vertex = r->kind->find_unsound_vertex ? r->kind->find_unsound_vertex(&r->view) : h->vertex_count;
    if (vertex < h->vertex_count)
        return corrupt_at(r, "vertices", vertex, "", "a coordinate is not finite, or the radius is negative");
    return BVHD_OK;
}

/* Finds the body behind a header that names this layout. */
static enum bvhd_status find_body(struct portable_reader *r, struct bytes blob)
{
    struct serialized_header header;
    enum bvhd_status status = serialized_read(blob, &header, r->error);
    if (status != BVHD_OK)
        return status;
    if (memcmp(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid) != 0)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "header.driverUUID", "written for another driver");
    r->version = portable_version_of(header.compatibility_uuid);
    if (r->version == 0)
        return bvhd_error_set(r->error, BVHD_INCOMPATIBLE, "header.compatibilityUUID", "written by another version");
    uint64_t offset = portable_body_of(&header);
    if (offset > blob.size || blob.size - offset < sizeof(struct portable_header))
        return corrupt(r, "body", "too short");
    if (header.deserialized_size != blob.size - offset)
        return corrupt(r, "header.deserializedSize", "not the size of the body");
    r->body = (struct bytes){blob.data + offset, blob.size - offset};
    r->view.header = (const struct portable_header *)(const void *)r->body.data;
    r->view.handles = blob.data + SERIALIZED_HANDLES;
    r->view.handle_count = header.handle_count;
    r->micromap_count = header.micromap_count;
    return BVHD_OK;
}

static enum bvhd_status check_tree(struct portable_reader *r, struct memory *memory)
{
    uint32_t count = r->view.header->node_count;
    if (count == 0)
        return BVHD_OK;
    r->levels = memory_alloc(memory, count);
    if (!r->levels)
        return bvhd_error_no_memory(r->error, "nodes", "no memory for the levels of %" PRIu32 " nodes", count);
    memset(r->levels, 0, count);
    r->levels[0] = 1;
    enum bvhd_status status = check_nodes(r);
    memory_free(memory, r->levels);
    return status;
}

static enum bvhd_status open_sections(struct portable_reader *r, struct bytes blob)
{
    assert((uintptr_t)blob.data % 16 == 0);
    enum bvhd_status status = find_body(r, blob);
    if (status == BVHD_OK)
        status = check_content(r);
    if (status == BVHD_OK)
        status = check_counts(r);
    if (status == BVHD_OK)
        status = check_bounds(r);
    if (status == BVHD_OK)
        status = find_sections(r);
    return status == BVHD_OK ? check_geometries(r) : status;
}

enum bvhd_status portable_open_sections(struct bytes blob, struct portable_view *ret_view, struct bvhd_error *error)
{
    struct portable_reader r = {.error = error};
    enum bvhd_status status = open_sections(&r, blob);
    if (status == BVHD_OK)
        *ret_view = r.view;
    return status;
}

enum bvhd_status portable_open(struct bytes blob, struct memory *memory, struct portable_view *ret_view,
                               struct bvhd_error *error)
{
    struct portable_reader r = {.error = error};
    enum bvhd_status status = open_sections(&r, blob);
    if (status == BVHD_OK)
        status = check_tree(&r, memory);
    if (status == BVHD_OK)
        status = check_records(&r);
    if (status == BVHD_OK)
        *ret_view = r.view;
    return status;
}

uint32_t portable_geometry_of(const struct portable_view *view, uint32_t id)
{
    return prefix_find(&view->geometries[0].first_primitive, sizeof view->geometries[0], view->header->geometry_count,
                       id);
}

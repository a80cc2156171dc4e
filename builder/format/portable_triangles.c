/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_triangles.c - the records of triangles: indexed ones over vertices, ones that hold their corners, and
 * indexed ones over vertices that move.
 */
#include "builder/format/portable_records.h"

/*
 * The fields of a triangle geometry that the loops need. They are a copy, because the compiler must assume that stores
 * of bytes change the original.
 */
struct corners {
    const uint32_t *indices;
    uint32_t first_primitive, primitive_count, first_vertex;
};

static struct corners corners_of(const struct canonical_geometry *geometry)
{
    return (struct corners){geometry->indices, geometry->first_primitive, geometry->primitive_count,
                            geometry->first_vertex};
}

static inline bool is_inside(const struct corners *corners, uint32_t primitive)
{
    /* wraps around for primitives below the first one */
    return primitive - corners->first_primitive < corners->primitive_count;
}

struct vertices {
    uint32_t a, b, c;
};

/* Returns a triangle's vertices in the numbering over all geometries. */
static inline struct vertices vertices_of(const struct corners *corners, uint32_t primitive)
{
    uint64_t corner = (uint64_t)3 * (primitive - corners->first_primitive);
    uint32_t first = corners->first_vertex;
    if (!corners->indices)
        return (struct vertices){first + (uint32_t)corner, first + (uint32_t)corner + 1, first + (uint32_t)corner + 2};
    const uint32_t *indices = corners->indices + corner;
    return (struct vertices){first + indices[0], first + indices[1], first + indices[2]};
}

/*
 * Each record is stored as two halves: a struct that is filled in pieces and copied as a whole would stall on store
 * forwarding.
 */
static void write_indexed_triangles(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                                    unsigned char *record)
{
    const struct canonical_geometry *geometry = writer->canonical->geometries;
    const uint32_t *remap = writer->remap;
    struct corners corners = corners_of(geometry);
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_indexed_triangle)) {
        if (!is_inside(&corners, refs[i])) {
            geometry = &writer->canonical->geometries[canonical_geometry_of(writer->canonical, refs[i])];
            corners = corners_of(geometry);
        }
        struct vertices v = vertices_of(&corners, refs[i]);
        if (remap)
            v = (struct vertices){remap[v.a], remap[v.b], remap[v.c]};
        bytes_put64(record, v.a | (uint64_t)v.b << 32);
        bytes_put64(record + 8, v.c | (uint64_t)portable_records_id(geometry, refs[i]) << 32);
    }
}

static void write_triangle(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    float corners[3][3];
    canonical_triangle(geometry, primitive - geometry->first_primitive, corners);
    struct portable_triangle triangle = {.id = portable_records_id(geometry, primitive)};
    memcpy(triangle.v0, corners[0], sizeof triangle.v0);
    memcpy(triangle.v1, corners[1], sizeof triangle.v1);
    memcpy(triangle.v2, corners[2], sizeof triangle.v2);
    memcpy(record, &triangle, sizeof triangle);
}

static void write_triangles(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                            unsigned char *record)
{
    const struct canonical_geometry *geometry = writer->canonical->geometries;
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_triangle)) {
        geometry = portable_records_geometry(writer, geometry, refs[i]);
        write_triangle(geometry, refs[i], record);
    }
}

static void prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count)
{
    const struct corners corners = corners_of(writer->canonical->geometries);
    if (!corners.indices)
        return;
    for (uint32_t i = 0; i < count; i++)
        if (is_inside(&corners, refs[i]))
            __builtin_prefetch(corners.indices + (uint64_t)3 * (refs[i] - corners.first_primitive));
}

static void mark(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used)
{
    enum { AHEAD = 16 };
    struct corners corners = corners_of(canonical->geometries);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t later = refs[count - i > AHEAD ? i + AHEAD : i];
        if (!is_inside(&corners, refs[i]))
            corners = corners_of(&canonical->geometries[canonical_geometry_of(canonical, refs[i])]);
        if (corners.indices && is_inside(&corners, later))
            __builtin_prefetch(corners.indices + (uint64_t)3 * (later - corners.first_primitive));
        struct vertices v = vertices_of(&corners, refs[i]);
        __atomic_store_n(&used[v.a], 1, __ATOMIC_RELAXED);
        __atomic_store_n(&used[v.b], 1, __ATOMIC_RELAXED);
        __atomic_store_n(&used[v.c], 1, __ATOMIC_RELAXED);
    }
}

static void mark_range(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, uint8_t *used)
{
    const struct corners corners = corners_of(geometry);
    const uint64_t begin = (uint64_t)3 * first;
    uint8_t *own = used + corners.first_vertex;
    for (uint64_t i = begin; i < begin + (uint64_t)3 * count; i++)
        __atomic_store_n(&own[corners.indices ? corners.indices[i] : i], 1, __ATOMIC_RELAXED);
}

static float *copy_vertices(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                            const uint8_t *used, float *to)
{
    return portable_records_copy(geometry->positions + (size_t)3 * first, 3, count, used, to);
}

/* The vertices of static triangles beside motion triangles end where they start. */
static float *copy_moving_vertices(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                   const uint8_t *used, float *to)
{
    const size_t skipped = (size_t)3 * first;
    const float *start = geometry->positions + skipped,
                *end = (geometry->end_positions ? geometry->end_positions : geometry->positions) + skipped;
    for (uint32_t i = 0; i < count; i++, start += 3, end += 3)
        if (!used || used[i]) {
            memcpy(to, start, 3 * sizeof *to);
            memcpy(to + 3, end, 3 * sizeof *to);
            to += 6;
        }
    return to;
}

/* No more vertices can be in use than there are corners, or numbers. */
static uint64_t vertices_most(const struct geometry *geometry)
{
    const uint64_t corners = (uint64_t)3 * geometry->range.primitive_count,
                   numbers = (uint64_t)geometry->triangles.max_vertex + 1;
    return geometry->triangles.index_type == INDEX_NONE || corners < numbers ? corners : numbers;
}

static uint32_t find_unsound_indexed(const struct portable_view *view)
{
    const struct portable_header *header = view->header;
    const struct portable_indexed_triangle *triangles = view->records;
    const uint32_t flags = portable_records_triangle_flags(header);
    for (uint32_t i = 0; i < header->record_count; i++) {
        const uint32_t *v = triangles[i].vertices;
        if (v[0] >= header->vertex_count || v[1] >= header->vertex_count || v[2] >= header->vertex_count ||
            !portable_records_id_is_sound(header, triangles[i].id, flags) ||
            !portable_records_micromap_is_sound(view, triangles[i].id))
            return i;
    }
    return header->record_count;
}

static uint32_t find_unsound(const struct portable_view *view)
{
    const struct portable_header *header = view->header;
    const struct portable_triangle *triangles = view->records;
    const uint32_t flags = portable_records_triangle_flags(header);
    for (uint32_t i = 0; i < header->record_count; i++)
        if (!portable_records_id_is_sound(header, triangles[i].id, flags) || triangles[i].reserved1 != 0 ||
            triangles[i].reserved2 != 0 || !portable_records_micromap_is_sound(view, triangles[i].id))
            return i;
    return header->record_count;
}

const struct record_kind record_indexed_triangles = {
    .version = 1,
    .type = GEOMETRY_TRIANGLES,
    .size = sizeof(struct portable_indexed_triangle),
    .vertex_size = 3 * sizeof(float),
    .node_size = sizeof(struct portable_node),
    .first_leaf = PORTABLE_LEAF_MAX,
    .cost = 0.3f,
    .vertices_most = vertices_most,
    .write = write_indexed_triangles,
    .prefetch = prefetch,
    .mark = mark,
    .mark_range = mark_range,
    .copy_vertices = copy_vertices,
    .find_unsound = find_unsound_indexed,
};

const struct record_kind record_triangles = {
    .version = 1,
    .type = GEOMETRY_TRIANGLES,
    .layout_flag = PORTABLE_FAST_TRIANGLES,
    .size = sizeof(struct portable_triangle),
    .node_size = sizeof(struct portable_node),
    .first_leaf = PORTABLE_LEAF_MAX,
    .cost = 0.3f,
    .write = write_triangles,
    .prefetch = prefetch,
    .find_unsound = find_unsound,
};

const struct record_kind record_moving_triangles = {
    .version = 2,
    .type = GEOMETRY_MOVING_TRIANGLES,
    .size = sizeof(struct portable_indexed_triangle),
    .vertex_size = sizeof(struct portable_moving_vertex),
    .node_size = sizeof(struct portable_moving_node),
    .first_leaf = PORTABLE_LEAF_MAX,
    .cost = 0.3f,
    .vertices_most = vertices_most,
    .write = write_indexed_triangles,
    .prefetch = prefetch,
    .mark = mark,
    .mark_range = mark_range,
    .copy_vertices = copy_moving_vertices,
    .find_unsound = find_unsound_indexed,
};

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_records.h"

#include <assert.h>
#include <float.h>
#include <math.h>

uint32_t portable_record_size(enum portable_content content)
{
    static const uint8_t sizes[] = {
        [PORTABLE_INDEXED_TRIANGLES] = sizeof(struct portable_indexed_triangle),
        [PORTABLE_TRIANGLES] = sizeof(struct portable_triangle),
        [PORTABLE_AABBS] = sizeof(struct portable_aabb),
        [PORTABLE_INSTANCES] = sizeof(struct portable_instance),
    };
    return sizes[content];
}

static uint32_t id_of(const struct canonical_geometry *geometry, uint32_t primitive)
{
    return primitive | (geometry->flags & GEOMETRY_OPAQUE ? PORTABLE_ID_OPAQUE : 0);
}

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
        bytes_put64(record + 8, v.c | (uint64_t)id_of(geometry, refs[i]) << 32);
    }
}

static bool lies_in(const struct canonical_geometry *geometry, uint32_t primitive)
{
    /* wraps around for primitives below the first one */
    return primitive - geometry->first_primitive < geometry->primitive_count;
}

static void write_triangle(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    float corners[3][3];
    canonical_triangle(geometry, primitive - geometry->first_primitive, corners);
    struct portable_triangle triangle = {.id = id_of(geometry, primitive)};
    memcpy(triangle.v0, corners[0], sizeof triangle.v0);
    memcpy(triangle.v1, corners[1], sizeof triangle.v1);
    memcpy(triangle.v2, corners[2], sizeof triangle.v2);
    memcpy(record, &triangle, sizeof triangle);
}

static void write_aabb(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    const float *box = geometry->boxes + (uint64_t)6 * (primitive - geometry->first_primitive);
    struct portable_aabb aabb = {.id = id_of(geometry, primitive)};
    memcpy(aabb.min, box, sizeof aabb.min);
    memcpy(aabb.max, box + 3, sizeof aabb.max);
    memcpy(record, &aabb, sizeof aabb);
}

static void write_instance(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    const unsigned char *source = geometry->instances + (uint64_t)64 * primitive;
    uint64_t reference = bytes_get64(source + 56);
    assert(reference != 0); /* no tree contains inactive instances */
    struct portable_instance instance = {
        .custom_and_mask = bytes_get32(source + 48),
        .sbt_and_flags = bytes_get32(source + 52),
        .instance = primitive,
        .handle = (uint32_t)(reference - 1),
    };
    memcpy(instance.object_to_world, source, sizeof instance.object_to_world);
    portable_invert(instance.object_to_world, instance.world_to_object);
    memcpy(record, &instance, sizeof instance);
}

void portable_records_write(const struct portable_records *writer, uint32_t first, const uint32_t *refs, uint32_t count)
{
    const struct canonical *canonical = writer->canonical;
    const struct canonical_geometry *geometry = canonical->geometries;
    uint32_t size = portable_record_size(writer->content);
    unsigned char *record = writer->records + (uint64_t)first * size;
    if (writer->content == PORTABLE_INDEXED_TRIANGLES) {
        write_indexed_triangles(writer, refs, count, record);
        return;
    }
    for (uint32_t i = 0; i < count; i++, record += size) {
        if (!lies_in(geometry, refs[i]))
            geometry = &canonical->geometries[canonical_geometry_of(canonical, refs[i])];
        if (writer->content == PORTABLE_TRIANGLES)
            write_triangle(geometry, refs[i], record);
        else if (writer->content == PORTABLE_AABBS)
            write_aabb(geometry, refs[i], record);
        else
            write_instance(geometry, refs[i], record);
    }
}

void portable_records_mark(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used)
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

/* Marks the vertices of a range of one geometry's triangles. */
static void mark_triangles(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, uint8_t *used)
{
    const struct corners corners = corners_of(geometry);
    const uint64_t begin = (uint64_t)3 * (first - corners.first_primitive);
    uint8_t *own = used + corners.first_vertex;
    for (uint64_t i = begin; i < begin + (uint64_t)3 * count; i++)
        __atomic_store_n(&own[corners.indices ? corners.indices[i] : i], 1, __ATOMIC_RELAXED);
}

void portable_records_mark_range(const struct canonical *canonical, uint32_t first, uint32_t count, uint8_t *used)
{
    while (count > 0) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, first)];
        uint32_t left = geometry->primitive_count - (first - geometry->first_primitive),
                 here = count < left ? count : left;
        mark_triangles(geometry, first, here, used);
        first += here;
        count -= here;
    }
}

void portable_records_prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count)
{
    const struct canonical_geometry *geometry = writer->canonical->geometries;
    if (geometry->type != GEOMETRY_TRIANGLES || !geometry->indices)
        return;
    const struct corners corners = corners_of(geometry);
    for (uint32_t i = 0; i < count; i++)
        if (is_inside(&corners, refs[i]))
            __builtin_prefetch(corners.indices + (uint64_t)3 * (refs[i] - corners.first_primitive));
}

static double minor(const float m[12], int row, int column)
{
    static const int others[3][2] = {{1, 2}, {2, 0}, {0, 1}};
    const int *r = others[row], *c = others[column];
    return (double)m[4 * r[0] + c[0]] * m[4 * r[1] + c[1]] - (double)m[4 * r[0] + c[1]] * m[4 * r[1] + c[0]];
}

void portable_invert(const float matrix[12], float ret_inverse[12])
{
    double cofactors[3][3];
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            cofactors[row][column] = minor(matrix, row, column);
    double determinant = matrix[0] * cofactors[0][0] + matrix[1] * cofactors[0][1] + matrix[2] * cofactors[0][2];
    bool finite = determinant < 0 || determinant > 0;
    for (int row = 0; row < 3 && finite; row++) {
        double move = 0;
        for (int column = 0; column < 3; column++) {
            double entry = cofactors[column][row] / determinant;
            move -= entry * matrix[4 * column + 3];
            finite = finite && fabs(entry) <= FLT_MAX;
            ret_inverse[4 * row + column] = (float)entry;
        }
        finite = finite && fabs(move) <= FLT_MAX;
        ret_inverse[4 * row + 3] = (float)move;
    }
    if (!finite)
        memset(ret_inverse, 0, 12 * sizeof *ret_inverse);
}

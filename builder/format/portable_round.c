/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_round.c - the records of spheres and of linear swept spheres, over vertices with radii.
 *
 * Vertices keep the order of the request. Dropping those that are not used leaves the two ends of a linear swept sphere
 * beside each other, because both are used, and the primitives of a chain go on sharing their ends.
 */
#include <math.h>

#include "builder/format/portable_records.h"

_Static_assert(CANONICAL_CAP_FIRST >> 1 == PORTABLE_ID_CAP_FIRST && CANONICAL_CAP_SECOND >> 1 == PORTABLE_ID_CAP_SECOND,
               "the flags of an end are moved by one bit");

#define CAPS (PORTABLE_ID_CAP_FIRST | PORTABLE_ID_CAP_SECOND)

/* The shape of the primitives. The loops below are compiled once for each shape. */
enum shape { SPHERE, SWEPT_SPHERE };

/* A vertex, or the first of two, and what an index says beside it. */
struct named {
    uint32_t vertex; /* in the numbering over all geometries */
    uint32_t caps; /* as in an id */
};

/*
 * The fields of a geometry that the loops need. They are a copy, because the compiler must assume that stores of bytes
 * change the original.
 */
struct names {
    const uint32_t *indices;
    uint32_t first_primitive, primitive_count, first_vertex;
};

static struct names names_of(const struct canonical_geometry *geometry)
{
    return (struct names){geometry->indices, geometry->first_primitive, geometry->primitive_count,
                          geometry->first_vertex};
}

static inline bool is_inside(const struct names *names, uint32_t primitive)
{
    /* wraps around for primitives below the first one */
    return primitive - names->first_primitive < names->primitive_count;
}

/* Reads what primitive `index` of the geometry names. */
static inline struct named name_of(const struct names *names, enum shape shape, uint32_t index)
{
    const uint32_t word = names->indices ? names->indices[index] : index;
    if (shape == SPHERE)
        return (struct named){names->first_vertex + word, 0};
    return (struct named){names->first_vertex + (word & CANONICAL_END_MASK), word >> 1 & CAPS};
}

static inline void prefetch_name(const struct names *names, uint32_t primitive)
{
    if (names->indices && is_inside(names, primitive))
        __builtin_prefetch(names->indices + (primitive - names->first_primitive));
}

static inline __attribute__((always_inline)) void write(const struct portable_records *writer, enum shape shape,
                                                        const uint32_t *refs, uint32_t count, unsigned char *record)
{
    const struct canonical_geometry *geometry = writer->canonical->geometries;
    const uint32_t *remap = writer->remap;
    struct names names = names_of(geometry);
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_round)) {
        if (!is_inside(&names, refs[i])) {
            geometry = &writer->canonical->geometries[canonical_geometry_of(writer->canonical, refs[i])];
            names = names_of(geometry);
        }
        const struct named named = name_of(&names, shape, refs[i] - names.first_primitive);
        const uint32_t vertex = remap ? remap[named.vertex] : named.vertex,
                       id = portable_records_id(geometry, refs[i]) | named.caps;
        bytes_put64(record, vertex | (uint64_t)id << 32);
    }
}

static void write_spheres(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                          unsigned char *record)
{
    write(writer, SPHERE, refs, count, record);
}

static void write_swept(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                        unsigned char *record)
{
    write(writer, SWEPT_SPHERE, refs, count, record);
}

static void prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count)
{
    const struct names names = names_of(writer->canonical->geometries);
    for (uint32_t i = 0; i < count; i++)
        prefetch_name(&names, refs[i]);
}

static inline void mark_one(const struct names *names, enum shape shape, uint32_t index, uint8_t *used)
{
    const uint32_t vertex = name_of(names, shape, index).vertex;
    __atomic_store_n(&used[vertex], 1, __ATOMIC_RELAXED);
    if (shape == SWEPT_SPHERE)
        __atomic_store_n(&used[vertex + 1], 1, __ATOMIC_RELAXED);
}

static inline __attribute__((always_inline)) void mark(const struct canonical *canonical, enum shape shape,
                                                       const uint32_t *refs, uint32_t count, uint8_t *used)
{
    enum { AHEAD = 16 };
    struct names names = names_of(canonical->geometries);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t later = refs[count - i > AHEAD ? i + AHEAD : i];
        if (!is_inside(&names, refs[i]))
            names = names_of(&canonical->geometries[canonical_geometry_of(canonical, refs[i])]);
        prefetch_name(&names, later);
        mark_one(&names, shape, refs[i] - names.first_primitive, used);
    }
}

static void mark_spheres(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used)
{
    mark(canonical, SPHERE, refs, count, used);
}

static void mark_swept(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used)
{
    mark(canonical, SWEPT_SPHERE, refs, count, used);
}

static void mark_spheres_range(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, uint8_t *used)
{
    const struct names names = names_of(geometry);
    for (uint32_t i = first; i < first + count; i++)
        mark_one(&names, SPHERE, i, used);
}

static void mark_swept_range(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, uint8_t *used)
{
    const struct names names = names_of(geometry);
    for (uint32_t i = first; i < first + count; i++)
        mark_one(&names, SWEPT_SPHERE, i, used);
}

static float *copy_vertices(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                            const uint8_t *used, float *to)
{
    return portable_records_copy(geometry->positions + (size_t)4 * first, 4, count, used, to);
}

/* Finds the first record with fewer vertices than `vertices` from its own one on, or with other flags than these. */
static inline uint32_t find_record(const struct portable_view *view, uint32_t vertices, uint32_t flags)
{
    const struct portable_header *header = view->header;
    const struct portable_round *records = view->records;
    uint32_t i = 0;
    while (i < header->record_count && records[i].vertex < header->vertex_count &&
           header->vertex_count - records[i].vertex >= vertices &&
           portable_records_id_is_sound(header, records[i].id, flags))
        i++;
    return i;
}

static uint32_t find_unsound_sphere(const struct portable_view *view)
{
    return find_record(view, 1, PORTABLE_ID_OPAQUE);
}

static uint32_t find_unsound_swept(const struct portable_view *view)
{
    return find_record(view, 2, PORTABLE_ID_OPAQUE | CAPS);
}

/*
 * Primitives with a NaN are in no tree, and those that reach to infinity are in the trees of updatable structures
 * alone. So the vertices of others are in no structure.
 */
static uint32_t find_unsound_vertex(const struct portable_view *view)
{
    const float most = view->header->build_flags & BUILD_ALLOW_UPDATE ? INFINITY : FLT_MAX;
    const float *vertex = view->vertices;
    uint32_t i = 0;
    while (i < view->header->vertex_count && fabsf(vertex[0]) <= most && fabsf(vertex[1]) <= most &&
           fabsf(vertex[2]) <= most && vertex[3] >= 0 && vertex[3] <= most) {
        vertex += 4;
        i++;
    }
    return i;
}

/* Whether or not there are indices, a sphere names one vertex, and a linear swept sphere two. */
static uint64_t sphere_vertices_most(const struct geometry *geometry)
{
    return geometry->range.primitive_count;
}

static uint64_t swept_vertices_most(const struct geometry *geometry)
{
    return (uint64_t)2 * geometry->range.primitive_count;
}

const struct record_kind record_spheres = {
    .version = 2,
    .type = GEOMETRY_SPHERES,
    .size = sizeof(struct portable_round),
    .vertex_size = 4 * sizeof(float),
    .node_size = sizeof(struct portable_node),
    .first_leaf = 1,
    .cost = 0.15f,
    .vertices_most = sphere_vertices_most,
    .write = write_spheres,
    .prefetch = prefetch,
    .mark = mark_spheres,
    .mark_range = mark_spheres_range,
    .copy_vertices = copy_vertices,
    .find_unsound = find_unsound_sphere,
    .find_unsound_vertex = find_unsound_vertex,
};

const struct record_kind record_swept_spheres = {
    .version = 2,
    .type = GEOMETRY_SWEPT_SPHERES,
    .size = sizeof(struct portable_round),
    .vertex_size = 4 * sizeof(float),
    .node_size = sizeof(struct portable_node),
    .first_leaf = 1,
    .cost = 0.15f,
    .vertices_most = swept_vertices_most,
    .write = write_swept,
    .prefetch = prefetch,
    .mark = mark_swept,
    .mark_range = mark_swept_range,
    .copy_vertices = copy_vertices,
    .find_unsound = find_unsound_swept,
    .find_unsound_vertex = find_unsound_vertex,
};

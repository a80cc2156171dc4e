/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_records.h - writes the records of a portable structure, the contents of its leaves, from a canonical copy.
 * record_kind.h has a writer for each kind of record; here is what these writers share, and what only one kind needs.
 */
#ifndef BVHD_PORTABLE_RECORDS_H
#define BVHD_PORTABLE_RECORDS_H

#include "builder/format/record_kind.h"

/* The source and the destination of the records that are written. */
struct portable_records {
    const struct record_kind *kind;
    const struct canonical *canonical;
    unsigned char *records; /* the start of the section */
    const uint32_t *remap; /* the new number of each vertex; NULL if there are none, or all are kept */
};

/*
 * Writes records first .. first + count - 1 from refs, which are flat primitive ids. May be called from any thread, for
 * ranges that do not overlap.
 */
static inline void portable_records_write(const struct portable_records *writer, uint32_t first, const uint32_t *refs,
                                          uint32_t count)
{
    writer->kind->write(writer, refs, count, writer->records + (uint64_t)first * writer->kind->size);
}

/* Prefetches the data of refs that will be written soon. */
static inline void portable_records_prefetch(const struct portable_records *writer, const uint32_t *refs,
                                             uint32_t count)
{
    if (writer->kind->prefetch)
        writer->kind->prefetch(writer, refs, count);
}

/* Returns the geometry of a flat primitive; `guess` is the one that is tried first. */
static inline const struct canonical_geometry *portable_records_geometry(const struct portable_records *writer,
                                                                         const struct canonical_geometry *guess,
                                                                         uint32_t primitive)
{
    /* wraps around for primitives below the first one */
    if (primitive - guess->first_primitive < guess->primitive_count)
        return guess;
    return &writer->canonical->geometries[canonical_geometry_of(writer->canonical, primitive)];
}

/* Returns the id of a record of a bottom level. */
static inline uint32_t portable_records_id(const struct canonical_geometry *geometry, uint32_t primitive)
{
    const uint32_t id = primitive | (geometry->flags & GEOMETRY_OPAQUE ? PORTABLE_ID_OPAQUE : 0);
    if (!geometry->micromap_indices)
        return id;
    const uint32_t index = geometry->micromap_indices[primitive - geometry->first_primitive];
    return geometry->resolves_micromaps && index == MICROMAP_FULLY_OPAQUE ? id | PORTABLE_ID_OPAQUE
                                                                          : id | PORTABLE_ID_MICROMAP;
}

/* Returns whether an untrusted id can be that of a record, which may have these flags. */
static inline bool portable_records_id_is_sound(const struct portable_header *header, uint32_t id, uint32_t flags)
{
    return !(id & ~(PORTABLE_ID_MASK | flags)) && (id & PORTABLE_ID_MASK) < header->primitive_count;
}

/*
 * Returns the flags that ids of triangles may have, and whether the untrusted id of a triangle is sound: if it says so,
 * there is an index for it, of a micromap's triangle or a special one.
 */
uint32_t portable_records_triangle_flags(const struct portable_header *header);
bool portable_records_micromap_is_sound(const struct portable_view *view, uint32_t id);

/*
 * Does what kind->mark does for the primitives `first` .. first + count - 1 over all geometries, which are all in the
 * tree, in the order of the request, which is the order in memory.
 */
void portable_records_mark_range(const struct record_kind *kind, const struct canonical *canonical, uint32_t first,
                                 uint32_t count, uint8_t *used);

/*
 * Does what kind->copy_vertices does for vertices of `floats` numbers each, which lie in one array. That number is
 * constant where it is called, so that the compiler makes each copy a few moves.
 */
static inline __attribute__((always_inline)) float *portable_records_copy(const float *from, size_t floats,
                                                                          uint32_t count, const uint8_t *used,
                                                                          float *to)
{
    if (count == 0)
        return to; /* a geometry without vertices has no positions */
    if (!used) {
        memcpy(to, from, floats * sizeof *to * count);
        return to + floats * count;
    }
    for (uint32_t i = 0; i < count; i++, from += floats)
        if (used[i]) {
            memcpy(to, from, floats * sizeof *to);
            to += floats;
        }
    return to;
}

/*
 * Inverts a row-major 3x4 matrix in double and rounds once. The result is all zero if the inverse does not exist or
 * does not fit float.
 */
void portable_invert(const float matrix[12], float ret_inverse[12]);

#endif

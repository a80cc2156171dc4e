/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_records.h - writes the records of a portable structure, the contents of its leaves, from a canonical copy.
 * There is one writer for each kind of record.
 */
#ifndef BVHD_PORTABLE_RECORDS_H
#define BVHD_PORTABLE_RECORDS_H

#include "builder/format/canonical.h"
#include "builder/format/portable.h"

/* The source and the destination of the records that are written. */
struct portable_records {
    enum portable_content content;
    const struct canonical *canonical;
    unsigned char *records; /* the start of the section */
    const uint32_t *remap; /* indexed triangles: the new number of each vertex; NULL if all vertices are kept */
};

/* Returns the size of one record in bytes. */
uint32_t portable_record_size(enum portable_content content);

/*
 * Writes records first .. first + count - 1 from refs, which are flat primitive ids. May be called from any thread, for
 * ranges that do not overlap.
 */
void portable_records_write(const struct portable_records *writer, uint32_t first, const uint32_t *refs,
                            uint32_t count);

/*
 * Sets used[vertex] to 1 for each vertex of these triangles, by relaxed atomic stores. May be called from any thread.
 */
void portable_records_mark(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used);

/*
 * Does the same for the triangles `first` .. first + count - 1, which are all in the tree, in the order of the request,
 * which is the order in memory.
 */
void portable_records_mark_range(const struct canonical *canonical, uint32_t first, uint32_t count, uint8_t *used);

/* Prefetches the data of refs that will be written soon. */
void portable_records_prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count);

/*
 * Inverts a row-major 3x4 matrix in double and rounds once. The result is all zero if the inverse does not exist or
 * does not fit float.
 */
void portable_invert(const float matrix[12], float ret_inverse[12]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_records.h - what the leaves of a portable structure hold, written from a canonical copy. One writer for each
 * content.
 */
#ifndef BVHD_PORTABLE_RECORDS_H
#define BVHD_PORTABLE_RECORDS_H

#include "builder/format/canonical.h"
#include "builder/format/portable.h"

struct portable_records {
    enum portable_content content;
    const struct canonical *canonical;
    unsigned char *records; /* the section */
    const uint32_t *remap; /* indexed triangles: where each vertex is kept; NULL when all are */
};

/* Bytes of one record. */
uint32_t portable_record_size(enum portable_content content);

/*
 * Writes records first .. first + count - 1 from refs, which are flat primitive ids. From any thread, for ranges that
 * do not overlap.
 */
void portable_records_write(const struct portable_records *writer, uint32_t first, const uint32_t *refs,
                            uint32_t count);

/* Sets used[vertex] to 1 for each vertex of these triangles, by relaxed atomic stores: from any thread. */
void portable_records_mark(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used);

/*
 * The same for the triangles `first` to first + count - 1, all of which are in the tree: in the order of the request,
 * which is that of memory.
 */
void portable_records_mark_range(const struct canonical *canonical, uint32_t first, uint32_t count, uint8_t *used);

/* Says that these will be written soon. */
void portable_records_prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count);

/*
 * In double, rounded once; all zero for a matrix whose inverse does not exist or is no float. Both are row-major 3x4.
 */
void portable_invert(const float matrix[12], float ret_inverse[12]);

#endif

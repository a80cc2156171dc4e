/* SPDX-License-Identifier: Apache-2.0 */
/* portable_records.h - what the leaves of a portable structure hold, written from a canonical copy. One writer for each content. */
#ifndef BVHD_PORTABLE_RECORDS_H
#define BVHD_PORTABLE_RECORDS_H

#include "canonical.h"
#include "portable.h"

struct portable_records {
    enum portable_content content;
    const struct canonical *canonical;
    unsigned char *records; /* the section */
    uint8_t *used; /* indexed triangles: one for each vertex, set to 1 when a record names it; by relaxed atomic stores */
};

/* Bytes of one record. */
uint32_t portable_record_size(enum portable_content content);

/* Writes records first .. first + count - 1 from refs, which are flat primitive ids. From any thread, for ranges that do not overlap. */
void portable_records_write(const struct portable_records *writer, uint32_t first, const uint32_t *refs, uint32_t count);

/* Says that these will be written soon. */
void portable_records_prefetch(const struct portable_records *writer, const uint32_t *refs, uint32_t count);

/* In double, rounded once; all zero for a matrix whose inverse does not exist or is no float. Both are row-major 3x4. */
void portable_invert(const float matrix[12], float ret_inverse[12]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * row_kind.h - says which fields and spans of a geometry's row stand for which members of its description, for each
 * kind of geometry. rows.c writes and reads all kinds by these tables; fields and spans that a kind does not name are
 * written as 0, and ignored when they are read.
 */
#ifndef BVHD_ROW_KIND_H
#define BVHD_ROW_KIND_H

#include "proto/wire/rows.h"

/* The arrays to which a geometry's row can point, in the order of its spans. */
enum row_array { ROW_DATA, ROW_INDICES, ROW_TRANSFORM, ROW_ARRAYS };

enum { ROW_KIND_FIELDS = 4 };

/* A field of struct geometry_row, and the member of struct geometry that it stands for: offsets in bytes. */
struct row_field {
    uint16_t row, geometry;
    uint16_t size; /* of both; 0 behind the last field of a kind */
};

struct row_kind {
    uint16_t arrays[ROW_ARRAYS]; /* where struct geometry has the array's struct bytes; 0: the kind has no such array */
    struct row_field fields[ROW_KIND_FIELDS];
};

/* Returns what rows of this GEOMETRY_ type have: nothing, if the type is not known. */
const struct row_kind *row_kind_find(uint32_t type);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * row_kind.h - says which fields and spans of a geometry's row stand for which members of its description, for each
 * kind of geometry. rows.c writes and reads all kinds by these tables; fields and spans that a kind does not have are
 * written as 0, and ignored when they are read.
 */
#ifndef BVHD_ROW_KIND_H
#define BVHD_ROW_KIND_H

#include <stdbool.h>

#include "proto/wire/rows.h"

/* The arrays to which a geometry's row can point, in the order of its spans. */
enum row_array {
    ROW_DATA,
    ROW_INDICES,
    ROW_TRANSFORM,
    ROW_RADII,
    ROW_END_POSITIONS,
    ROW_USAGES,
    ROW_MICROMAP_INDICES,
    ROW_MICROMAP_TRIANGLES,
    ROW_COORDINATES,
    ROW_ARRAYS
};

struct row_kind {
    uint16_t size; /* bytes of the shortest row that has all fields of this kind, without a micromap on it */
    bool can_have_micromap; /* struct geometry has a struct triangle_micromap in `triangles` */
    /* Where struct geometry has the struct bytes of each array, in bytes; 0: the kind has no such array. */
    uint16_t arrays[ROW_ARRAYS];

    /*
     * Copy the fields that belong to this kind alone, except for arrays and spans. What all kinds have is already in
     * the destination, the rest of which is 0.
     */
    void (*to_row)(const struct geometry *geometry, struct geometry_row *row);
    void (*from_row)(const struct geometry_row *row, struct geometry *geometry);
};

/* Returns what rows of this GEOMETRY_ type have: nothing, if the type is not known. */
const struct row_kind *row_kind_find(uint32_t type);

/* Returns the bytes of the shortest row that has all fields of the geometry. */
uint32_t row_kind_size(const struct geometry *geometry);

#endif

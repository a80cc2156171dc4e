/* SPDX-License-Identifier: Apache-2.0 */
/*
 * input_kind.h - what this stage does differently for triangles, boxes and instances: one struct for each kind of
 * geometry, which the file of the kind fills (triangles.c, aabbs.c, instances.c).
 */
#ifndef BVHD_INPUT_KIND_H
#define BVHD_INPUT_KIND_H

#include <stdbool.h>
#include <stdint.h>

#include "builder/format/canonical.h"

struct form_geometry;

struct input_kind {
    uint32_t corners; /* vertices of a primitive; 0: the kind has no vertices */
    uint32_t vertex_size; /* bytes of a vertex in a canonical copy */
    uint32_t primitive_size; /* bytes of a primitive in a canonical copy: its indices, its box or its record */

    /* Fills the fields of a row that only this kind has. NULL: there are none. */
    void (*describe)(const struct geometry *geometry, bool is_update, struct form_geometry *row);
    /* Sets the pointer of the view that leads to the array at data_offset. */
    void (*view)(const void *data, struct canonical_geometry *geometry);

    /* Checks a geometry of a block that comes from elsewhere for contents that prepare() would not have written. */
    enum bvhd_status (*check_foreign)(const struct canonical *canonical, uint32_t geometry, struct bvhd_error *error);
};

extern const struct input_kind input_triangles, input_aabbs, input_instances;

/* Returns the kind of geometries of this type; NULL for a type that bvhd does not build. */
const struct input_kind *input_kind_of(uint32_t type);

#endif

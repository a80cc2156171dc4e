/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_kind.h - what random requests have to know about one kind of geometry: how to make it, how to move it, and
 * what can be broken in it. For test programs only.
 */
#ifndef BVHD_RANDOM_KIND_H
#define BVHD_RANDOM_KIND_H

#include "tests/support/builder/random_input.h"

/* The fields of a description that its kind uses; NULL: it has no such field. */
struct random_fields {
    uint32_t array_count;
    struct bytes *arrays[3];
    uint32_t *format, *index_type, *max_vertex;
    uint64_t *stride;
};

struct random_kind {
    uint32_t type; /* VkGeometryTypeKHR */
    bool are_candidates; /* what rays meet are boxes, of which programs themselves decide whether they are hit */
    /* Makes a geometry of a bottom level with its meaning; NULL: bottom levels have none of this kind. */
    void (*make)(struct random_input *input, uint32_t index, uint32_t count, struct random *random);
    /* Moves what was made, as random_input_move says. */
    void (*move)(struct random_input *input, uint32_t index, struct random *random);
    struct random_fields (*fields)(struct geometry *geometry);
    /* Makes the description of one that lies in these bytes, which may be too few. */
    void (*blank)(struct geometry *geometry, struct bytes bytes);
};

extern const struct random_kind random_triangles, random_boxes, random_instances;

enum { RANDOM_KINDS = 3 };

/* The kinds in the order of their types. */
extern const struct random_kind *const random_kinds[RANDOM_KINDS];

/* Returns NULL for a type that is none of them. */
const struct random_kind *random_kind_find(uint32_t type);

#endif

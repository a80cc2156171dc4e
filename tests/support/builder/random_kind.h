/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_kind.h - what random requests have to know about one kind of geometry: how to make it, how to move it, and
 * what can be broken in it. For test programs only.
 */
#ifndef BVHD_RANDOM_KIND_H
#define BVHD_RANDOM_KIND_H

#include "tests/support/builder/random_input.h"

/* The fields of a description that its kind uses; NULL, or a count of 0: it has no such field. */
struct random_fields {
    uint32_t array_count;
    struct bytes *arrays[4];
    uint32_t format_count;
    uint32_t *formats[2];
    uint32_t *index_type, *max_vertex;
    uint32_t stride_count;
    uint64_t *strides[3];
    uint32_t mode_count;
    uint32_t *modes[2]; /* enumerants */
};

struct random_kind {
    uint32_t type; /* GEOMETRY_ */
    enum oracle_shape shape; /* of what rays hit */
    bool are_candidates; /* what rays meet are boxes, of which programs themselves decide whether they are hit */
    /* Makes a geometry of a bottom level with its meaning; NULL: bottom levels have none of this kind. */
    void (*make)(struct random_input *input, uint32_t index, uint32_t count, struct random *random);
    /* Moves what was made, as random_input_move says. */
    void (*move)(struct random_input *input, uint32_t index, struct random *random);
    struct random_fields (*fields)(struct geometry *geometry);
    /* Makes the description of one that lies in these bytes, which may be too few. */
    void (*blank)(struct geometry *geometry, struct bytes bytes);
};

extern const struct random_kind random_triangles, random_boxes, random_instances, random_spheres, random_swept_spheres,
    random_moving_triangles, random_moving_instances;

/*
 * Requests of flat kinds, and those of round ones, do not depend on how many others there are, so that their seeds keep
 * their meaning.
 */
enum { RANDOM_FLAT_KINDS = 3, RANDOM_ROUND_KINDS = 5, RANDOM_KINDS = 7 };

/* The kinds: flat ones come first, then round ones, then those that move. */
extern const struct random_kind *const random_kinds[RANDOM_KINDS];

/* Returns how many of the kinds stand for a choice, where the type of a geometry is broken. */
uint32_t random_kind_count(enum random_choice choice);

/* Returns a kind of bottom levels. */
const struct random_kind *random_kind_any(enum random_choice choice, struct random *random);

/* Returns NULL for a type that is none of them. */
const struct random_kind *random_kind_find(uint32_t type);

#endif

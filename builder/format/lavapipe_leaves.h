/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_leaves.h - writes the leaves at the end of a structure of the lavapipe layout: one for each primitive of the
 * request, in its order, whether or not a box refers to it. Instances without a reference have no leaf: the following
 * leaves move up, and keep their instance numbers.
 */
#ifndef BVHD_LAVAPIPE_LEAVES_H
#define BVHD_LAVAPIPE_LEAVES_H

#include "builder/format/lavapipe.h"
#include "builder/format/layout.h"

/* The leaves of one structure: which primitives have one, and where. */
struct lavapipe_leaves {
    const struct canonical *canonical;
    struct memory *memory;
    enum lavapipe_kind kind;
    bool unsigned_zeros; /* -0 is stored as 0 */
    uint32_t count; /* number of leaves */
    uint32_t handle_count; /* of a top level: the same as the number of leaves */
    uint32_t *places; /* the leaf of each instance, LAVAPIPE_NONE if it has none; NULL: leaf i is primitive i */
};

/*
 * Counts the leaves and assigns a place to each instance. On failure (BVHD_NO_MEMORY, BVHD_CANCELLED) nothing stays
 * allocated.
 */
enum bvhd_status lavapipe_leaves_init(struct lavapipe_leaves *leaves, const struct layout_input *input,
                                      struct bvhd_error *error);

/* Frees the places. A struct that is all zero is allowed. */
void lavapipe_leaves_finish(struct lavapipe_leaves *leaves);

/* Returns the leaf of flat primitive `id`, or LAVAPIPE_NONE. */
static inline uint32_t lavapipe_leaves_place(const struct lavapipe_leaves *leaves, uint32_t id)
{
    return leaves->places ? leaves->places[id] : id;
}

/*
 * Writes the leaves of primitives [begin, end) and their handles. `body_leaves` is the 8-byte aligned start of all
 * leaves, `handles` the start of the table of handles.
 */
void lavapipe_leaves_write(const struct lavapipe_leaves *leaves, uint32_t begin, uint32_t end,
                           unsigned char *body_leaves, unsigned char *handles);

#endif

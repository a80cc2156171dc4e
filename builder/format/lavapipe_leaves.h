/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_leaves.h - what lies at the end of a structure of the lavapipe layout: a leaf for each primitive of the
 * request, in its order, whether a box refers to it or not. Instances without a reference have none: those behind them
 * move up, and keep their numbers.
 */
#ifndef BVHD_LAVAPIPE_LEAVES_H
#define BVHD_LAVAPIPE_LEAVES_H

#include "builder/format/lavapipe.h"
#include "builder/format/layout.h"

struct lavapipe_leaves {
    const struct canonical *canonical;
    struct memory *memory;
    enum lavapipe_kind kind;
    bool unsigned_zeros; /* -0 is stored as 0 */
    uint32_t count; /* leaves */
    uint32_t handle_count; /* of a top level: as many as leaves */
    uint32_t *places; /* of each instance: its leaf, LAVAPIPE_NONE for none; NULL: leaf i is primitive i */
};

/* Counts, and numbers instances. On failure nothing is held. BVHD_NO_MEMORY, BVHD_CANCELLED. */
enum bvhd_status lavapipe_leaves_init(struct lavapipe_leaves *leaves, const struct layout_input *input,
                                      struct bvhd_error *error);

/* NULL-safe inside: for one that is all zero too. */
void lavapipe_leaves_finish(struct lavapipe_leaves *leaves);

/* The leaf of flat primitive `id`, which has one. */
static inline uint32_t lavapipe_leaves_place(const struct lavapipe_leaves *leaves, uint32_t id)
{
    return leaves->places ? leaves->places[id] : id;
}

/*
 * Writes the leaves of primitives [begin, end) into all leaves at `body_leaves`, 8-byte aligned, and their handles into
 * the table.
 */
void lavapipe_leaves_write(const struct lavapipe_leaves *leaves, uint32_t begin, uint32_t end,
                           unsigned char *body_leaves, unsigned char *handles);

#endif

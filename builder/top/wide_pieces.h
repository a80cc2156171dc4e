/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wide_pieces.h - wide trees of pieces, each made while the piece's binary tree is still in the cache, and joined below
 * a wide tree of the pieces.
 *
 * What a layout reads of a binary tree besides is its boxes and refs. A joined tree has an ir of these alone: no nodes,
 * the root's box first, then those of the slots, in the order in which they are read.
 */
#ifndef BVHD_WIDE_PIECES_H
#define BVHD_WIDE_PIECES_H

#include "builder/wide/collapse.h"

/* Slots name boxes by their number from 1 on, and refs by their place in the piece. */
struct wide_piece {
    struct wide wide;
    struct box bounds;
    struct box *boxes; /* number 1 is boxes[0] */
    uint32_t box_count;
    uint32_t *refs;
    uint32_t ref_count;
    struct memory *memory;
};

/*
 * Takes the ir's refs, whether it succeeds or not, and ends the rest of it. The ir has nodes. BVHD_NO_MEMORY,
 * BVHD_CANCELLED.
 */
enum bvhd_status wide_piece_make(struct ir *ir, const struct collapse_options *options, struct memory *memory,
                                 struct wide_piece *ret_piece);

/* NULL-safe, idempotent. */
void wide_piece_finish(struct wide_piece *piece);

struct wide_join {
    const struct ir *top; /* at least three nodes; each leaf has one ref, whose place is the number of its piece */
    const struct wide_piece *const *pieces;
    uint32_t piece_count;
    const struct collapse_options *options;
    struct memory *memory;
    const struct parallel *parallel;
};

/* The caller ends both. The same for any number of threads. BVHD_NO_MEMORY, BVHD_TOO_LARGE, BVHD_CANCELLED. */
enum bvhd_status wide_pieces_join(const struct wide_join *request, struct ir *ret_ir, struct wide *ret_wide,
                                  struct bvhd_error *error);

#endif

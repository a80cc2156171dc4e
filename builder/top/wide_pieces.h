/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wide_pieces.h - collapses each piece into a wide tree while its binary tree is still in the cache, and joins these
 * trees below a wide tree of the pieces.
 *
 * Beside the wide tree, a layout reads boxes and refs of the binary tree. A joined tree therefore has an ir with only
 * these: it has no nodes; its boxes, of each key, are the root's, followed by those of the slots in the order in which
 * they are read.
 */
#ifndef BVHD_WIDE_PIECES_H
#define BVHD_WIDE_PIECES_H

#include "builder/wide/collapse.h"

/* The wide tree of a piece. Slots name boxes by numbers that start at 1, and refs by their places in the piece. */
struct wide_piece {
    struct wide wide;
    uint32_t key_count; /* of the tree */
    struct box bounds[IR_MAX_KEYS];
    struct box *boxes[IR_MAX_KEYS]; /* number 1 is boxes[key][0] */
    uint32_t box_count;
    uint32_t *refs;
    uint32_t ref_count;
    struct memory *memory;
};

/*
 * Collapses the tree of a piece, which has nodes. Takes over the ir's refs and ends the ir, whether it succeeds or not.
 * The caller ends *ret_piece with wide_piece_finish. Runs on the calling thread. Returns BVHD_NO_MEMORY or
 * BVHD_CANCELLED.
 */
enum bvhd_status wide_piece_make(struct ir *ir, const struct collapse_options *options, struct memory *memory,
                                 struct wide_piece *ret_piece);

/* Frees a piece; `piece` may be NULL, zeroed, or already finished. */
void wide_piece_finish(struct wide_piece *piece);

struct wide_join {
    /* at least three nodes, and the keys of all pieces; each leaf has one ref, which is the number of a piece */
    const struct ir *top;
    const struct wide_piece *const *pieces;
    uint32_t piece_count;
    const struct collapse_options *options;
    struct memory *memory;
    const struct parallel *parallel;
};

/*
 * Joins the pieces. The caller ends *ret_ir and *ret_wide. The result is the same for any number of threads. Returns
 * BVHD_NO_MEMORY, BVHD_TOO_LARGE, or BVHD_CANCELLED.
 */
enum bvhd_status wide_pieces_join(const struct wide_join *request, struct ir *ret_ir, struct wide *ret_wide,
                                  struct bvhd_error *error);

#endif

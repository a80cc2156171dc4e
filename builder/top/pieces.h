/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pieces.h - the middle of a build: builds a tree for each piece of the top-level split, several pieces in parallel and
 * each on one thread, and joins them into one tree.
 */
#ifndef BVHD_PIECES_H
#define BVHD_PIECES_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/top/split.h"
#include "builder/top/wide_pieces.h"

/* The ways to make the tree of a piece; the last three are by Embree (embree.h). */
enum pieces_method {
    PIECES_PLOC,
    PIECES_BINNED,
    PIECES_SPATIAL,
    PIECES_EMBREE_LOW,
    PIECES_EMBREE_MEDIUM,
    PIECES_EMBREE_HIGH
};

struct pieces_request {
    const struct split_tree *tree;
    struct primitive_ref *refs, *scratch; /* the arrays of the split; both are written to */
    /* refs that each array has room for; space between two pieces is room for the first one's splits */
    uint32_t capacity;
    enum pieces_method method;
    uint32_t leaf_max;
    float cut_cost; /* cost of a cut between two leaves (leaves.h); used by PIECES_PLOC and PIECES_BINNED */
    /* used by PIECES_SPATIAL and PIECES_EMBREE_HIGH (spatial.h, embree.h), and with must_restore */
    const struct canonical *canonical;
    bool must_restore; /* refs do not have the boxes of their primitives: each tree gets them (restore.h) */
    float price; /* used by PIECES_SPATIAL only (spatial.h) */
    /* NULL; or pieces are collapsed into wide trees at once, for pieces_join_wide; only with PIECES_PLOC */
    const struct collapse_options *collapse_at_once;
    const atomic_bool *cancel; /* may be NULL; checked every few thousand refs */
    /* may be NULL; called after each piece, from any thread */
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
    uint64_t progress_total; /* `total` of the progress calls: what all refs count for together */
};

struct pieces {
    struct piece *pieces; /* in the order of their refs */
    uint32_t count;
    const struct split_tree *tree;
    uint32_t key_count; /* of all trees */
    const struct collapse_options *collapse_at_once; /* from the request, like `cancel` */
    const atomic_bool *cancel;
    struct memory *memory;
};

/*
 * Builds the trees. Bounds in the split's tree are not read. The caller ends *ret_pieces with pieces_finish; the
 * request's tree must live until then. Returns BVHD_CANCELLED or BVHD_NO_MEMORY; by Embree's methods also what
 * embree_open and embree_build return.
 */
enum bvhd_status pieces_build(const struct pieces_request *request, struct memory *memory,
                              const struct parallel *parallel, struct pieces *ret_pieces, struct bvhd_error *error);

/*
 * The split's two arrays, from the same memory, which are no longer needed. The joined tree may take them over; then
 * they become NULL.
 */
struct pieces_spare {
    struct primitive_ref *refs, *scratch;
    uint32_t count; /* refs that each array has room for */
};

/*
 * Joins the pieces into one tree, and returns its depth and its SAH cost (ir_cost, not divided by the root's area). It
 * has the keys of the pieces. The tree lies in the spare blocks if they are large enough, because new pages cost more
 * time than copying. The caller ends *ret_ir with ir_finish. Returns BVHD_NO_MEMORY, BVHD_TOO_LARGE, or BVHD_CANCELLED.
 */
enum bvhd_status pieces_join(const struct pieces *pieces, struct pieces_spare *spare, const struct parallel *parallel,
                             struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error);

/*
 * Joins at least two pieces that were built with `collapse_at_once` into a wide tree. *ret_ir has what layouts read
 * beside it (wide_pieces.h); *ret_depth and *ret_cost are those of the binary tree. The caller ends *ret_ir and
 * *ret_wide. Errors are those of pieces_join.
 */
enum bvhd_status pieces_join_wide(const struct pieces *pieces, const struct parallel *parallel, struct ir *ret_ir,
                                  struct wide *ret_wide, uint32_t *ret_depth, double *ret_cost,
                                  struct bvhd_error *error);

/* Frees the trees of the pieces. `pieces` may be NULL, zeroed, or already finished. */
void pieces_finish(struct pieces *pieces);

#endif

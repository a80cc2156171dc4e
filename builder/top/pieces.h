/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pieces.h - the middle of a build: a tree for each piece of the top-level split, side by side, and all of them joined
 * into one ir.
 */
#ifndef BVHD_PIECES_H
#define BVHD_PIECES_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/top/split.h"
#include "builder/top/wide_pieces.h"

enum pieces_method { PIECES_PLOC, PIECES_BINNED, PIECES_SPATIAL };

struct pieces_request {
    const struct split_tree *tree;
    struct primitive_ref *refs, *scratch; /* of the split; both are written to */
    uint32_t capacity; /* refs that each has room for; what lies between two pieces is room for the first one's */
    enum pieces_method method;
    uint32_t leaf_max;
    float cut_cost; /* of leaves along a curve (leaves.h); not with PIECES_SPATIAL */
    const struct canonical *canonical; /* with PIECES_SPATIAL (spatial.h), as is `price` */
    float price;
    /* NULL, or pieces become wide trees at once, for pieces_join_wide; with PIECES_PLOC */
    const struct collapse_options *collapse_at_once;
    const atomic_bool *cancel; /* may be NULL; looked at every few thousand refs */
    void (*progress)(void *context, uint64_t done, uint64_t total); /* may be NULL; after each piece, from any thread */
    void *progress_context;
    uint64_t progress_total; /* what all refs count as together */
};

struct pieces {
    struct piece *pieces; /* in the order of their refs */
    uint32_t count;
    const struct split_tree *tree;
    const struct collapse_options *collapse_at_once; /* the request's, as is `cancel` */
    const atomic_bool *cancel;
    struct memory *memory;
};

/* BVHD_CANCELLED, BVHD_NO_MEMORY. No bounds of the tree are read. The caller ends *ret_pieces with pieces_finish. */
enum bvhd_status pieces_build(const struct pieces_request *request, struct memory *memory,
                              const struct parallel *parallel, struct pieces *ret_pieces, struct bvhd_error *error);

/*
 * Blocks of the split's refs and scratch, from the same memory, that nobody needs any more; the tree may take them
 * over, which sets them NULL.
 */
struct pieces_spare {
    struct primitive_ref *refs, *scratch;
    uint32_t count; /* refs that each has room for */
};

/*
 * The whole tree, its depth and its SAH cost (undivided, as ir_cost). The tree lies in the spare blocks where they are
 * large enough: new pages cost more than copying. BVHD_NO_MEMORY, BVHD_TOO_LARGE, BVHD_CANCELLED.
 */
enum bvhd_status pieces_join(const struct pieces *pieces, struct pieces_spare *spare, const struct parallel *parallel,
                             struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error);

/*
 * The wide tree of at least two pieces made with `collapse_at_once`, and what layouts read beside it (wide_pieces.h);
 * depth and cost are those of the binary tree. As pieces_join.
 */
enum bvhd_status pieces_join_wide(const struct pieces *pieces, const struct parallel *parallel, struct ir *ret_ir,
                                  struct wide *ret_wide, uint32_t *ret_depth, double *ret_cost,
                                  struct bvhd_error *error);

/* NULL-safe, idempotent. */
void pieces_finish(struct pieces *pieces);

#endif

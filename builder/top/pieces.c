/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/pieces.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "builder/piece/binned.h"
#include "builder/piece/embree.h"
#include "builder/piece/ploc.h"
#include "builder/piece/reinsertion.h"
#include "builder/piece/spatial.h"
#include "builder/top/restore.h"

struct piece {
    uint32_t node; /* number of the piece's node in the split tree */
    uint32_t first, count, capacity; /* its refs in the arrays of the split, and how many there is room for */
    struct ir ir;
    struct wide_piece wide; /* used instead of `ir` with collapse_at_once */
    uint32_t depth;
    double cost; /* by ir_cost, as long as the ir has its boxes */
    enum bvhd_status status;
    atomic_bool waits; /* for a thread that collapses its tree */
    uint32_t node_base, ref_base; /* places in the joined tree of the ir's node 1 and of its ref 0 */
};

struct build {
    const struct pieces_request *request;
    struct memory *memory;
    struct piece *pieces;
    uint32_t count;
    uint32_t threads; /* how many tasks can run at once */
    _Atomic uint32_t begun; /* pieces whose trees have been begun */
    uint32_t *order; /* numbers of the pieces, largest first, so that all threads end at about the same time */
    uint64_t total;
    _Atomic uint64_t done;
};

/*
 * Moves the largest nodes first, so that small ones find their places when those are right; a third pass hardly pays.
 */
static enum bvhd_status reinsert(const struct build *build, struct ir *ir, struct piece *piece)
{
    const struct reinsertion_request reinsertion = {.ir = ir,
                                                    .leaf_max = build->request->leaf_max,
                                                    .passes = 2,
                                                    .share = 0.25f,
                                                    .last_share = 1,
                                                    .cancel = build->request->cancel};
    return reinsertion_run(&reinsertion, build->memory, &piece->ir, NULL);
}

static enum bvhd_status build_spatial(const struct build *build, struct piece *piece)
{
    const struct pieces_request *request = build->request;
    struct spatial_request spatial = {
        .canonical = request->canonical,
        .refs = request->refs + piece->first,
        .scratch = request->scratch + piece->first,
        .count = piece->count,
        .capacity = piece->capacity,
        .cancel = request->cancel,
        .price = request->price,
    };
    struct ir ir;
    enum bvhd_status status = spatial_build(&spatial, build->memory, &ir, NULL);
    if (status != BVHD_OK)
        return status;
    status = reinsert(build, &ir, piece);
    ir_finish(&ir);
    return status;
}

static enum bvhd_status build_clusters(const struct build *build, struct piece *piece)
{
    const struct pieces_request *request = build->request;
    const bool ploc = request->method == PIECES_PLOC;
    struct cluster_request clusters = {
        .refs = request->refs + piece->first,
        .scratch = request->scratch + piece->first,
        .count = piece->count,
        .leaf_max = request->leaf_max,
        .cut_cost = request->cut_cost,
        .fills_leaves = ploc,
        .cancel = request->cancel,
    };
    return cluster_tree_build(&clusters, ploc ? ploc_join : binned_join, build->memory, &piece->ir, &piece->depth,
                              &piece->cost, NULL);
}

static bool is_by_embree(enum pieces_method method)
{
    return method == PIECES_EMBREE_LOW || method == PIECES_EMBREE_MEDIUM || method == PIECES_EMBREE_HIGH;
}

static enum bvhd_status build_by_embree(const struct build *build, struct piece *piece)
{
    const struct pieces_request *request = build->request;
    const enum pieces_method method = request->method;
    const struct embree_request embree = {
        .quality = method == PIECES_EMBREE_LOW    ? EMBREE_LOW
                   : method == PIECES_EMBREE_HIGH ? EMBREE_HIGH
                                                  : EMBREE_MEDIUM,
        .canonical = request->canonical,
        .refs = request->refs + piece->first,
        .scratch = request->scratch + piece->first,
        .count = piece->count,
        .capacity = method == PIECES_EMBREE_HIGH ? piece->capacity : piece->count,
        .leaf_max = request->leaf_max,
    };
    return embree_build(&embree, build->memory, &piece->ir, NULL);
}

static enum bvhd_status build_piece(const struct build *build, struct piece *piece)
{
    if (is_by_embree(build->request->method))
        return build_by_embree(build, piece);
    return build->request->method == PIECES_SPATIAL ? build_spatial(build, piece) : build_clusters(build, piece);
}

/*
 * Measures depth and cost. The piece's range of the scratch array has 32 bytes for each ref, enough for the levels of
 * two nodes; with splits there may be more nodes.
 */
static enum bvhd_status measure(const struct build *build, struct piece *piece)
{
    uint32_t *levels = (uint32_t *)(void *)(build->request->scratch + piece->first);
    bool fits =
        (uint64_t)piece->ir.node_count * sizeof *levels <= (uint64_t)piece->count * sizeof(struct primitive_ref);
    piece->depth = fits ? ir_levels(&piece->ir, levels) : ir_depth(&piece->ir, build->memory);
    if (!build->request->must_restore)
        piece->cost = ir_cost(&piece->ir, 0, piece->ir.node_count);
    return piece->depth == IR_DEPTH_UNKNOWN ? BVHD_NO_MEMORY : BVHD_OK;
}

static void collapse_piece(const struct build *build, struct piece *piece)
{
    const struct pieces_request *request = build->request;
    piece->status = parallel_cancelled(request->cancel)
                        ? BVHD_CANCELLED
                        : wide_piece_make(&piece->ir, request->collapse_at_once, build->memory, &piece->wide);
}

/* Collapses all pieces that wait for it, a thread's own first, since it is still in the cache. */
static void collapse_waiting(struct build *build, const struct piece *own)
{
    for (uint32_t i = 0, at = (uint32_t)(own - build->pieces); i < build->count; i++, at++) {
        struct piece *piece = &build->pieces[at < build->count ? at : at - build->count];
        if (atomic_load(&piece->waits) && atomic_exchange(&piece->waits, false))
            collapse_piece(build, piece);
    }
}

/*
 * Collapses a piece at once, while it is in the cache, as long as there are trees left for all threads to begin. Near
 * the end the piece waits instead, so that threads that find no tree to begin take over from those that are late. None
 * is forgotten: a thread leaves it waiting only if another one has yet to begin a tree, and will look after that, or
 * fail, and then nobody needs the piece.
 */
static void collapse_now_or_later(struct build *build, struct piece *piece)
{
    if (build->count - atomic_load(&build->begun) >= build->threads) {
        collapse_piece(build, piece);
        return;
    }
    atomic_store(&piece->waits, true);
    if (atomic_load(&build->begun) == build->count)
        collapse_waiting(build, piece);
}

static void run_piece(void *context, size_t index)
{
    struct build *build = context;
    struct piece *piece = &build->pieces[build->order[index]];
    const struct pieces_request *request = build->request;
    atomic_fetch_add(&build->begun, 1);
    piece->status = parallel_cancelled(request->cancel) ? BVHD_CANCELLED : build_piece(build, piece);
    if (piece->status == BVHD_OK && request->method != PIECES_PLOC && request->method != PIECES_BINNED)
        piece->status = measure(build, piece);
    if (piece->status == BVHD_OK && request->must_restore)
        piece->status = restore_boxes(request->canonical, request->cancel, &piece->ir, &piece->cost);
    const bool made = piece->status == BVHD_OK;
    uint64_t done = atomic_fetch_add_explicit(&build->done, piece->count, memory_order_relaxed) + piece->count;
    if (made && request->collapse_at_once)
        collapse_now_or_later(build, piece);
    if (request->progress && made)
        request->progress(request->progress_context, done * request->progress_total / build->total,
                          request->progress_total);
}

static int by_first(const void *a, const void *b)
{
    uint32_t x = ((const struct piece *)a)->first, y = ((const struct piece *)b)->first;
    return (x > y) - (x < y);
}

static int by_size(const void *a, const void *b, void *context)
{
    const struct piece *pieces = context;
    uint32_t i = *(const uint32_t *)a, k = *(const uint32_t *)b;
    if (pieces[i].count != pieces[k].count)
        return pieces[i].count < pieces[k].count ? 1 : -1;
    return (i > k) - (i < k);
}

static void list_pieces(struct build *build, uint32_t count)
{
    const struct split_tree *tree = build->request->tree;
    for (uint32_t node = 0, i = 0; node < tree->node_count; node++)
        if (tree->nodes[node].child == 0)
            build->pieces[i++] =
                (struct piece){.node = node, .first = tree->nodes[node].first, .count = tree->nodes[node].count};
    qsort(build->pieces, count, sizeof *build->pieces, by_first);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t end = i + 1 < count ? build->pieces[i + 1].first : build->request->capacity;
        build->pieces[i].capacity = end - build->pieces[i].first;
        build->order[i] = i;
    }
    qsort_r(build->order, count, sizeof *build->order, by_size, build->pieces);
}

/* Returns the first failure in the order of the pieces, but other ones before BVHD_CANCELLED. */
static enum bvhd_status worst(const struct build *build, uint32_t count)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < count; i++)
        if (build->pieces[i].status != BVHD_OK && (status == BVHD_OK || status == BVHD_CANCELLED))
            status = build->pieces[i].status;
    return status;
}

static const char *reason_of(enum bvhd_status status)
{
    return status == BVHD_CANCELLED   ? "cancelled"
           : status == BVHD_NO_MEMORY ? "no memory to build a tree"
                                      : "Embree has failed to build a tree";
}

/* Does what pieces_build does, with Embree open if the method is one of Embree's. */
static enum bvhd_status build_all(const struct pieces_request *request, struct memory *memory,
                                  const struct parallel *parallel, struct pieces *ret_pieces, struct bvhd_error *error)
{
    struct pieces pieces = {.count = request->tree->piece_count,
                            .tree = request->tree,
                            .key_count = request->must_restore && canonical_moves(request->canonical) ? 2 : 1,
                            .collapse_at_once = request->collapse_at_once,
                            .cancel = request->cancel,
                            .memory = memory};
    struct build build = {.request = request,
                          .memory = memory,
                          .total = request->tree->nodes[0].count,
                          .count = pieces.count,
                          .threads = parallel->threads};
    pieces.pieces = build.pieces = memory_array(memory, pieces.count, sizeof *pieces.pieces);
    build.order = memory_array(memory, pieces.count, sizeof *build.order);
    enum bvhd_status status = BVHD_NO_MEMORY;
    if (build.pieces && build.order) {
        list_pieces(&build, pieces.count);
        parallel_for(parallel, pieces.count, run_piece, &build);
        status = worst(&build, pieces.count);
    } else {
        pieces.count = 0;
    }
    memory_free(memory, build.order);
    if (status != BVHD_OK) {
        pieces_finish(&pieces);
        return bvhd_error_set(error, status, "", "%s", reason_of(status));
    }
    *ret_pieces = pieces;
    return BVHD_OK;
}

enum bvhd_status pieces_build(const struct pieces_request *request, struct memory *memory,
                              const struct parallel *parallel, struct pieces *ret_pieces, struct bvhd_error *error)
{
    if (!is_by_embree(request->method))
        return build_all(request, memory, parallel, ret_pieces, error);
    enum bvhd_status status = embree_open(error);
    if (status != BVHD_OK)
        return status;
    status = build_all(request, memory, parallel, ret_pieces, error);
    embree_close();
    return status;
}

void pieces_finish(struct pieces *pieces)
{
    if (!pieces || !pieces->memory)
        return;
    for (uint32_t i = 0; i < pieces->count; i++) {
        ir_finish(&pieces->pieces[i].ir);
        wide_piece_finish(&pieces->pieces[i].wide);
    }
    memory_free(pieces->memory, pieces->pieces);
    memset(pieces, 0, sizeof *pieces);
}

struct join {
    const struct pieces *pieces;
    struct ir ir;
};

static void copy_piece(void *context, size_t index)
{
    const struct join *join = context;
    const struct piece *piece = &join->pieces->pieces[index];
    const struct ir *from = &piece->ir, *to = &join->ir;
    for (uint32_t i = 0; i < from->node_count; i++) {
        struct ir_node node = from->nodes[i];
        node.first += node.count ? piece->ref_base : piece->node_base - 1;
        to->nodes[i ? piece->node_base + i - 1 : piece->node] = node;
    }
    for (uint32_t key = 0; key < to->key_count; key++) {
        to->boxes[key][piece->node] = from->boxes[key][0];
        memcpy(to->boxes[key] + piece->node_base, from->boxes[key] + 1,
               (from->node_count - 1) * sizeof *to->boxes[key]);
    }
    memcpy(to->refs + piece->ref_base, from->refs, from->ref_count * sizeof *to->refs);
}

/*
 * Fills the nodes above the pieces, which keep their places. Their boxes are computed from their children, which come
 * after them.
 */
static void make_top(const struct split_tree *tree, struct ir *ir)
{
    for (uint32_t i = tree->node_count; i-- > 0;) {
        uint32_t child = tree->nodes[i].child;
        if (child == 0)
            continue;
        ir->nodes[i] = (struct ir_node){.first = child};
        for (uint32_t key = 0; key < ir->key_count; key++) {
            struct box box = ir->boxes[key][child];
            box_grow(&box, &ir->boxes[key][child + 1]);
            ir->boxes[key][i] = box;
        }
    }
}

static void sum_up(const struct pieces *pieces, const struct ir *ir, uint32_t *levels, uint32_t *ret_depth,
                   double *ret_cost)
{
    const struct split_tree *tree = pieces->tree;
    uint32_t depth = 0;
    double cost = 0;
    levels[0] = 1;
    for (uint32_t i = 0; i < tree->node_count; i++)
        if (tree->nodes[i].child) {
            levels[tree->nodes[i].child] = levels[tree->nodes[i].child + 1] = levels[i] + 1;
            for (uint32_t key = 0; key < ir->key_count; key++)
                cost += box_half_area(&ir->boxes[key][i]);
        }
    for (uint32_t i = 0; i < pieces->count; i++) {
        const struct piece *piece = &pieces->pieces[i];
        uint32_t lowest = levels[piece->node] + piece->depth - 1;
        depth = lowest > depth ? lowest : depth;
        cost += piece->cost;
    }
    *ret_depth = depth;
    *ret_cost = cost;
}

/* Assigns places in the joined tree to the nodes and refs of all pieces. */
static void place_pieces(const struct pieces *pieces, uint64_t *ret_nodes, uint64_t *ret_refs)
{
    uint64_t nodes = pieces->tree->node_count, refs = 0;
    for (uint32_t i = 0; i < pieces->count; i++) {
        struct piece *piece = &pieces->pieces[i];
        piece->node_base = (uint32_t)nodes;
        piece->ref_base = (uint32_t)refs;
        nodes += piece->ir.node_count - 1;
        refs += piece->ir.ref_count;
    }
    *ret_nodes = nodes;
    *ret_refs = refs;
}

/* Gives a tree of one key, which has room for `nodes` nodes, the boxes of a second one. Ends the tree on failure. */
static enum bvhd_status add_key(struct ir *ir, uint32_t nodes, struct bvhd_error *error)
{
    ir->boxes[1] = memory_array(ir->memory, nodes, sizeof *ir->boxes[1]);
    if (!ir->boxes[1]) {
        ir_finish(ir);
        return bvhd_error_no_memory(error, "", "no memory for the boxes of %u nodes at t = 1", nodes);
    }
    ir->key_count = 2;
    return BVHD_OK;
}

/* Does what ir_init does for trees of any number of keys, with nodes and boxes in the spare blocks if they fit. */
static enum bvhd_status make_room(struct ir *ir, uint32_t key_count, struct pieces_spare *spare, struct memory *memory,
                                  uint32_t nodes, uint32_t refs, struct bvhd_error *error)
{
    uint64_t room = (uint64_t)spare->count * sizeof *spare->refs;
    const bool fits = (uint64_t)nodes * sizeof *ir->boxes[0] <= room;
    enum bvhd_status status = ir_init(ir, memory, fits ? 0 : nodes, refs, error);
    if (status == BVHD_OK && key_count > 1)
        status = add_key(ir, nodes, error);
    if (status != BVHD_OK || !fits)
        return status;
    ir->nodes = (struct ir_node *)(void *)spare->refs;
    ir->boxes[0] = (struct box *)(void *)spare->scratch;
    spare->refs = spare->scratch = NULL;
    return BVHD_OK;
}

enum bvhd_status pieces_join(const struct pieces *pieces, struct pieces_spare *spare, const struct parallel *parallel,
                             struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error)
{
    struct join join = {.pieces = pieces};
    uint64_t nodes, refs;
    place_pieces(pieces, &nodes, &refs);
    if (nodes > UINT32_MAX || refs > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "", "more references than 32 bits can name");
    uint32_t *levels = memory_array(pieces->memory, pieces->tree->node_count, sizeof *levels);
    if (!levels)
        return bvhd_error_no_memory(error, "", "no memory to join a tree");
    enum bvhd_status status =
        make_room(&join.ir, pieces->key_count, spare, pieces->memory, (uint32_t)nodes, (uint32_t)refs, error);
    if (status == BVHD_OK) {
        join.ir.node_count = (uint32_t)nodes;
        join.ir.ref_count = (uint32_t)refs;
        if (parallel_for_until(parallel, pieces->cancel, pieces->count, copy_piece, &join)) {
            make_top(pieces->tree, &join.ir);
            sum_up(pieces, &join.ir, levels, ret_depth, ret_cost);
            *ret_ir = join.ir;
        } else {
            ir_finish(&join.ir);
            status = bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
        }
    }
    memory_free(pieces->memory, levels);
    return status;
}

/* Fills the tree above the pieces: each piece is a leaf, whose only ref is the piece's number. */
static void fill_top(const struct pieces *pieces, const struct wide_piece **list, struct ir *top)
{
    top->node_count = pieces->tree->node_count;
    top->ref_count = pieces->count;
    for (uint32_t i = 0; i < pieces->count; i++) {
        const struct piece *piece = &pieces->pieces[i];
        list[i] = &piece->wide;
        top->refs[i] = i;
        top->nodes[piece->node] = (struct ir_node){i, 1};
        for (uint32_t key = 0; key < top->key_count; key++)
            top->boxes[key][piece->node] = piece->wide.bounds[key];
    }
    make_top(pieces->tree, top);
}

enum bvhd_status pieces_join_wide(const struct pieces *pieces, const struct parallel *parallel, struct ir *ret_ir,
                                  struct wide *ret_wide, uint32_t *ret_depth, double *ret_cost,
                                  struct bvhd_error *error)
{
    struct ir top;
    enum bvhd_status status = ir_init(&top, pieces->memory, pieces->tree->node_count, pieces->count, error);
    if (status == BVHD_OK && pieces->key_count > 1)
        status = add_key(&top, pieces->tree->node_count, error);
    if (status != BVHD_OK)
        return status;
    const struct wide_piece **list = memory_array(pieces->memory, pieces->count, sizeof *list);
    uint32_t *levels = memory_array(pieces->memory, pieces->tree->node_count, sizeof *levels);
    if (list && levels) {
        const struct wide_join request = {&top,           list,    pieces->count, pieces->collapse_at_once,
                                          pieces->memory, parallel};
        fill_top(pieces, list, &top);
        status = wide_pieces_join(&request, ret_ir, ret_wide, error);
        if (status == BVHD_OK)
            sum_up(pieces, &top, levels, ret_depth, ret_cost);
    } else {
        status = bvhd_error_no_memory(error, "", "no memory to join trees");
    }
    memory_free(pieces->memory, levels);
    memory_free(pieces->memory, list);
    ir_finish(&top);
    return status;
}

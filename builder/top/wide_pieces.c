/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/wide_pieces.h"

#include <string.h>

/* The place of a piece in the joined tree. */
struct position {
    uint32_t root, nodes; /* index of its root, and of the first of its other nodes */
    uint32_t root_leaf, leaf; /* first_leaf of its root, and of the first of its other nodes */
    uint32_t boxes, refs; /* offsets that are added to numbers of boxes, and to places of refs */
};

struct joining {
    const struct wide_join *request;
    struct wide top;
    struct position *positions; /* one for each piece */
    struct ir ir;
    struct wide wide;
    uint32_t next_node, next_leaf, next_box;
};

static uint32_t mask_of(bool condition)
{
    return 0u - (uint32_t)condition;
}

/*
 * Copies the boxes that slots name, in the order of the slots, and numbers them. The box of an empty slot is
 * overwritten by the next one.
 */
static void list_boxes(const struct ir *ir, struct wide_piece *piece)
{
    struct box *second = piece->key_count > 1 ? piece->boxes[1] : NULL;
    uint32_t count = 0;
    for (uint32_t i = 0; i < piece->wide.node_count; i++)
        for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
            struct wide_child *child = &piece->wide.nodes[i].slots[slot];
            bool occupied = (child->node | child->ref_count) != 0;
            piece->boxes[0][count] = ir->boxes[0][child->node];
            if (second)
                second[count] = ir->boxes[1][child->node];
            count += occupied;
            child->node = count & mask_of(occupied);
        }
    piece->box_count = count;
}

enum bvhd_status wide_piece_make(struct ir *ir, const struct collapse_options *options, struct memory *memory,
                                 struct wide_piece *ret_piece)
{
    struct wide_piece piece = {
        .key_count = ir->key_count, .refs = ir->refs, .ref_count = ir->ref_count, .memory = memory};
    enum bvhd_status status = collapse(ir, options, memory, &parallel_serial, &piece.wide, NULL);
    for (uint32_t key = 0; key < ir->key_count && status == BVHD_OK; key++) {
        piece.bounds[key] = ir->boxes[key][0];
        piece.boxes[key] = memory_array(memory, (uint64_t)ir->node_count + 1, sizeof *piece.boxes[key]);
        status = piece.boxes[key] ? BVHD_OK : BVHD_NO_MEMORY;
    }
    if (status == BVHD_OK)
        list_boxes(ir, &piece);
    ir->refs = NULL;
    ir_finish(ir);
    if (status == BVHD_OK)
        *ret_piece = piece;
    else
        wide_piece_finish(&piece);
    return status;
}

void wide_piece_finish(struct wide_piece *piece)
{
    if (!piece || !piece->memory)
        return;
    wide_finish(&piece->wide);
    for (int key = 0; key < IR_MAX_KEYS; key++)
        memory_free(piece->memory, piece->boxes[key]);
    memory_free(piece->memory, piece->refs);
    memset(piece, 0, sizeof *piece);
}

/* Returns how many leaf refs the piece's root has in its own slots. */
static uint32_t root_leaves(const struct wide_piece *piece)
{
    return piece->wide.node_count > 1 ? piece->wide.nodes[1].first_leaf : piece->wide.leaf_refs;
}

/* Places the root of a piece at index `at`, and its leaf refs next. */
static void place_root(struct joining *j, uint32_t number, uint32_t at)
{
    struct position *position = &j->positions[number];
    position->root = at;
    position->root_leaf = j->next_leaf;
    j->next_leaf += root_leaves(j->request->pieces[number]);
}

static void place_rest(struct joining *j, uint32_t number)
{
    const struct wide_piece *piece = j->request->pieces[number];
    struct position *position = &j->positions[number];
    position->nodes = j->next_node;
    position->leaf = j->next_leaf;
    j->next_node += piece->wide.node_count - 1;
    j->next_leaf += piece->wide.leaf_refs - root_leaves(piece);
}

/*
 * Fills the node at index `at` from a node of the tree above the pieces, all of whose children become inner nodes; then
 * places everything below each of them. Returns the number of levels.
 */
static uint32_t place_node(struct joining *j, uint32_t source, uint32_t at)
{
    const struct wide_node *from = &j->top.nodes[source];
    const struct ir *top = j->request->top;
    struct wide_node node = {.first_child = j->next_node, .first_leaf = j->wide.nodes[at].first_leaf};
    uint32_t depth = 0, below = from->first_child;
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        const struct wide_child *child = &from->slots[slot];
        enum wide_kind kind = wide_kind(child);
        if (kind == WIDE_EMPTY)
            continue;
        for (uint32_t key = 0; key < top->key_count; key++)
            j->ir.boxes[key][j->next_box] = top->boxes[key][child->node];
        node.slots[slot].node = j->next_box++;
        if (kind == WIDE_LEAF)
            place_root(j, top->refs[child->first_ref], j->next_node);
        else
            j->wide.nodes[j->next_node].first_leaf = j->next_leaf;
        j->next_node++;
    }
    j->wide.nodes[at] = node;
    for (unsigned slot = 0, child = node.first_child; slot < WIDE_ARITY; slot++) {
        enum wide_kind kind = wide_kind(&from->slots[slot]);
        uint32_t levels = 0;
        if (kind == WIDE_EMPTY)
            continue;
        if (kind == WIDE_LEAF) {
            uint32_t number = top->refs[from->slots[slot].first_ref];
            place_rest(j, number);
            levels = j->request->pieces[number]->wide.depth;
        } else {
            levels = place_node(j, below++, child);
        }
        depth = levels > depth ? levels : depth;
        child++;
    }
    return depth + 1;
}

/* Places the boxes and refs of the pieces one after another. */
static void place_arrays(struct joining *j)
{
    uint32_t refs = 0, boxes = j->next_box;
    for (uint32_t i = 0; i < j->request->piece_count; i++) {
        const struct wide_piece *piece = j->request->pieces[i];
        j->positions[i].boxes = boxes - 1;
        j->positions[i].refs = refs;
        boxes += piece->box_count;
        refs += piece->ref_count;
    }
}

/* Copies a node of a piece into the joined tree. */
static void copy_node(const struct position *position, const struct wide_node *from, uint32_t first_leaf,
                      struct wide_node *to)
{
    *to = *from;
    to->node = WIDE_NONE;
    to->first_leaf = first_leaf;
    to->first_child += (position->nodes - 1) & mask_of(from->first_child != 0);
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        struct wide_child *child = &to->slots[slot];
        child->node += position->boxes & mask_of(child->node != 0);
        child->first_ref += position->refs & mask_of(child->ref_count != 0);
    }
}

static void copy_piece(void *context, size_t index)
{
    const struct joining *j = context;
    const struct wide_piece *piece = j->request->pieces[index];
    const struct position *position = &j->positions[index];
    const struct wide_node *nodes = piece->wide.nodes;
    const uint32_t leaf = position->leaf - root_leaves(piece);
    copy_node(position, &nodes[0], position->root_leaf, &j->wide.nodes[position->root]);
    for (uint32_t i = 1; i < piece->wide.node_count; i++)
        copy_node(position, &nodes[i], nodes[i].first_leaf + leaf, &j->wide.nodes[position->nodes + i - 1]);
    for (uint32_t key = 0; key < piece->key_count; key++)
        memcpy(j->ir.boxes[key] + position->boxes + 1, piece->boxes[key], piece->box_count * sizeof *piece->boxes[key]);
    memcpy(j->ir.refs + position->refs, piece->refs, piece->ref_count * sizeof *piece->refs);
}

static enum bvhd_status make_room(struct joining *j)
{
    const struct wide_join *request = j->request;
    uint64_t nodes = j->top.node_count, boxes = (uint64_t)j->top.node_count + request->piece_count, refs = 0;
    for (uint32_t i = 0; i < request->piece_count; i++) {
        nodes += request->pieces[i]->wide.node_count;
        boxes += request->pieces[i]->box_count;
        refs += request->pieces[i]->ref_count;
    }
    if (nodes > UINT32_MAX || boxes > UINT32_MAX || refs > UINT32_MAX)
        return BVHD_TOO_LARGE;
    j->positions = memory_array(request->memory, request->piece_count, sizeof *j->positions);
    j->wide.nodes = memory_array(request->memory, nodes, sizeof *j->wide.nodes);
    bool has_boxes = true;
    for (uint32_t key = 0; key < j->ir.key_count; key++) {
        j->ir.boxes[key] = memory_array(request->memory, boxes, sizeof *j->ir.boxes[key]);
        has_boxes &= j->ir.boxes[key] != NULL;
    }
    j->ir.refs = memory_array(request->memory, refs, sizeof *j->ir.refs);
    j->wide.node_count = (uint32_t)nodes;
    j->ir.node_count = (uint32_t)boxes;
    j->wide.leaf_refs = j->ir.ref_count = (uint32_t)refs;
    return j->positions && j->wide.nodes && has_boxes && j->ir.refs ? BVHD_OK : BVHD_NO_MEMORY;
}

static enum bvhd_status join(struct joining *j)
{
    const struct wide_join *request = j->request;
    struct collapse_options options = *request->options;
    /* A leaf of the tree above must hold only one piece. */
    options.leaf_max = 1;
    enum bvhd_status status = collapse(request->top, &options, request->memory, &parallel_serial, &j->top, NULL);
    if (status == BVHD_OK)
        status = make_room(j);
    if (status != BVHD_OK)
        return status;
    for (uint32_t key = 0; key < j->ir.key_count; key++)
        j->ir.boxes[key][0] = request->top->boxes[key][0];
    j->next_node = j->next_box = 1;
    j->wide.nodes[0].first_leaf = 0;
    j->wide.depth = place_node(j, 0, 0);
    place_arrays(j);
    bool done = parallel_for_until(request->parallel, options.cancel, request->piece_count, copy_piece, j);
    return done ? BVHD_OK : BVHD_CANCELLED;
}

enum bvhd_status wide_pieces_join(const struct wide_join *request, struct ir *ret_ir, struct wide *ret_wide,
                                  struct bvhd_error *error)
{
    struct joining j = {.request = request,
                        .ir = {.key_count = request->top->key_count, .memory = request->memory},
                        .wide = {.memory = request->memory}};
    enum bvhd_status status = join(&j);
    wide_finish(&j.top);
    memory_free(request->memory, j.positions);
    if (status != BVHD_OK) {
        ir_finish(&j.ir);
        wide_finish(&j.wide);
        return bvhd_error_set(error, status, "",
                              status == BVHD_CANCELLED   ? "cancelled"
                              : status == BVHD_TOO_LARGE ? "more nodes than 32 bits can name"
                                                         : "no memory to join trees");
    }
    *ret_ir = j.ir;
    *ret_wide = j.wide;
    return BVHD_OK;
}

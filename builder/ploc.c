/* SPDX-License-Identifier: Apache-2.0 */
#include "ploc.h"

#include <string.h>

#include "bins.h"
#include "leaves.h"
#include "morton.h"
#include "nearest.h"
#include "pack.h"
#include "parallel.h"

/*
 * Nodes are refs: their boxes, and of inner ones the numbers of both children, of which the first (link) has no fewer refs below it. Leaves come
 * first, in the order of the curve.
 */
struct node_facts {
    float cost; /* SAH, undivided, of the subtree as it will be */
    uint32_t refs : 31;
    uint32_t leaf : 1; /* all of them in one leaf */
};

/* In the number of a child: it becomes a leaf, whatever is below it. */
#define BECOMES_LEAF UINT32_C(0x80000000)

/* Clusters that need not be divided from above: the fewer, the more of the tree is of binned SAH. */
enum { PART_MAX = 100 };

/* The clusters of a round, in the order of the curve. */
struct row {
    struct nearest_boxes boxes;
    uint32_t *nodes;
};

/* Where the first of a pair goes. */
struct move {
    uint32_t from, to;
};

struct clustering {
    const struct ploc_request *request;
    struct primitive_ref *leaves, *inner;
    uint32_t leaf_count;
    uint32_t *ids; /* primitives of all leaves; a leaf's `id` says where its own begin, its `link` how many they are */
    struct node_facts *facts;
    uint32_t node_count;
    struct row row, next;
    uint32_t count; /* clusters */
    int32_t *keys;
    struct move *pairs;
    uint8_t *kept; /* of each cluster: whether it is in the next row, alone or as the first of a pair */
    void *room;
};

static inline struct primitive_ref *node_at(const struct clustering *c, uint32_t node)
{
    uint32_t leaves = c->leaf_count;
    return node < leaves ? &c->leaves[node] : &c->inner[node - leaves];
}

static inline struct vec4_box box_of_two(const struct clustering *c, uint32_t a, uint32_t b)
{
    struct vec4_box box = vec4_box_load(node_at(c, a)), other = vec4_box_load(node_at(c, b));
    vec4_box_grow(&box, other.min, other.max);
    return box;
}

static inline float cost_of_two(const struct clustering *c, uint32_t a, uint32_t b)
{
    return vec4_box_half_area(box_of_two(c, a, b)) + c->facts[a].cost + c->facts[b].cost;
}

static inline uint32_t as_child(const struct clustering *c, uint32_t node)
{
    return node | (uint32_t)c->facts[node].leaf << 31;
}

/* Fills an inner node. */
static inline void set_node(const struct clustering *c, uint32_t node, uint32_t left, uint32_t right, struct vec4_box box)
{
    struct primitive_ref *ref = &c->inner[node - c->leaf_count];
    const bool in_order = c->facts[left].refs >= c->facts[right].refs;
    const uint32_t children[2] = {as_child(c, left), as_child(c, right)};
    vec4_box_store(ref, box);
    ref->link = children[!in_order];
    ref->id = children[in_order];
    uint32_t refs = (uint32_t)c->facts[left].refs + c->facts[right].refs;
    if (c->request->cut_cost > 0) {
        c->facts[node] = (struct node_facts){0, refs & INT32_MAX, refs <= c->request->leaf_max};
        return;
    }
    float area = vec4_box_half_area(box), cost = area + c->facts[left].cost + c->facts[right].cost;
    float as_leaf = area * (float)refs;
    bool leaf = refs <= c->request->leaf_max && as_leaf <= cost;
    c->facts[node] = (struct node_facts){leaf ? as_leaf : cost, refs & INT32_MAX, leaf};
}

/*
 * A tree rotation (Kensler 2008) below a node that is about to get two children: one of them may change places with a child of the other, if
 * that makes the other cheaper.
 */
static inline void rotate(const struct clustering *c, uint32_t children[2])
{
    float best = c->facts[children[0]].cost + c->facts[children[1]].cost;
    uint32_t low = 0, up = 0, stays = 0, side = 2;
    for (uint32_t i = 0; i < 2; i++) {
        uint32_t inner = children[i], other = children[1 - i];
        if (inner < c->leaf_count)
            continue;
        const struct primitive_ref *ref = node_at(c, inner);
        uint32_t left = ref->link & ~BECOMES_LEAF, right = ref->id & ~BECOMES_LEAF;
        float right_stays = cost_of_two(c, other, right) + c->facts[left].cost;
        float left_stays = cost_of_two(c, other, left) + c->facts[right].cost;
        if (right_stays < best) {
            best = right_stays;
            side = i, low = other, up = left, stays = right;
        }
        if (left_stays < best) {
            best = left_stays;
            side = i, low = other, up = right, stays = left;
        }
    }
    if (side == 2)
        return;
    set_node(c, children[side], stays, low, box_of_two(c, stays, low));
    children[1 - side] = up;
}

static inline uint32_t join(struct clustering *c, uint32_t left, uint32_t right)
{
    uint32_t node = c->node_count++, children[2] = {left, right};
    struct vec4_box box = box_of_two(c, left, right);
    if (c->request->cut_cost <= 0)
        rotate(c, children);
    set_node(c, node, children[0], children[1], box);
    return node;
}

static inline void put(const struct row *row, uint32_t at, uint32_t node, const struct primitive_ref *ref)
{
    for (int axis = 0; axis < 3; axis++) {
        row->boxes.min[axis][at] = ref->min[axis];
        row->boxes.max[axis][at] = ref->max[axis];
    }
    row->nodes[at] = node;
}

/* Who chose each other, and who stays alone. Without branches, since nobody can foresee choices. */
static uint32_t list_moves(struct clustering *c, uint32_t *ret_pairs)
{
    struct move *moves = c->pairs;
    const int32_t *keys = c->keys;
    uint8_t *kept = c->kept;
    uint32_t pairs = 0, to = 0, count = c->count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t partner = nearest_partner(i, keys[i]);
        bool mutual = keys[partner] == keys[i], first = i < partner;
        moves[pairs] = (struct move){i, to};
        pairs += mutual & first;
        to += !mutual | first;
        kept[i] = !mutual | first;
    }
    memset(kept + count, 0, PACK_PAD);
    *ret_pairs = pairs;
    return to;
}

static void merge(struct clustering *c)
{
    const struct row *row = &c->row, *next = &c->next;
    uint32_t pairs, count = list_moves(c, &pairs);
    pack_row(&row->boxes, row->nodes, c->kept, c->count, &next->boxes, next->nodes);
    for (uint32_t i = 0; i < pairs; i++) {
        uint32_t from = c->pairs[i].from, partner = nearest_partner(from, c->keys[from]);
        uint32_t node = join(c, row->nodes[from], row->nodes[partner]);
        put(next, c->pairs[i].to, node, node_at(c, node));
    }
    struct row swap = c->row;
    c->row = c->next;
    c->next = swap;
    c->count = count;
}

static void run_round(struct clustering *c)
{
    nearest_pad(&c->row.boxes, c->count);
    nearest_find(&c->row.boxes, c->count, c->request->radius, c->keys);
    merge(c);
}

/* False when cancelled. */
static bool run_rounds(struct clustering *c)
{
    /* With merges of fewer than this share of the clusters rounds would go on for long. */
    enum { STALLED = 16 };
    uint32_t before = UINT32_MAX;
    for (uint32_t round = 0; round < c->request->rounds && c->count > 1 && before - c->count > before / STALLED; round++) {
        if (parallel_cancelled(c->request->cancel))
            return false;
        before = c->count;
        run_round(c);
    }
    return !parallel_cancelled(c->request->cancel);
}

/* Clusters on their way to being divided, as refs whose ids are nodes. */
struct part {
    struct vec4_box centroids;
    struct primitive_ref *refs, *other; /* where they lie, where they may go */
    uint32_t count;
    uint32_t *ret_node; /* where the number of its root goes */
};

/* A node above the clusters, before it has a number. */
struct division {
    uint32_t children[2];
    uint32_t *ret_node;
};

static void divide(const struct part *part, struct division *division, struct part ret_children[2])
{
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2];
    /* As spatial.c divides refs. */
    bool halved = !bins_find(part->refs, part->count, &part->centroids, &mapping, &plane);
    if (halved)
        bins_halve(part->refs, part->count, &plane, centroids);
    else
        bins_partition(&mapping, &plane, part->refs, part->count, part->other, part->other + plane.left_count, centroids);
    uint32_t left = plane.left_count;
    struct primitive_ref *refs = halved ? part->refs : part->other, *other = halved ? part->other : part->refs;
    division->ret_node = part->ret_node;
    ret_children[0] = (struct part){centroids[0], refs, other, left, &division->children[0]};
    ret_children[1] = (struct part){centroids[1], refs + left, other + left, part->count - left, &division->children[1]};
}

/* Clusters of a part to one; a round makes at least one pair (nearest.h). The rows are free while parts are divided. */
static uint32_t cluster_part(struct clustering *c, const struct part *part)
{
    for (uint32_t i = 0; i < part->count; i++)
        put(&c->row, i, part->refs[i].id, &part->refs[i]);
    for (c->count = part->count; c->count > 1;)
        run_round(c);
    return c->row.nodes[0];
}

/* The larger child waits while the smaller is divided, so that at most 32 wait. False when cancelled. */
static bool divide_part(struct clustering *c, struct part part, struct division *divisions)
{
    struct part waiting[33], children[2];
    uint32_t waiting_count = 0, division_count = 0;
    for (;;) {
        if (part.count > PART_MAX) {
            if (parallel_cancelled(c->request->cancel))
                return false;
            divide(&part, &divisions[division_count++], children);
            bool right_first = children[1].count < children[0].count;
            waiting[waiting_count++] = children[!right_first];
            part = children[right_first];
            continue;
        }
        *part.ret_node = cluster_part(c, &part);
        if (waiting_count == 0)
            break;
        part = waiting[--waiting_count];
    }
    /* Parents come before their children. */
    while (division_count-- > 0) {
        const struct division *division = &divisions[division_count];
        *division->ret_node = join(c, division->children[0], division->children[1]);
    }
    return true;
}

/* Makes one tree of the clusters that are left: divided from above as far as they are many, then merged. */
static enum bvhd_status divide_rest(struct clustering *c, struct memory *memory, uint32_t *ret_root)
{
    struct division *divisions = memory_array(memory, c->count, sizeof *divisions);
    struct primitive_ref *refs = memory_array(memory, 2 * (uint64_t)c->count, sizeof *refs);
    struct part part = {.refs = refs, .count = c->count, .ret_node = ret_root};
    enum bvhd_status status = BVHD_NO_MEMORY;
    if (divisions && refs) {
        struct vec4_box bounds;
        part.other = refs + c->count;
        for (uint32_t i = 0; i < c->count; i++) {
            vec4_box_store(&refs[i], vec4_box_load(node_at(c, c->row.nodes[i])));
            refs[i].id = c->row.nodes[i];
        }
        bins_bound(refs, c->count, &bounds, &part.centroids);
        status = divide_part(c, part, divisions) ? BVHD_OK : BVHD_CANCELLED;
    }
    memory_free(memory, divisions);
    memory_free(memory, refs);
    return status;
}

/* A node of the clusters whose children become a pair of the ir. */
struct emitted {
    uint32_t child; /* as its parent has it */
    uint32_t ir_node, level;
};

/* Copies up to three without a branch on how many, which nobody can foresee: one of them again and again where there are fewer. */
static inline void copy_ids(const uint32_t *ids, uint32_t count, uint32_t *ret_ids)
{
    uint32_t second = count > 1, third = count > 2 ? 2 : 0;
    ret_ids[0] = ids[0];
    ret_ids[second] = ids[second];
    ret_ids[third] = ids[third];
    for (uint32_t i = 3; i < count; i++)
        ret_ids[i] = ids[i];
}

/* Below a node that becomes a leaf of several; returns how many primitives there are. */
static uint32_t copy_subtree(const struct clustering *c, uint32_t node, uint32_t *ret_ids)
{
    uint32_t waiting[32], count = 1, sum = 0;
    waiting[0] = node;
    while (count > 0) {
        uint32_t next = waiting[--count] & ~BECOMES_LEAF;
        const struct primitive_ref *at = node_at(c, next);
        if (next < c->leaf_count) {
            copy_ids(c->ids + at->id, at->link, ret_ids + sum);
            sum += at->link;
        } else {
            waiting[count++] = at->id;
            waiting[count++] = at->link;
        }
    }
    return sum;
}

struct emission {
    const struct clustering *c;
    struct ir *ir;
    struct emitted waiting[36];
    uint32_t waiting_count, depth;
    double cost;
};

/* Whether a node becomes a leaf cannot be foreseen: it is put where it would wait if it were none. */
static inline void emit_node(struct emission *e, uint32_t child, uint32_t ir_node, uint32_t level)
{
    const struct clustering *c = e->c;
    struct ir *ir = e->ir;
    const bool leaf = child >= BECOMES_LEAF;
    const uint32_t node = child & ~BECOMES_LEAF, first = ir->ref_count;
    const struct primitive_ref *ref = node_at(c, node);
    const struct vec4_box box = vec4_box_load(ref);
    uint32_t refs = 0;
    if (node >= c->leaf_count)
        refs = leaf ? copy_subtree(c, node, ir->refs + first) : 0;
    else
        copy_ids(c->ids + ref->id, refs = ref->link, ir->refs + first);
    vec4_box_put(box, &ir->boxes[0][ir_node]);
    ir->nodes[ir_node] = (struct ir_node){first, refs};
    ir->ref_count = first + refs;
    e->cost += vec4_box_half_area_double(box) * (leaf ? refs : 1);
    e->depth = level > e->depth ? level : e->depth;
    e->waiting[e->waiting_count] = (struct emitted){child, ir_node, level};
    e->waiting_count += !leaf;
}

/* The larger child waits while the smaller is written, so that at most 32 wait. */
static void emit(const struct clustering *c, struct ir *ir, uint32_t root, uint32_t *ret_depth, double *ret_cost)
{
    struct emission e = {.c = c, .ir = ir};
    ir->node_count = 1;
    ir->ref_count = 0;
    emit_node(&e, as_child(c, root), 0, 1);
    while (e.waiting_count > 0) {
        const struct emitted at = e.waiting[--e.waiting_count];
        const struct primitive_ref *ref = node_at(c, at.child);
        uint32_t pair = ir->node_count;
        ir->node_count += 2;
        ir->nodes[at.ir_node].first = pair;
        emit_node(&e, ref->link, pair, at.level + 1);
        emit_node(&e, ref->id, pair + 1, at.level + 1);
    }
    *ret_depth = e.depth;
    *ret_cost = e.cost;
}

static void place_row(struct row *row, float *floats, uint32_t *nodes, uint64_t stride)
{
    for (int axis = 0; axis < 3; axis++) {
        row->boxes.min[axis] = floats + (uint64_t)(2 * axis) * stride + NEAREST_PAD;
        row->boxes.max[axis] = floats + (uint64_t)(2 * axis + 1) * stride + NEAREST_PAD;
    }
    row->nodes = nodes;
}

/* One block of words, so that a piece costs one allocation: two rows, facts, keys, moves. */
static enum bvhd_status make_room(struct clustering *c, struct memory *memory)
{
    uint64_t n = c->request->count, stride = n + 2 * NEAREST_PAD;
    uint32_t *words = memory_array(
        memory, 12 * stride + 2 * (n + PACK_PAD) + 4 * n + LEAVES_REFS_MAX * (n + 1) + 3 * (n + 8) + n / 4 + 1 + PACK_PAD / 4,
        sizeof *words);
    if (!words)
        return BVHD_NO_MEMORY;
    c->room = words;
    float *floats = (float *)(void *)words;
    words += 12 * stride;
    place_row(&c->row, floats, words, stride);
    place_row(&c->next, floats + 6 * stride, words + n + PACK_PAD, stride);
    words += 2 * (n + PACK_PAD);
    c->facts = (struct node_facts *)(void *)words;
    words += 4 * n;
    c->ids = words;
    words += LEAVES_REFS_MAX * (n + 1);
    c->pairs = (struct move *)(void *)words;
    c->keys = (int32_t *)(void *)(words + 2 * (n + 8));
    c->kept = (uint8_t *)(void *)(words + 3 * (n + 8));
    return BVHD_OK;
}

/* Makes `count` refs of the row, from `first` on, the leaf `index`, which is not behind them. `ids` are listed before; returns how many it adds. */
static inline uint32_t make_leaf(struct clustering *c, uint32_t index, uint32_t first, uint32_t count, uint32_t ids)
{
    struct primitive_ref *leaf = &c->leaves[index];
    const struct primitive_ref *refs = &c->leaves[first];
    struct vec4_box box = vec4_box_load(refs);
    uint32_t primitives = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box other = vec4_box_load(&refs[i]);
        vec4_box_grow(&box, other.min, other.max);
        for (uint32_t k = 0; k < LEAVES_REFS_MAX; k++) /* there is room for more than are kept */
            c->ids[ids + primitives + k] = refs[i].id + k;
        primitives += refs[i].link + 1;
    }
    vec4_box_store(leaf, box);
    leaf->id = ids;
    leaf->link = primitives;
    put(&c->row, index, index, leaf);
    c->facts[index] = (struct node_facts){vec4_box_half_area(box) * (float)primitives, primitives & INT32_MAX, 1};
    return primitives;
}

static void make_leaves(struct clustering *c)
{
    uint32_t count = c->request->count, leaves = count;
    uint8_t *lengths = (uint8_t *)(void *)c->keys;
    const struct leaves_options options = {c->request->leaf_max, c->request->cut_cost};
    morton_sort(c->request->refs, count, c->room, c->leaves);
    if (c->request->cut_cost > 0)
        leaves = leaves_cut(c->leaves, count, &options, lengths);
    else
        memset(lengths, 1, count);
    for (uint32_t i = 0, first = 0, ids = 0; i < leaves; first += lengths[i++])
        ids += make_leaf(c, i, first, lengths[i], ids);
    c->count = c->node_count = c->leaf_count = leaves;
}

static enum bvhd_status make_tree(struct clustering *c, struct memory *memory, uint32_t *ret_root)
{
    enum bvhd_status status = make_room(c, memory);
    if (status != BVHD_OK)
        return status;
    make_leaves(c);
    if (!run_rounds(c))
        return BVHD_CANCELLED;
    if (c->count > 1)
        return divide_rest(c, memory, ret_root);
    *ret_root = c->row.nodes[0];
    return BVHD_OK;
}

enum bvhd_status ploc_build(const struct ploc_request *request, struct memory *memory, struct ir *ret_ir, uint32_t *ret_depth,
                            double *ret_cost, struct bvhd_error *error)
{
    struct clustering c = {.request = request, .leaves = request->scratch, .inner = request->refs};
    uint32_t root;
    enum bvhd_status status = make_tree(&c, memory, &root);
    if (status == BVHD_OK)
        status = ir_init(ret_ir, memory, 2 * c.leaf_count - 1, c.facts[root].refs, NULL);
    if (status == BVHD_OK)
        emit(&c, ret_ir, root, ret_depth, ret_cost);
    memory_free(memory, c.room);
    if (status == BVHD_OK)
        return BVHD_OK;
    return bvhd_error_set(error, status, "", status == BVHD_CANCELLED ? "cancelled" : "no memory to cluster %u primitives",
                          request->count);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/ir.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum bvhd_status ir_init(struct ir *ir, struct memory *memory, uint32_t nodes, uint32_t refs, struct bvhd_error *error)
{
    struct ir made = {.key_count = 1, .memory = memory};
    made.nodes = nodes ? memory_array(memory, nodes, sizeof *made.nodes) : NULL;
    made.boxes[0] = nodes ? memory_array(memory, nodes, sizeof *made.boxes[0]) : NULL;
    made.refs = refs ? memory_array(memory, refs, sizeof *made.refs) : NULL;
    if ((nodes && !(made.nodes && made.boxes[0])) || (refs && !made.refs)) {
        ir_finish(&made);
        return bvhd_error_no_memory(error, "", "no memory for a tree of %u nodes and %u references", nodes, refs);
    }
    *ir = made;
    return BVHD_OK;
}

void ir_finish(struct ir *ir)
{
    if (!ir || !ir->memory)
        return;
    memory_free(ir->memory, ir->nodes);
    for (int key = 0; key < IR_MAX_KEYS; key++)
        memory_free(ir->memory, ir->boxes[key]);
    memory_free(ir->memory, ir->refs);
    memset(ir, 0, sizeof *ir);
}

/* The state of ir_check(). Nodes are visited from the last to the first, so that children come before their parents. */
struct tree_check {
    const struct ir *ir;
    uint32_t primitive_count;
    const struct box *primitive_boxes;
    bool allow_split;
    struct span {
        uint32_t first, count; /* refs below the node; count 0: not visited yet */
    } * spans;
    unsigned char *seen_nodes; /* is the child of a visited node */
    unsigned char *seen_primitives;
    struct bvhd_error *error;
};

static enum bvhd_status broken(const struct tree_check *check, uint32_t node, const char *what)
{
    char where[40];
    snprintf(where, sizeof where, "nodes[%u]", node);
    return bvhd_error_set(check->error, BVHD_INTERNAL, where, "%s", what);
}

static bool box_is_finite(const struct box *box)
{
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(box->min[axis]) || !isfinite(box->max[axis]))
            return false;
    return !box_is_empty(box);
}

static bool box_overlaps(const struct box *a, const struct box *b)
{
    for (int axis = 0; axis < 3; axis++)
        if (a->max[axis] < b->min[axis] || a->min[axis] > b->max[axis])
            return false;
    return true;
}

static enum bvhd_status check_leaf(struct tree_check *check, uint32_t node)
{
    const struct ir *ir = check->ir;
    struct ir_node leaf = ir->nodes[node];
    if (leaf.first > ir->ref_count || leaf.count > ir->ref_count - leaf.first)
        return broken(check, node, "the leaf's references lie outside the array");
    for (uint32_t i = leaf.first; i < leaf.first + leaf.count; i++) {
        uint32_t id = ir->refs[i];
        if (id >= check->primitive_count)
            return broken(check, node, "a reference names no primitive");
        if (check->seen_primitives[id] && !check->allow_split)
            return broken(check, node, "a primitive is referenced twice");
        check->seen_primitives[id] = 1;
        for (uint32_t key = 0; check->primitive_boxes && key < ir->key_count; key++) {
            const struct box *box = &check->primitive_boxes[(uint64_t)key * check->primitive_count + id];
            const struct box *own = &ir->boxes[key][node];
            if (box_is_empty(box))
                return broken(check, node, "a reference names a primitive that is not in the tree");
            if (!(check->allow_split ? box_overlaps(own, box) : box_contains(own, box)))
                return broken(check, node, "the leaf's box does not hold a primitive");
        }
    }
    check->spans[node] = (struct span){leaf.first, leaf.count};
    return BVHD_OK;
}

static enum bvhd_status check_inner(struct tree_check *check, uint32_t node)
{
    const struct ir *ir = check->ir;
    uint32_t left = ir->nodes[node].first;
    if (left <= node || left >= ir->node_count - 1)
        return broken(check, node, "children do not follow their parent or lie outside the array");
    if (check->seen_nodes[left] || check->seen_nodes[left + 1])
        return broken(check, node, "a child has two parents");
    check->seen_nodes[left] = check->seen_nodes[left + 1] = 1;
    for (uint32_t key = 0; key < ir->key_count; key++)
        for (uint32_t child = left; child < left + 2; child++)
            if (!box_contains(&ir->boxes[key][node], &ir->boxes[key][child]))
                return broken(check, node, "the box does not hold a child's box");
    struct span a = check->spans[left], b = check->spans[left + 1];
    if (a.first + a.count != b.first && b.first + b.count != a.first)
        return broken(check, node, "the references below the node are not contiguous");
    check->spans[node] = (struct span){a.first < b.first ? a.first : b.first, a.count + b.count};
    return BVHD_OK;
}

static enum bvhd_status check_nodes(struct tree_check *check)
{
    const struct ir *ir = check->ir;
    for (uint32_t node = ir->node_count; node-- > 0;) {
        for (uint32_t key = 0; key < ir->key_count; key++)
            if (!box_is_finite(&ir->boxes[key][node]))
                return broken(check, node, "the box is empty or not finite");
        enum bvhd_status status = ir_is_leaf(ir, node) ? check_leaf(check, node) : check_inner(check, node);
        if (status != BVHD_OK)
            return status;
    }
    for (uint32_t node = 1; node < ir->node_count; node++)
        if (!check->seen_nodes[node])
            return broken(check, node, "the node is nobody's child");
    if (check->spans[0].first != 0 || check->spans[0].count != ir->ref_count)
        return broken(check, 0, "the leaves do not cover the references");
    return BVHD_OK;
}

static enum bvhd_status check_primitives(const struct tree_check *check)
{
    for (uint32_t id = 0; check->primitive_boxes && id < check->primitive_count; id++)
        if (!check->seen_primitives[id] && !box_is_empty(&check->primitive_boxes[id]))
            return bvhd_error_set(check->error, BVHD_INTERNAL, "refs", "primitive %u is not in the tree", id);
    return BVHD_OK;
}

static enum bvhd_status check_empty(const struct tree_check *check)
{
    return check->ir->ref_count ? bvhd_error_set(check->error, BVHD_INTERNAL, "refs", "references without a node")
                                : BVHD_OK;
}

static void *zeroed(struct memory *memory, uint64_t count, uint64_t size)
{
    void *block = memory_array(memory, count, size);
    return block ? memset(block, 0, count * size) : NULL;
}

enum bvhd_status ir_check(const struct ir *ir, uint32_t primitive_count, const struct box *primitive_boxes,
                          bool allow_split, struct memory *memory, struct bvhd_error *error)
{
    struct tree_check check = {ir, primitive_count, primitive_boxes, allow_split, .error = error};
    if (ir->key_count < 1 || ir->key_count > IR_MAX_KEYS)
        return bvhd_error_set(error, BVHD_INTERNAL, "", "a tree has 1 or 2 keys");
    /* One element more than needed, because a size of 0 could not be allocated. */
    check.spans = zeroed(memory, (uint64_t)ir->node_count + 1, sizeof *check.spans);
    check.seen_nodes = zeroed(memory, (uint64_t)ir->node_count + 1, 1);
    check.seen_primitives = zeroed(memory, (uint64_t)primitive_count + 1, 1);
    enum bvhd_status status;
    if (!check.spans || !check.seen_nodes || !check.seen_primitives)
        status = bvhd_error_no_memory(error, "", "no memory to check a tree");
    else
        status = ir->node_count ? check_nodes(&check) : check_empty(&check);
    if (status == BVHD_OK)
        status = check_primitives(&check);
    memory_free(memory, check.spans);
    memory_free(memory, check.seen_nodes);
    memory_free(memory, check.seen_primitives);
    return status;
}

double ir_sah_from(const struct ir *ir, double cost)
{
    double root = 0;
    for (uint32_t key = 0; ir->node_count > 0 && key < ir->key_count; key++)
        root += box_half_area(&ir->boxes[key][0]);
    return root > 0 ? cost / root : 0;
}

double ir_sah(const struct ir *ir)
{
    return ir_sah_from(ir, ir_cost(ir, 0, ir->node_count));
}

double ir_cost(const struct ir *ir, uint32_t first, uint32_t end)
{
    double cost = 0;
    for (uint32_t node = first; node < end; node++) {
        uint32_t count = ir->nodes[node].count;
        for (uint32_t key = 0; key < ir->key_count; key++)
            cost += box_half_area(&ir->boxes[key][node]) * (count ? count : 1);
    }
    return cost;
}

uint32_t ir_depth(const struct ir *ir, struct memory *memory)
{
    if (ir->node_count == 0)
        return 0;
    uint32_t *levels = memory_array(memory, ir->node_count, sizeof *levels);
    if (!levels)
        return IR_DEPTH_UNKNOWN;
    uint32_t depth = ir_levels(ir, levels);
    memory_free(memory, levels);
    return depth;
}

uint32_t ir_levels(const struct ir *ir, uint32_t *ret_levels)
{
    uint32_t depth = 1;
    ret_levels[0] = 1;
    for (uint32_t node = 0; node < ir->node_count; node++) {
        if (ir_is_leaf(ir, node))
            continue;
        uint32_t level = ret_levels[node] + 1;
        ret_levels[ir->nodes[node].first] = ret_levels[ir->nodes[node].first + 1] = level;
        depth = level > depth ? level : depth;
    }
    return depth;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/restore.h"

#include "builder/input/primitive.h"
#include "builder/kernel/vec4.h"
#include "proto/base/parallel.h"

/* Nodes between two checks of the cancel flag. */
enum { STRIDE = 16384 };

static void bound_leaf(const struct canonical *canonical, struct ir *ir, uint32_t node)
{
    const struct ir_node leaf = ir->nodes[node];
    struct box box = box_empty();
    for (uint32_t i = leaf.first; i < leaf.first + leaf.count; i++) {
        const uint32_t id = ir->refs[i];
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        const struct box own = primitive_box(canonical, geometry, id - geometry->first_primitive);
        box_grow(&box, &own);
    }
    ir->boxes[0][node] = box;
}

static void bound_inner(struct ir *ir, uint32_t node)
{
    const struct box *children = &ir->boxes[0][ir->nodes[node].first];
    ir->boxes[0][node] = children[0];
    box_grow(&ir->boxes[0][node], &children[1]);
}

/* Children follow their parents, so going backwards finds their boxes made. */
static bool restore_one_key(const struct canonical *canonical, const atomic_bool *cancel, struct ir *ir)
{
    for (uint32_t node = ir->node_count; node-- > 0;) {
        if (node % STRIDE == 0 && parallel_cancelled(cancel))
            return false;
        if (ir_is_leaf(ir, node))
            bound_leaf(canonical, ir, node);
        else
            bound_inner(ir, node);
    }
    return true;
}

static void box_of_children(const struct box *boxes, uint32_t first, struct vec4_box *ret_box)
{
    const struct vec4_box second = vec4_box_from(&boxes[first + 1]);
    *ret_box = vec4_box_from(&boxes[first]);
    vec4_box_grow(ret_box, second.min, second.max);
}

/* Leaves are mostly met in the order of their refs, from the last to the first. */
static void prefetch(struct primitive_finder *finder, const uint32_t *refs, struct ir_node leaf)
{
    static const uint32_t ahead[2] = {48, 24};
    for (int step = 0; step < 2; step++)
        if (leaf.first >= ahead[step])
            primitive_prefetch_keys(finder, refs + leaf.first - ahead[step], leaf.count, step);
}

/* Does the same for two keys, and sums up the cost. */
static bool restore_two_keys(const struct canonical *canonical, const atomic_bool *cancel, struct ir *ir,
                             double *ret_cost)
{
    struct primitive_finder finder = {.canonical = canonical};
    double cost = 0;
    for (uint32_t node = ir->node_count; node-- > 0;) {
        const struct ir_node own = ir->nodes[node];
        struct vec4_box boxes[2] = {vec4_box_empty(), vec4_box_empty()};
        if (node % STRIDE == 0 && parallel_cancelled(cancel))
            return false;
        if (own.count) {
            prefetch(&finder, ir->refs, own);
            primitive_grow_keys(&finder, ir->refs + own.first, own.count, boxes);
        }
        for (int key = 0; key < 2; key++) {
            if (!own.count)
                box_of_children(ir->boxes[key], own.first, &boxes[key]);
            vec4_box_put(boxes[key], &ir->boxes[key][node]);
            cost += vec4_box_half_area_double(boxes[key]) * (own.count ? own.count : 1);
        }
    }
    *ret_cost = cost;
    return true;
}

enum bvhd_status restore_boxes(const struct canonical *canonical, const atomic_bool *cancel, struct ir *ir,
                               double *ret_cost)
{
    if (!canonical_moves(canonical)) {
        if (!restore_one_key(canonical, cancel, ir))
            return BVHD_CANCELLED;
        *ret_cost = ir_cost(ir, 0, ir->node_count);
        return BVHD_OK;
    }
    if (ir->key_count == 1) {
        ir->boxes[1] = memory_array(ir->memory, ir->node_count, sizeof *ir->boxes[1]);
        if (!ir->boxes[1])
            return BVHD_NO_MEMORY;
        ir->key_count = 2;
    }
    return restore_two_keys(canonical, cancel, ir, ret_cost) ? BVHD_OK : BVHD_CANCELLED;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/restore.h"

#include "builder/input/primitive.h"

enum { CHUNK = 16384 };

struct restoring {
    const struct canonical *canonical;
    struct ir *ir;
};

static void bound_leaf(const struct restoring *restoring, uint32_t node)
{
    const struct canonical *canonical = restoring->canonical;
    struct ir *ir = restoring->ir;
    const struct ir_node leaf = ir->nodes[node];
    struct box boxes[IR_MAX_KEYS] = {box_empty(), box_empty()};
    for (uint32_t i = leaf.first; i < leaf.first + leaf.count; i++) {
        const uint32_t id = ir->refs[i];
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        struct box own[IR_MAX_KEYS];
        if (ir->key_count > 1)
            primitive_key_boxes(canonical, geometry, id - geometry->first_primitive, own);
        else
            own[0] = primitive_box(canonical, geometry, id - geometry->first_primitive);
        for (uint32_t key = 0; key < ir->key_count; key++)
            box_grow(&boxes[key], &own[key]);
    }
    for (uint32_t key = 0; key < ir->key_count; key++)
        ir->boxes[key][node] = boxes[key];
}

static void restore_chunk(void *context, size_t index)
{
    const struct restoring *restoring = context;
    const struct ir *ir = restoring->ir;
    size_t node, end;
    for (parallel_chunk(index, CHUNK, ir->node_count, &node, &end); node < end; node++)
        if (ir_is_leaf(ir, (uint32_t)node))
            bound_leaf(restoring, (uint32_t)node);
}

/* Returns false when cancelled. */
static bool bound_inner_nodes(struct ir *ir, const struct build_context *context)
{
    for (uint32_t node = ir->node_count; node-- > 0;) {
        if (node % CHUNK == 0 && context_cancelled(context))
            return false;
        for (uint32_t key = 0; key < ir->key_count && !ir_is_leaf(ir, node); key++) {
            const struct box *children = &ir->boxes[key][ir->nodes[node].first];
            ir->boxes[key][node] = children[0];
            box_grow(&ir->boxes[key][node], &children[1]);
        }
    }
    return true;
}

enum bvhd_status restore_boxes(const struct canonical *canonical, const struct build_context *context, struct ir *ir,
                               struct bvhd_error *error)
{
    struct restoring restoring = {canonical, ir};
    const size_t chunks = parallel_chunks(CHUNK, ir->node_count);
    if (canonical_moves(canonical) && ir->key_count == 1 && ir->node_count > 0) {
        ir->boxes[1] = memory_array(ir->memory, ir->node_count, sizeof *ir->boxes[1]);
        if (!ir->boxes[1])
            return bvhd_error_no_memory(error, "", "no memory for the boxes of %u nodes at t = 1", ir->node_count);
        ir->key_count = 2;
    }
    if (!parallel_for_until(context->parallel, context->cancel, chunks, restore_chunk, &restoring) ||
        !bound_inner_nodes(ir, context))
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    return BVHD_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "binned.h"

#include "bins.h"
#include "parallel.h"

/* A node on its way to being split. Refs move between the two arrays; a part lies in one of them. */
struct part {
    struct vec4_box bounds, centroids;
    struct primitive_ref *refs, *other; /* where it lies, where it may go */
    uint32_t node, first, count;
};

static void divide(const struct part *part, struct part ret_children[2])
{
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2];
    bool halved = !bins_find(part->refs, part->count, &part->centroids, &mapping, &plane);
    if (halved)
        bins_halve(part->refs, part->count, &plane, centroids);
    else
        bins_partition(&mapping, &plane, part->refs, part->count, part->other, part->other + plane.left_count, centroids);
    ret_children[0] = (struct part){
        .bounds = plane.left,
        .centroids = centroids[0],
        .refs = halved ? part->refs : part->other,
        .other = halved ? part->other : part->refs,
        .first = part->first,
        .count = plane.left_count,
    };
    ret_children[1] = (struct part){
        .bounds = plane.right,
        .centroids = centroids[1],
        .refs = ret_children[0].refs + plane.left_count,
        .other = ret_children[0].other + plane.left_count,
        .first = part->first + plane.left_count,
        .count = part->count - plane.left_count,
    };
}

static void make_leaf(struct ir *ir, const struct part *part)
{
    ir->nodes[part->node] = (struct ir_node){part->first, part->count};
    for (uint32_t i = 0; i < part->count; i++)
        ir->refs[part->first + i] = part->refs[i].id;
}

/* Nodes of more refs look at the cancel flag: below one there is a quarter of a millisecond's work. */
enum { LOOK_ABOVE = 512 };

/* The larger child waits while the smaller is split, so that at most 32 wait. False when cancelled. */
static bool split_to_end(struct ir *ir, struct part part, uint32_t leaf_max, const atomic_bool *cancel)
{
    struct part waiting[33], children[2];
    uint32_t waiting_count = 0;
    for (;;) {
        ir->boxes[0][part.node] = vec4_box_get(part.bounds);
        if (part.count <= leaf_max) {
            make_leaf(ir, &part);
            if (waiting_count == 0)
                return true;
            part = waiting[--waiting_count];
            continue;
        }
        if (part.count > LOOK_ABOVE && parallel_cancelled(cancel))
            return false;
        divide(&part, children);
        ir->nodes[part.node] = (struct ir_node){.first = ir->node_count};
        children[0].node = ir->node_count;
        children[1].node = ir->node_count + 1;
        ir->node_count += 2;
        bool right_first = children[1].count < children[0].count;
        waiting[waiting_count++] = children[!right_first];
        part = children[right_first];
    }
}

enum bvhd_status binned_build(const struct binned_request *request, struct memory *memory, struct ir *ret_ir, struct bvhd_error *error)
{
    struct ir ir;
    enum bvhd_status status = ir_init(&ir, memory, 2 * request->count - 1, request->count, error);
    if (status != BVHD_OK)
        return status;
    struct part root = {.refs = request->refs, .other = request->scratch, .count = request->count};
    bins_bound(request->refs, request->count, &root.bounds, &root.centroids);
    ir.node_count = 1;
    ir.ref_count = request->count;
    if (!split_to_end(&ir, root, request->leaf_max, request->cancel)) {
        ir_finish(&ir);
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    }
    *ret_ir = ir;
    return BVHD_OK;
}

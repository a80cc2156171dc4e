/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe_topology.h"

#include <inttypes.h>

#include "builder/format/lavapipe_bounds.h"
#include "builder/format/lavapipe_write.h"
#include "proto/base/place.h"

enum { KIND_MASK = 3, BOX = sizeof(struct lavapipe_box) };

struct tree_reader {
    const struct lavapipe_view *view;
    const struct canonical *canonical;
    struct ir *ir;
    uint32_t *places;
    struct bvhd_error *error;
};

static enum bvhd_status differs(const struct tree_reader *reading, const char *where, const char *text)
{
    return bvhd_error_set(reading->error, BVHD_UNSUPPORTED, where, "%s", text);
}

/*
 * Finds the primitive of a leaf: it is that of its place. An instance leaf states its number, because null instances
 * have no place.
 */
static enum bvhd_status identify(const struct tree_reader *reading, uint32_t reference, uint32_t *ret_id)
{
    const struct canonical *canonical = reading->canonical;
    uint32_t leaf = lavapipe_leaf_index(reading->view, reference), id = leaf;
    if (reading->view->kind == LAVAPIPE_INSTANCE)
        id = lavapipe_instance_at(reading->view, leaf).instance;
    if (id >= canonical->primitive_count)
        return differs(reading, place("leaf[%" PRIu32 "]", leaf).text, "is not one of the request's primitives");
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    static const uint8_t kinds[] = {[GEOMETRY_TRIANGLES] = LAVAPIPE_TRIANGLE,
                                    [GEOMETRY_AABBS] = LAVAPIPE_AABB,
                                    [GEOMETRY_INSTANCES] = LAVAPIPE_INSTANCE};
    bool null = geometry->type == GEOMETRY_INSTANCES &&
                canonical_instance(geometry, id - geometry->first_primitive).reference == 0;
    if (kinds[geometry->type] != reading->view->kind || null)
        return differs(reading, place("leaf[%" PRIu32 "]", leaf).text,
                       "is of another kind than the request's primitive");
    *ret_id = id;
    return BVHD_OK;
}

/* Makes ir node `node` from a reference: a leaf, or an inner node whose children are added later. */
static enum bvhd_status add_node(struct tree_reader *reading, uint32_t node, uint32_t reference)
{
    struct ir *ir = reading->ir;
    if ((reference & KIND_MASK) == LAVAPIPE_BOX) {
        uint32_t box = ((reference & ~(uint32_t)KIND_MASK) - LAVAPIPE_HEADER) / BOX;
        reading->places[node] = box;
        ir->nodes[node] = (struct ir_node){0, 0};
        return BVHD_OK;
    }
    uint32_t id;
    enum bvhd_status status = identify(reading, reference, &id);
    if (status != BVHD_OK)
        return status;
    ir->boxes[0][node] = lavapipe_bounds_leaf(reading->canonical, id);
    /* `first` holds the primitive until number_refs replaces it. */
    ir->nodes[node] = (struct ir_node){.first = id, .count = 1};
    return BVHD_OK;
}

static enum bvhd_status add_children(struct tree_reader *reading, uint32_t node)
{
    struct ir *ir = reading->ir;
    struct lavapipe_box box = lavapipe_box_at(reading->view, LAVAPIPE_HEADER + reading->places[node] * BOX);
    if (box.children[0] == LAVAPIPE_NONE || box.children[1] == LAVAPIPE_NONE)
        return differs(reading, place("node[%" PRIu32 "]", reading->places[node]).text, "has fewer than two children");
    ir->nodes[node].first = ir->node_count;
    ir->node_count += 2;
    enum bvhd_status status = add_node(reading, ir->node_count - 2, box.children[0]);
    return status == BVHD_OK ? add_node(reading, ir->node_count - 1, box.children[1]) : status;
}

/* Adds the nodes in breadth-first order, so that children follow their parents and siblings are adjacent. */
static enum bvhd_status add_tree(struct tree_reader *reading)
{
    struct ir *ir = reading->ir;
    struct lavapipe_box root = lavapipe_box_at(reading->view, LAVAPIPE_HEADER);
    ir->node_count = 0;
    if (root.children[0] == LAVAPIPE_NONE && root.children[1] == LAVAPIPE_NONE)
        return BVHD_OK;
    ir->node_count = 1;
    if (root.children[1] == LAVAPIPE_NONE && (root.children[0] & KIND_MASK) == LAVAPIPE_BOX)
        return differs(reading, "node[0]", "has fewer than two children");
    if (root.children[1] == LAVAPIPE_NONE)
        return add_node(reading, 0, root.children[0]);
    enum bvhd_status status = add_node(reading, 0, LAVAPIPE_HEADER | LAVAPIPE_BOX);
    for (uint32_t node = 0; status == BVHD_OK && node < ir->node_count; node++)
        if (!ir_is_leaf(ir, node))
            status = add_children(reading, node);
    return status;
}

/* Numbers the refs in depth-first order, so that the refs below any node are contiguous. */
static void number_refs(struct ir *ir)
{
    uint32_t waiting[LAVAPIPE_MAX_LEVELS + 2], count = 0;
    if (ir->node_count > 0)
        waiting[count++] = 0;
    while (count > 0) {
        struct ir_node *node = &ir->nodes[waiting[--count]];
        if (node->count > 0) {
            ir->refs[ir->ref_count] = node->first;
            node->first = ir->ref_count++;
        } else {
            waiting[count++] = node->first + 1;
            waiting[count++] = node->first;
        }
    }
}

static void join_boxes(struct ir *ir)
{
    for (uint32_t node = ir->node_count; node-- > 0;)
        if (!ir_is_leaf(ir, node)) {
            const struct box *first = &ir->boxes[0][ir->nodes[node].first];
            ir->boxes[0][node] = lavapipe_bounds_join(first, first + 1);
        }
}

/* A writer reserves this many boxes; a box beyond them would not be written to the same place. */
static enum bvhd_status check_places(const struct tree_reader *reading)
{
    const struct ir *ir = reading->ir;
    uint32_t room = lavapipe_box_room(reading->canonical->primitive_count), inner = ir->node_count / 2;
    for (uint32_t node = 0; node < ir->node_count; node++)
        if (!ir_is_leaf(ir, node) && reading->places[node] >= (room > inner ? room : inner))
            return differs(reading, place("node[%" PRIu32 "]", reading->places[node]).text,
                           "lies beyond the boxes of the request");
    return BVHD_OK;
}

static enum bvhd_status read_tree(struct tree_reader *reading)
{
    enum bvhd_status status = add_tree(reading);
    if (status != BVHD_OK)
        return status;
    number_refs(reading->ir);
    join_boxes(reading->ir);
    return check_places(reading);
}

enum bvhd_status lavapipe_topology_read(const struct lavapipe_view *view, const struct canonical *canonical,
                                        struct memory *memory, struct lavapipe_topology *ret_topology,
                                        struct bvhd_error *error)
{
    /* The walk meets each box once, so there are at most twice as many children, and the root. */
    uint32_t boxes = (view->leaf_offset - LAVAPIPE_HEADER) / BOX;
    struct lavapipe_topology topology = {.memory = memory};
    enum bvhd_status status = ir_init(&topology.ir, memory, 2 * boxes + 1, boxes + 1, error);
    if (status != BVHD_OK)
        return status;
    topology.places = memory_array(memory, 2 * (uint64_t)boxes + 1, sizeof *topology.places);
    struct tree_reader reading = {
        .view = view, .canonical = canonical, .ir = &topology.ir, .places = topology.places, .error = error};
    topology.ir.key_count = 1;
    if (topology.places)
        status = read_tree(&reading);
    else
        status = bvhd_error_no_memory(error, "nodes", "no memory for the places of %" PRIu32 " boxes", boxes);
    if (status == BVHD_OK)
        *ret_topology = topology;
    else
        lavapipe_topology_finish(&topology);
    return status;
}

void lavapipe_topology_finish(struct lavapipe_topology *topology)
{
    if (!topology)
        return;
    ir_finish(&topology->ir);
    if (topology->places)
        memory_free(topology->memory, topology->places);
    topology->places = NULL;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_head.h"
#include "builder/format/portable_micromaps.h"
#include "builder/format/portable_quantise.h"
#include "builder/update/portable_tree.h"
#include "builder/update/refit_vertices.h"
#include "builder/update/update_kind.h"

/* The state of one refit, or of one measurement, for which only the first part is set. */
struct portable_refit {
    const struct build_context *context;
    struct portable_view source;
    struct refit_node *nodes; /* for each node of the source */
    double leaf_cost;
    bool moves; /* nodes have boxes at t = 0 and at t = 1 */

    const struct canonical *canonical;
    const struct update_kind *kind; /* of the records */
    struct refit_node *end_nodes; /* their boxes at t = 1, if it moves */
    struct portable_header header;
    unsigned char *blob, *body;
    struct refit_records records;
    bool avx2; /* this machine has AVX2 */
};

static enum portable_content content_of(const struct record *record)
{
    return record_content_for(record->header->type, record_type_of(record), record->header->layout_flags);
}

static enum bvhd_status check_source(const struct portable_refit *refit, struct bvhd_error *error)
{
    const struct portable_header *header = refit->source.header;
    const struct record_header *record = refit->records.record->header;
    const uint32_t geometries = record->type == STRUCTURE_TOP ? 0 : record->geometry_count;
    if (header->content != content_of(refit->records.record))
        return bvhd_error_set(error, BVHD_CORRUPT, "body.content", "not that of the record");
    if ((header->version == PORTABLE_MICROMAP_VERSION) != (refit->records.record->micromaps != NULL))
        return bvhd_error_set(error, BVHD_CORRUPT, "body.version", "not that of the record");
    if (header->primitive_count != record->primitive_count)
        return bvhd_error_set(error, BVHD_CORRUPT, "body.primitiveCount", "not that of the record");
    if (header->geometry_count != geometries)
        return bvhd_error_set(error, BVHD_CORRUPT, "body.geometryCount", "not that of the record");
    return BVHD_OK;
}

/*
 * Finds the boxes of a node's children at one key, an empty slot's being that of another one, and the box around them.
 * `nodes` has those of inner children.
 */
static void gather_boxes(const struct refit_node *nodes, const struct portable_node *node,
                         const struct portable_shape *shape, const struct refit_node leaves[8],
                         const struct box *ret_boxes[8], struct box *ret_all)
{
    const struct box *const filler =
        shape->inner ? &nodes[node->first_child].box : &leaves[__builtin_ctz(shape->occupied)].box;
    struct vec4_box all = vec4_box_empty();
    uint32_t child = node->first_child;
    for (unsigned slot = 0; slot < 8; slot++) {
        ret_boxes[slot] = filler;
        if (shape->inner >> slot & 1) {
            ret_boxes[slot] = &nodes[child++].box;
        } else if (shape->counts[slot] > 0) {
            ret_boxes[slot] = &leaves[slot].box;
        } else {
            continue;
        }
        const struct vec4_box own = vec4_box_from(ret_boxes[slot]);
        vec4_box_grow(&all, own.min, own.max);
    }
    vec4_box_put(all, ret_all);
}

/* Gives node `index` of the result its boxes; `source` is that of the source. */
static void fit_still(const struct portable_refit *refit, const struct portable_node *source,
                      const struct portable_shape *shape, uint32_t index, struct portable_node *node)
{
    struct refit_node leaves[8];
    const struct box *boxes[8];
    refit->kind->boxes(&refit->records, source->first_record, shape->counts, leaves);
    gather_boxes(refit->nodes, source, shape, leaves, boxes, &refit->nodes[index].box);
    portable_quantise_boxes(boxes, shape->occupied, refit->avx2, node);
}

static void fit_moving(const struct portable_refit *refit, const struct portable_node *source,
                       const struct portable_shape *shape, uint32_t index, struct portable_node *node)
{
    struct refit_node leaves[2][8];
    const struct box *start[8], *end[8];
    refit->kind->key_boxes(&refit->records, source->first_record, shape->counts, leaves);
    gather_boxes(refit->nodes, source, shape, leaves[0], start, &refit->nodes[index].box);
    gather_boxes(refit->end_nodes, source, shape, leaves[1], end, &refit->end_nodes[index].box);
    portable_quantise_moving_boxes(start, end, shape->occupied, refit->avx2,
                                   (struct portable_moving_node *)(void *)node);
}

static double cost_of(const struct portable_refit *refit, const struct portable_node *node,
                      const struct portable_shape *shape)
{
    double cost = portable_tree_node_cost(node, refit->moves, shape, refit->leaf_cost);
    for (uint32_t i = 0; i < (uint32_t)__builtin_popcount(shape->inner); i++)
        cost += refit->nodes[node->first_child + i].cost;
    return cost;
}

static struct portable_node *written_node(const struct portable_refit *refit, uint32_t index)
{
    void *node = refit->body + refit->header.node_offset + (uint64_t)index * refit->source.node_size;
    return node;
}

static bool refit_node(void *context, uint32_t index, uint32_t end)
{
    const struct portable_refit *refit = context;
    const struct portable_node *source = portable_node_at(&refit->source, index);
    struct portable_shape shape;
    if (!portable_tree_read(&refit->source, index, end, &shape) ||
        !refit->kind->write(&refit->records, source->first_record, shape.records))
        return false;
    struct portable_node *node = written_node(refit, index);
    if (refit->moves)
        fit_moving(refit, source, &shape, index, node);
    else
        fit_still(refit, source, &shape, index, node);
    memcpy(node->meta, source->meta, sizeof node->meta);
    node->inner_mask = source->inner_mask;
    node->first_child = source->first_child;
    node->first_record = source->first_record;
    refit->nodes[index].cost = cost_of(refit, node, &shape);
    return true;
}

static bool measure_node(void *context, uint32_t index, uint32_t end)
{
    const struct portable_refit *refit = context;
    struct portable_shape shape;
    if (!portable_tree_read(&refit->source, index, end, &shape))
        return false;
    refit->nodes[index].cost = cost_of(refit, portable_node_at(&refit->source, index), &shape);
    return true;
}

/*
 * Returns the cost of a tree with this root. Bounds are around both keys of what moves, so that the areas of each are
 * those of the root's own boxes.
 */
static double cost_over(const struct portable_refit *refit, const struct portable_node *root, const struct box *bounds)
{
    const double sum = refit->nodes[0].cost;
    if (!refit->moves)
        return refit_cost_of(sum, box_half_area(bounds));
    return refit_cost_of(sum, portable_tree_moving_area((const struct portable_moving_node *)(const void *)root));
}

static enum bvhd_status report_corrupt(uint32_t node, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CORRUPT, place("nodes[%u]", node).text,
                          "not a node of a tree in depth-first order, or its records are not those of the request");
}

static enum bvhd_status sweep_parts(struct portable_refit *refit, struct subtrees *subtrees, subtrees_visit visit,
                                    struct bvhd_error *error)
{
    uint32_t corrupt = 0;
    bool in_order = portable_tree_cut(&refit->source, subtrees);
    if (subtrees->out_of_memory)
        return bvhd_error_no_memory(error, "nodes", "no memory for the parts of the tree");
    if (!in_order)
        return bvhd_error_set(error, BVHD_CORRUPT, "nodes", "not in depth-first order");
    enum bvhd_status status = subtrees_sweep(subtrees, refit->context, visit, refit, &corrupt);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
    return status == BVHD_OK ? BVHD_OK : report_corrupt(corrupt, error);
}

/* Visits all nodes; there is at least one. Costs need the first array of nodes alone. */
static enum bvhd_status sweep(struct portable_refit *refit, subtrees_visit visit, struct bvhd_error *error)
{
    struct memory *memory = refit->context->memory;
    const uint32_t count = refit->source.header->node_count;
    const bool has_end = refit->moves && visit == refit_node;
    struct subtrees subtrees;
    refit->nodes = memory_array(memory, has_end ? 2 * (uint64_t)count : count, sizeof *refit->nodes);
    if (!refit->nodes)
        return bvhd_error_no_memory(error, "nodes", "no memory for the boxes of %u nodes", count);
    refit->end_nodes = has_end ? refit->nodes + count : NULL;
    subtrees_init(&subtrees, count, memory);
    enum bvhd_status status = sweep_parts(refit, &subtrees, visit, error);
    subtrees_finish(&subtrees);
    return status;
}

static enum bvhd_status fill_tree(struct portable_refit *refit, struct refit_output *output, struct bvhd_error *error)
{
    if (refit->header.node_count == 0)
        return BVHD_OK;
    float *vertices = (float *)(void *)(refit->body + refit->header.vertex_offset);
    refit->records.vertices = vertices;
    enum bvhd_status status = refit_vertices(refit->records.written.kind, refit->canonical, refit->records.record,
                                             refit->context, vertices, refit->header.vertex_count, error);
    if (status == BVHD_OK)
        status = sweep(refit, refit_node, error);
    if (status != BVHD_OK)
        return status;
    output->bounds = refit->nodes[0].box;
    if (refit->moves)
        box_grow(&output->bounds, &refit->end_nodes[0].box);
    output->cost = cost_over(refit, written_node(refit, 0), &output->bounds);
    memcpy(refit->header.bounds, output->bounds.min, sizeof output->bounds.min);
    memcpy(refit->header.bounds + 3, output->bounds.max, sizeof output->bounds.max);
    return BVHD_OK;
}

static uint64_t geometry_end_of(const struct portable_header *header)
{
    return header->version == PORTABLE_MICROMAP_VERSION
               ? header->geometry_offset + (uint64_t)header->geometry_count * sizeof(struct portable_geometry)
               : header->body_size;
}

/* Copies what the source has between two sections, and its geometries; the micromaps are those of the update. */
static void copy_rest(const struct portable_refit *refit)
{
    const struct portable_header *header = &refit->header;
    const struct record_kind *kind = refit->records.written.kind;
    const unsigned char *source = (const unsigned char *)refit->source.header;
    const uint64_t sections[][2] = {
        {header->node_offset, (uint64_t)header->node_count * kind->node_size},
        {header->record_offset, (uint64_t)header->record_count * kind->size},
        {header->vertex_offset, (uint64_t)header->vertex_count * kind->vertex_size},
    };
    uint64_t end = sizeof *header;
    for (int i = 0; i < 3; i++) {
        memcpy(refit->body + end, source + end, sections[i][0] - end);
        end = sections[i][0] + sections[i][1];
    }
    memcpy(refit->body + end, source + end, geometry_end_of(header) - end);
    memcpy(refit->body, header, sizeof *header);
    portable_micromaps_write(refit->canonical, header, refit->body);
    struct portable_geometry *geometries = (void *)(refit->body + header->geometry_offset);
    for (uint32_t g = 0; g < header->geometry_count; g++)
        geometries[g].micromap = portable_micromaps_of(&refit->canonical->geometries[g]);
}

static enum bvhd_status write_blob(struct portable_refit *refit, struct refit_output *output, struct bvhd_error *error)
{
    const uint32_t handles = portable_head_handles(&refit->header, refit->canonical);
    output->sizes = portable_head_sizes(&refit->header, handles);
    refit->blob = output_allocate(refit->context->output, refit->context->memory, output->sizes.total, error);
    if (!refit->blob)
        return BVHD_NO_MEMORY;
    refit->body = refit->blob + portable_head_body(&refit->header, handles);
    refit->records.written = (struct portable_records){
        .kind = record_kind_of(refit->header.content),
        .canonical = refit->canonical,
        .records = refit->body + refit->header.record_offset,
    };
    enum bvhd_status status = fill_tree(refit, output, error);
    memory_free(refit->context->memory, refit->nodes);
    if (status != BVHD_OK) {
        output_discard(refit->context->output, refit->context->memory, refit->blob);
        return status;
    }
    copy_rest(refit);
    portable_head_write(refit->blob, &refit->header, handles);
    return BVHD_OK;
}

enum bvhd_status refit_portable(const struct refit_request *request, const struct build_context *context,
                                struct refit_output *ret_output, struct bvhd_error *error)
{
    struct portable_refit refit = {.context = context, .canonical = request->canonical, .avx2 = portable_has_avx2()};
    refit.records.record = request->record;
    refit.records.source = &refit.source;
    enum bvhd_status status = portable_open_sections(request->source, &refit.source, error);
    if (status == BVHD_OK)
        status = check_source(&refit, error);
    if (status != BVHD_OK)
        return status;
    struct refit_output output = {.bounds = box_empty()};
    refit.header = *refit.source.header;
    if (refit.header.version == PORTABLE_MICROMAP_VERSION) {
        refit.header.body_size = geometry_end_of(&refit.header);
        portable_micromaps_count(refit.canonical, &refit.header);
        portable_micromaps_place(&refit.header);
    }
    const struct record_kind *kind = record_kind_of(refit.header.content);
    refit.kind = update_kind_of(kind->type);
    refit.leaf_cost = (double)kind->cost;
    refit.moves = record_kind_moves(kind);
    status = write_blob(&refit, &output, error);
    if (status != BVHD_OK)
        return status;
    output.blob = refit.blob;
    *ret_output = output;
    return BVHD_OK;
}

enum bvhd_status refit_portable_cost(struct bytes blob, const struct build_context *context, double *ret_cost,
                                     struct bvhd_error *error)
{
    struct portable_refit refit = {.context = context};
    enum bvhd_status status = portable_open_sections(blob, &refit.source, error);
    if (status != BVHD_OK)
        return status;
    const struct portable_header *header = refit.source.header;
    double cost = 0;
    refit.leaf_cost = (double)record_kind_of(header->content)->cost;
    refit.moves = record_kind_moves(record_kind_of(header->content));
    if (header->node_count > 0) {
        status = sweep(&refit, measure_node, error);
        struct box root;
        memcpy(root.min, header->bounds, sizeof root.min);
        memcpy(root.max, header->bounds + 3, sizeof root.max);
        cost = status == BVHD_OK ? cost_over(&refit, refit.source.nodes, &root) : 0;
        memory_free(context->memory, refit.nodes);
    }
    if (status == BVHD_OK)
        *ret_cost = cost;
    return status;
}

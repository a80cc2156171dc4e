/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe_bounds.h"
#include "builder/format/lavapipe_write.h"
#include "builder/format/serialized.h"
#include "builder/input/primitive.h"
#include "builder/update/lavapipe_tree.h"
#include "builder/update/refit_internal.h"
#include "proto/base/place.h"

enum { LEAF_CHUNK = 8192, PREFETCH_AHEAD = 12, BOX = sizeof(struct lavapipe_box) };

/* The state of one refit, or of one measurement, for which only the first three are set. */
struct lavapipe_refit {
    const struct build_context *context;
    struct lavapipe_view source;
    struct refit_node *nodes; /* for each box node of the source */

    struct canonical canonical; /* a view that ignores slabs, as instance boxes need it */
    const struct record *record; /* of `canonical` */
    enum lavapipe_variant variant;
    struct lavapipe_leaves leaves;
    unsigned char *blob, *body;
    uint32_t box_count; /* of the tree */
};

/* Boxes that are stored a bit larger than the largest float are infinite. */
static double area_of(const struct lavapipe_box *box, int child)
{
    struct box bounds;
    memcpy(&bounds, &box->bounds[child], sizeof bounds);
    bounds = vec4_box_get(refit_box_finite(vec4_box_from(&bounds)));
    return box_half_area(&bounds);
}

/* Returns the cost of a node's children, whose own are known for those that are boxes in (node, end). */
static double cost_of(const struct lavapipe_refit *refit, const struct lavapipe_box *box, uint32_t node, uint32_t end)
{
    double cost = 0;
    for (int i = 0; i < 2; i++) {
        if (box->children[i] == LAVAPIPE_NONE)
            continue;
        const uint32_t child = lavapipe_tree_child(box->children[i], node, end);
        cost += area_of(box, i) + (child == LAVAPIPE_NONE ? 0 : refit->nodes[child].cost);
    }
    return cost;
}

static struct vec4_box box_of_triangle(const struct lavapipe_triangle *leaf)
{
    const vec4 a = vec4_load3(leaf->corners[0]), b = vec4_load3(leaf->corners[1]), c = vec4_load3(leaf->corners[2]);
    return refit_box_finite((struct vec4_box){vec4_min(c, vec4_min(b, a)), vec4_max(c, vec4_max(b, a))});
}

static struct box box_of_instance(const struct canonical *canonical, uint32_t instance)
{
    struct box box = primitive_box(canonical, canonical->geometries, instance);
    const struct box drivers = lavapipe_bounds_leaf(canonical, instance);
    lavapipe_bounds_grow(&box, &drivers);
    return box;
}

/* Computes the box of a leaf that has been written. Returns false if it is of an inactive primitive. */
static bool box_of_leaf(const struct lavapipe_refit *refit, uint32_t leaf, struct box *ret_box)
{
    const struct lavapipe_view own = {.body = refit->body, .leaf_offset = refit->source.leaf_offset};
    if (refit->leaves.kind == LAVAPIPE_INSTANCE) {
        const uint32_t instance = lavapipe_instance_at(&own, leaf).instance;
        if (!record_is_active(refit->record, instance))
            return false;
        *ret_box = box_of_instance(&refit->canonical, instance);
        return true;
    }
    if (!record_is_active(refit->record, leaf))
        return false;
    if (refit->leaves.kind == LAVAPIPE_TRIANGLE) {
        const struct lavapipe_triangle triangle = lavapipe_triangle_at(&own, leaf);
        vec4_box_put(box_of_triangle(&triangle), ret_box);
    } else {
        const struct lavapipe_aabb aabb = lavapipe_aabb_at(&own, leaf);
        vec4_box_put(refit_box_finite((struct vec4_box){vec4_load3(aabb.min), vec4_load3(aabb.max)}), ret_box);
    }
    return true;
}

/* Finds the box of a child. Returns false for a reference that leads nowhere. */
static bool box_of_child(const struct lavapipe_refit *refit, uint32_t reference, uint32_t node, uint32_t end,
                         struct box *ret_box)
{
    const uint32_t child = lavapipe_tree_child(reference, node, end);
    if (child != LAVAPIPE_NONE) {
        *ret_box = refit->nodes[child].box;
        return true;
    }
    const uint32_t leaf = lavapipe_tree_leaf(&refit->source, reference, refit->leaves.kind, refit->leaves.count);
    return leaf != LAVAPIPE_NONE && box_of_leaf(refit, leaf, ret_box);
}

/* Leaves are in the order of the request, so that those of neighbouring boxes are far apart in memory. */
static void prefetch_leaves(const struct lavapipe_refit *refit, uint32_t node)
{
    const struct lavapipe_box box = lavapipe_tree_box(&refit->source, node);
    for (int i = 0; i < 2; i++)
        if (box.children[i] < refit->source.body_size) {
            __builtin_prefetch(refit->body + box.children[i]);
            __builtin_prefetch(refit->body + box.children[i] + 32);
        }
}

static bool refit_node(void *context, uint32_t node, uint32_t end)
{
    const struct lavapipe_refit *refit = context;
    if (node >= PREFETCH_AHEAD)
        prefetch_leaves(refit, node - PREFETCH_AHEAD);
    struct lavapipe_box box = lavapipe_tree_box(&refit->source, node);
    struct box all = box_empty();
    for (int i = 0; i < 2; i++) {
        struct box own;
        if (box.children[i] == LAVAPIPE_NONE)
            continue;
        if (!box_of_child(refit, box.children[i], node, end, &own))
            return false;
        box_grow(&all, &own);
        lavapipe_child_bounds(&refit->leaves, refit->variant, &own, (float *)&box.bounds[i]);
    }
    refit->nodes[node].box = all;
    refit->nodes[node].cost = cost_of(refit, &box, node, end);
    memcpy(refit->body + LAVAPIPE_HEADER + (uint64_t)node * BOX, &box, sizeof box);
    return true;
}

static bool measure_node(void *context, uint32_t node, uint32_t end)
{
    const struct lavapipe_refit *refit = context;
    const struct lavapipe_box box = lavapipe_tree_box(&refit->source, node);
    refit->nodes[node].cost = cost_of(refit, &box, node, end);
    return true;
}

static enum bvhd_status sweep_parts(struct lavapipe_refit *refit, struct subtrees *subtrees, subtrees_visit visit,
                                    struct bvhd_error *error)
{
    uint32_t corrupt = 0;
    bool in_order = lavapipe_tree_cut(&refit->source, refit->box_count, subtrees);
    if (subtrees->out_of_memory)
        return bvhd_error_no_memory(error, "nodes", "no memory for the parts of the tree");
    if (!in_order)
        return bvhd_error_set(error, BVHD_CORRUPT, "node", "not in depth-first order");
    enum bvhd_status status = subtrees_sweep(subtrees, refit->context, visit, refit, &corrupt);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
    return status == BVHD_OK ? BVHD_OK
                             : bvhd_error_set(error, BVHD_CORRUPT, place("node[%u]", corrupt).text,
                                              "a child is no node behind it and no leaf of an active primitive");
}

static enum bvhd_status sweep(struct lavapipe_refit *refit, subtrees_visit visit, struct bvhd_error *error)
{
    struct memory *memory = refit->context->memory;
    struct subtrees subtrees;
    refit->box_count = lavapipe_tree_count(&refit->source);
    refit->nodes = memory_array(memory, refit->box_count, sizeof *refit->nodes);
    if (!refit->nodes)
        return bvhd_error_no_memory(error, "nodes", "no memory for the boxes of %u nodes", refit->box_count);
    subtrees_init(&subtrees, refit->box_count, memory);
    enum bvhd_status status = sweep_parts(refit, &subtrees, visit, error);
    subtrees_finish(&subtrees);
    return status;
}

static void write_leaves(void *context, size_t index)
{
    const struct lavapipe_refit *refit = context;
    size_t begin, end;
    parallel_chunk(index, LEAF_CHUNK, refit->canonical.primitive_count, &begin, &end);
    lavapipe_leaves_write(&refit->leaves, (uint32_t)begin, (uint32_t)end, refit->body + refit->source.leaf_offset,
                          refit->blob + SERIALIZED_HANDLES);
}

static enum bvhd_status fill(struct lavapipe_refit *refit, struct refit_output *output, struct bvhd_error *error)
{
    const struct build_context *context = refit->context;
    size_t chunks = parallel_chunks(LEAF_CHUNK, refit->canonical.primitive_count);
    if (!parallel_for_until(context->parallel, context->cancel, chunks, write_leaves, refit))
        return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
    enum bvhd_status status = sweep(refit, refit_node, error);
    if (status != BVHD_OK)
        return status;
    output->bounds = refit->nodes[0].box;
    output->cost = refit_cost_of(refit->nodes[0].cost, box_half_area(&output->bounds));
    return BVHD_OK;
}

/* Copies what the source has between its box nodes and its leaves, and after them, and its headers. */
static void copy_rest(const struct lavapipe_refit *refit, const unsigned char *source_blob,
                      const struct refit_output *output)
{
    const struct lavapipe_view *source = &refit->source;
    const uint64_t boxes_end = LAVAPIPE_HEADER + (uint64_t)refit->box_count * BOX,
                   leaves_end =
                       source->leaf_offset + (uint64_t)refit->leaves.count * lavapipe_leaf_size(refit->leaves.kind);
    memcpy(refit->blob, source_blob, SERIALIZED_HANDLES);
    memcpy(refit->body, source->body, LAVAPIPE_HEADER);
    memcpy(refit->body + boxes_end, source->body + boxes_end, source->leaf_offset - boxes_end);
    memcpy(refit->body + leaves_end, source->body + leaves_end, source->body_size - leaves_end);
    if (box_is_empty(&output->bounds))
        return;
    float bounds[6];
    lavapipe_root_bounds(&refit->leaves, &output->bounds, bounds);
    memcpy(refit->body, bounds, sizeof bounds);
}

static enum bvhd_status check_source(const struct lavapipe_refit *refit, const struct device_format *device,
                                     struct bvhd_error *error)
{
    const struct lavapipe_view *source = &refit->source;
    const uint64_t leaves = (uint64_t)refit->leaves.count * lavapipe_leaf_size(refit->leaves.kind);
    if (memcmp(&source->device, device, sizeof *device) != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.driverUUID", "not the device of the record");
    if (leaves > source->body_size - source->leaf_offset)
        return bvhd_error_set(error, BVHD_CORRUPT, "body.leafNodesOffset", "no room for the leaves of the record");
    return BVHD_OK;
}

static enum bvhd_status write_blob(struct lavapipe_refit *refit, struct bytes source, struct refit_output *output,
                                   struct bvhd_error *error)
{
    refit->blob = output_allocate(refit->context->output, refit->context->memory, source.size, error);
    if (!refit->blob)
        return BVHD_NO_MEMORY;
    refit->body = refit->blob + (source.size - refit->source.body_size);
    enum bvhd_status status = fill(refit, output, error);
    memory_free(refit->context->memory, refit->nodes);
    if (status != BVHD_OK) {
        output_discard(refit->context->output, refit->context->memory, refit->blob);
        return status;
    }
    copy_rest(refit, source.data, output);
    output->blob = refit->blob;
    output->sizes = (struct layout_sizes){
        .total = source.size,
        .header = source.size - refit->source.body_size + LAVAPIPE_HEADER,
        .nodes = refit->source.leaf_offset - LAVAPIPE_HEADER,
        .records = refit->source.body_size - refit->source.leaf_offset,
    };
    return BVHD_OK;
}

/* An inactive instance with a reference has a leaf and a handle; that must not change either. */
static enum bvhd_status find_leaves(struct lavapipe_refit *refit, const struct device_format *device,
                                    struct bvhd_error *error)
{
    const struct layout_input input = {
        .canonical = &refit->canonical,
        .device = device,
        .memory = refit->context->memory,
        .cancel = refit->context->cancel,
    };
    enum bvhd_status status = lavapipe_leaves_init(&refit->leaves, &input, error);
    if (status != BVHD_OK || refit->leaves.handle_count == refit->source.handle_count)
        return status;
    lavapipe_leaves_finish(&refit->leaves);
    return bvhd_error_set(error, BVHD_UNSUPPORTED, "geometries[0].instances",
                          "an inactive instance without a reference gets one, or the reverse");
}

enum bvhd_status refit_lavapipe(const struct refit_request *request, const struct build_context *context,
                                struct refit_output *ret_output, struct bvhd_error *error)
{
    const struct device_format *device = &request->record->header->device;
    struct lavapipe_refit refit = {.context = context,
                                   .canonical = *request->canonical,
                                   .record = request->record,
                                   .variant = (enum lavapipe_variant)device->variant};
    struct refit_output output = {.bounds = box_empty()};
    refit.canonical.ignores_slabs = true;
    enum bvhd_status status = lavapipe_open_headers(request->source, refit.variant, &refit.source, error);
    if (status == BVHD_OK)
        status = find_leaves(&refit, device, error);
    if (status != BVHD_OK)
        return status;
    status = check_source(&refit, device, error);
    if (status == BVHD_OK)
        status = write_blob(&refit, request->source, &output, error);
    lavapipe_leaves_finish(&refit.leaves);
    if (status == BVHD_OK)
        *ret_output = output;
    return status;
}

enum bvhd_status refit_lavapipe_cost(struct bytes blob, const struct device_format *device,
                                     const struct build_context *context, double *ret_cost, struct bvhd_error *error)
{
    struct lavapipe_refit refit = {.context = context};
    enum bvhd_status status = lavapipe_open_headers(blob, (enum lavapipe_variant)device->variant, &refit.source, error);
    if (status == BVHD_OK)
        status = sweep(&refit, measure_node, error);
    if (status == BVHD_OK) {
        struct box root;
        memcpy(&root, refit.source.bounds, sizeof root);
        *ret_cost = refit_cost_of(refit.nodes[0].cost, box_half_area(&root));
    }
    memory_free(context->memory, refit.nodes);
    return status;
}

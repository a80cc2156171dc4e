/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe_write.h"

#include <inttypes.h>
#include <math.h>

#include "builder/format/lavapipe_bounds.h"
#include "builder/format/serialized.h"

enum { BOX_CHUNK = 4096, LEAF_CHUNK = 8192, PREFETCH_AHEAD = 12, BOX = sizeof(struct lavapipe_box) };

struct lavapipe_writer {
    const struct layout_input *input;
    enum lavapipe_variant variant;
    const uint32_t *places; /* for each inner node of the ir: the number of its box */
    bool places_have_gaps;
    struct lavapipe_leaves leaves;
    uint32_t box_count; /* boxes that are written; at least the root */
    uint32_t leaf_size, leaf_offset;
    uint64_t body_offset, body_size;
    unsigned char *blob, *body;
};

uint32_t lavapipe_box_room(uint32_t primitives)
{
    return primitives < 2 ? 1 : primitives - 1;
}

/* Returns false if cancelled: the following steps then work on incomplete data, which is harmless. */
static bool run_all(struct lavapipe_writer *w, size_t total, size_t chunk, parallel_task task)
{
    return parallel_for_until(w->input->parallel, w->input->cancel, parallel_chunks(chunk, total), task, w);
}

static enum bvhd_status report_cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
}

/*
 * Numbers the box nodes in depth-first order: the box node of the first child follows its parent's. One array holds the
 * counts below each node on the way up, and the places on the way down.
 */
static bool place_depth_first(const struct ir *ir, const atomic_bool *cancel, uint32_t *ret_places)
{
    for (uint32_t node = ir->node_count; node-- > 0;) {
        const struct ir_node *own = &ir->nodes[node];
        ret_places[node] = own->count > 0 ? 0 : 1 + ret_places[own->first] + ret_places[own->first + 1];
        if (parallel_cancelled_at(cancel, node))
            return false;
    }
    ret_places[0] = 0;
    for (uint32_t node = 0; node < ir->node_count; node++) {
        const struct ir_node *own = &ir->nodes[node];
        if (own->count == 0) {
            ret_places[own->first + 1] = ret_places[node] + 1 + ret_places[own->first];
            ret_places[own->first] = ret_places[node] + 1;
        }
        if (parallel_cancelled_at(cancel, node))
            return false;
    }
    return true;
}

/* With primitives below 2^24 and boxes below 2^25, nothing here overflows 64 bits. */
static enum bvhd_status place_sections(struct lavapipe_writer *w, struct bvhd_error *error)
{
    const struct canonical *canonical = w->input->canonical;
    const struct ir *ir = w->input->ir;
    uint32_t room = lavapipe_box_room(canonical->primitive_count);
    w->box_count = ir->node_count < 2 ? 1 : ir->node_count / 2;
    uint64_t boxes = room > w->box_count ? room : w->box_count;
    w->leaf_size = lavapipe_leaf_size(w->leaves.kind);
    uint64_t nodes = BOX * boxes + (uint64_t)w->leaf_size * canonical->primitive_count;
    /* The later driver's traversal fetches this many bytes for every kind of node. */
    if (w->variant == LAVAPIPE_COMPACTED)
        nodes = (nodes + BOX - 1) / BOX * BOX;
    w->body_size = LAVAPIPE_HEADER + nodes;
    w->body_offset = SERIALIZED_HANDLES + (uint64_t)8 * w->leaves.handle_count;
    if (w->body_offset + w->body_size > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "blob", "%" PRIu64 " bytes, where the driver counts in 32 bits",
                              w->body_offset + w->body_size);
    w->leaf_offset = (uint32_t)(LAVAPIPE_HEADER + BOX * boxes);
    return BVHD_OK;
}

static enum bvhd_status plan(struct lavapipe_writer *w, struct bvhd_error *error)
{
    const struct canonical *canonical = w->input->canonical;
    if (canonical->primitive_count > LAVAPIPE_MAX_PRIMITIVES)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "primitives", "%" PRIu32 " do not fit into 24 bits",
                              canonical->primitive_count);
    if (canonical->geometry_count > LAVAPIPE_MAX_PRIMITIVES)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "geometries", "%" PRIu32 " do not fit into 24 bits",
                              canonical->geometry_count);
    w->variant = (enum lavapipe_variant)w->input->device->variant;
    enum bvhd_status status = lavapipe_leaves_init(&w->leaves, w->input, error);
    return status == BVHD_OK ? place_sections(w, error) : status;
}

static enum bvhd_status allocate(struct lavapipe_writer *w, struct bvhd_error *error)
{
    w->blob = output_allocate(w->input->output, w->input->memory, w->body_offset + w->body_size, error);
    if (!w->blob)
        return BVHD_NO_MEMORY;
    w->body = w->blob + w->body_offset;
    return BVHD_OK;
}

/* The sign of zeros is the same as in the leaves. */
void lavapipe_root_bounds(const struct lavapipe_leaves *leaves, const struct box *box, float ret_bounds[6])
{
    const float *bounds = (const float *)box;
    _Static_assert(sizeof(struct box) == 6 * sizeof(float), "a box is six floats");
    float zero = leaves->unsigned_zeros ? 0.0f : -0.0f;
    for (int k = 0; k < 6; k++)
        ret_bounds[k] = bounds[k] + zero;
}

/* Returns the box of an ir node over all motion keys, in `storage` if it has to be computed. */
static const struct box *box_of(const struct ir *ir, uint32_t node, struct box *storage)
{
    if (ir->key_count == 1)
        return &ir->boxes[0][node];
    *storage = ir->boxes[0][node];
    box_grow(storage, &ir->boxes[1][node]);
    return storage;
}

/*
 * Enlarges a box as the later driver enlarges every box that it stores, so that rays do not slip through between boxes.
 */
static void pad_bounds(float bounds[6])
{
    for (int k = 0; k < 6; k++) {
        double magnitude = fabs((double)bounds[k]), padding = (magnitude > 1.0 ? magnitude : 1.0) * (double)FLT_EPSILON;
        bounds[k] = (float)(k < 3 ? (double)bounds[k] - padding : (double)bounds[k] + padding);
    }
}

void lavapipe_child_bounds(const struct lavapipe_leaves *leaves, enum lavapipe_variant variant, const struct box *box,
                           float ret_bounds[6])
{
    lavapipe_root_bounds(leaves, box, ret_bounds);
    if (variant == LAVAPIPE_COMPACTED)
        pad_bounds(ret_bounds);
}

static uint32_t reference_to(const struct lavapipe_writer *w, uint32_t node)
{
    const struct ir *ir = w->input->ir;
    if (!ir_is_leaf(ir, node))
        return (LAVAPIPE_HEADER + w->places[node] * BOX) | LAVAPIPE_BOX;
    uint32_t leaf = lavapipe_leaves_place(&w->leaves, ir->refs[ir->nodes[node].first]);
    return (w->leaf_offset + leaf * w->leaf_size) | w->leaves.kind;
}

static void store_child(const struct lavapipe_writer *w, struct lavapipe_box *box, int child, uint32_t node)
{
    struct box storage;
    lavapipe_child_bounds(&w->leaves, w->variant, box_of(w->input->ir, node, &storage), (float *)&box->bounds[child]);
    box->children[child] = reference_to(w, node);
}

static void store_absent(const struct lavapipe_writer *w, struct lavapipe_box *box, int child)
{
    for (int axis = 0; axis < 3; axis++) {
        box->bounds[child].min[axis] = w->variant == LAVAPIPE_COMPACTED ? NAN : INFINITY;
        box->bounds[child].max[axis] = w->variant == LAVAPIPE_COMPACTED ? NAN : -INFINITY;
    }
    box->children[child] = LAVAPIPE_NONE;
}

/* In a tree that was made in depth-first order, a node's children are far away in memory. */
static void prefetch_children(const struct ir *ir, uint32_t node)
{
    uint32_t first = ir->nodes[node].first;
    if (ir_is_leaf(ir, node))
        return;
    __builtin_prefetch(&ir->boxes[0][first]);
    __builtin_prefetch(&ir->boxes[0][first + 1].max[2]);
    __builtin_prefetch(&ir->nodes[first]);
}

static void write_boxes(void *context, size_t index)
{
    const struct lavapipe_writer *w = context;
    const struct ir *ir = w->input->ir;
    size_t begin, end;
    parallel_chunk(index, BOX_CHUNK, ir->node_count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        uint32_t node = (uint32_t)i;
        if (end - i > PREFETCH_AHEAD)
            prefetch_children(ir, node + PREFETCH_AHEAD);
        if (ir_is_leaf(ir, node))
            continue;
        struct lavapipe_box box;
        store_child(w, &box, 0, ir->nodes[node].first);
        store_child(w, &box, 1, ir->nodes[node].first + 1);
        memcpy(w->body + LAVAPIPE_HEADER + (uint64_t)w->places[node] * BOX, &box, sizeof box);
    }
}

/* Writes the root of a tree over no primitive or one. */
static void write_lone_root(const struct lavapipe_writer *w)
{
    struct lavapipe_box box;
    if (w->input->ir->node_count > 0)
        store_child(w, &box, 0, 0);
    else
        store_absent(w, &box, 0);
    store_absent(w, &box, 1);
    memcpy(w->body + LAVAPIPE_HEADER, &box, sizeof box);
}

static void write_leaves(void *context, size_t index)
{
    const struct lavapipe_writer *w = context;
    size_t begin, end;
    parallel_chunk(index, LEAF_CHUNK, w->input->canonical->primitive_count, &begin, &end);
    lavapipe_leaves_write(&w->leaves, (uint32_t)begin, (uint32_t)end, w->body + w->leaf_offset,
                          w->blob + SERIALIZED_HANDLES);
}

/* Clears the gap between boxes and leaves, and the one after the leaves. */
static void clear_gaps(const struct lavapipe_writer *w)
{
    uint64_t boxes = w->places_have_gaps ? LAVAPIPE_HEADER : LAVAPIPE_HEADER + (uint64_t)w->box_count * BOX;
    uint64_t leaves = w->leaf_offset + (uint64_t)w->leaves.count * w->leaf_size;
    memset(w->body + boxes, 0, w->leaf_offset - boxes);
    memset(w->body + leaves, 0, w->body_size - leaves);
}

static void write_headers(const struct lavapipe_writer *w)
{
    unsigned char *header = w->body, *sizes = w->body + 24;
    struct serialized_header serialized = {
        .serialized_size = w->body_offset + w->body_size,
        .deserialized_size = w->body_size,
        .handle_count = w->leaves.handle_count,
    };
    memcpy(serialized.driver_uuid, w->input->device->driver_uuid, sizeof serialized.driver_uuid);
    memcpy(serialized.compatibility_uuid, w->input->device->compatibility_uuid, sizeof serialized.compatibility_uuid);
    serialized_write(w->blob, &serialized);
    memset(header, 0, LAVAPIPE_HEADER);
    if (w->input->ir->node_count > 0) {
        struct box storage;
        float bounds[6];
        lavapipe_root_bounds(&w->leaves, box_of(w->input->ir, 0, &storage), bounds);
        memcpy(header, bounds, sizeof bounds);
    }
    if (w->variant == LAVAPIPE_COMPACTED) {
        bytes_put32(sizes, (uint32_t)w->body_size);
        sizes += 4;
    }
    bytes_put32(sizes, (uint32_t)serialized.serialized_size);
    bytes_put32(sizes + 4, w->leaves.handle_count);
    bytes_put32(sizes + 8, w->leaf_offset);
}

static enum bvhd_status fill(struct lavapipe_writer *w, struct bvhd_error *error)
{
    clear_gaps(w);
    if (w->input->ir->node_count < 2)
        write_lone_root(w);
    else if (!run_all(w, w->input->ir->node_count, BOX_CHUNK, write_boxes))
        return report_cancelled(error);
    if (!run_all(w, w->input->canonical->primitive_count, LEAF_CHUNK, write_leaves))
        return report_cancelled(error);
    write_headers(w);
    return BVHD_OK;
}

static struct layout_sizes sizes_of(const struct lavapipe_writer *w)
{
    return (struct layout_sizes){
        .total = w->body_offset + w->body_size,
        .header = w->body_offset + LAVAPIPE_HEADER,
        .nodes = w->leaf_offset - LAVAPIPE_HEADER,
        .records = w->body_size - w->leaf_offset,
    };
}

enum bvhd_status lavapipe_write_at(const struct layout_input *input, const uint32_t *places, unsigned char **ret_blob,
                                   struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    struct lavapipe_writer w = {.input = input, .places = places, .places_have_gaps = true};
    enum bvhd_status status = plan(&w, error);
    if (status == BVHD_OK)
        status = allocate(&w, error);
    if (status == BVHD_OK)
        status = fill(&w, error);
    if (status == BVHD_OK) {
        *ret_blob = w.blob;
        *ret_sizes = sizes_of(&w);
    } else {
        output_discard(input->output, input->memory, w.blob);
    }
    lavapipe_leaves_finish(&w.leaves);
    return status;
}

static enum bvhd_status lavapipe_write(const struct layout_input *input, unsigned char **ret_blob,
                                       struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    const struct ir *ir = input->ir;
    if (ir->node_count < 2)
        return lavapipe_write_at(input, NULL, ret_blob, ret_sizes, error);
    uint32_t *places = memory_array(input->memory, ir->node_count, sizeof *places);
    if (!places)
        return bvhd_error_no_memory(error, "nodes", "no memory for the places of %" PRIu32 " nodes", ir->node_count);
    enum bvhd_status status = BVHD_OK;
    if (!place_depth_first(ir, input->cancel, places))
        status = report_cancelled(error);
    if (status == BVHD_OK)
        status = lavapipe_write_at(input, places, ret_blob, ret_sizes, error);
    memory_free(input->memory, places);
    return status;
}

static uint32_t lavapipe_version(uint32_t geometry_type)
{
    const bool is_known =
        geometry_type == GEOMETRY_TRIANGLES || geometry_type == GEOMETRY_AABBS || geometry_type == GEOMETRY_INSTANCES;
    return is_known ? LAVAPIPE_VERSION : 0;
}

/* The later variant's padding is counted for both. */
static uint64_t lavapipe_bound(const struct layout_counts *counts)
{
    const enum lavapipe_kind kind = counts->structure_type == STRUCTURE_TOP   ? LAVAPIPE_INSTANCE
                                    : counts->geometry_type == GEOMETRY_AABBS ? LAVAPIPE_AABB
                                                                              : LAVAPIPE_TRIANGLE;
    const uint64_t boxes = counts->refs < 2 ? 1 : counts->refs - 1,
                   nodes = BOX * boxes + lavapipe_leaf_size(kind) * counts->primitives;
    return LAVAPIPE_HEADER + (nodes + BOX - 1) / BOX * BOX;
}

const struct layout layout_lavapipe = {
    .target = TARGET_LAVAPIPE,
    .name = "lavapipe",
    .version = lavapipe_version,
    .arity = 2,
    .leaf_max = 1,
    .depth_limit = LAVAPIPE_MAX_LEVELS + 1,
    .variants = LAVAPIPE_VARIANTS,
    .inflate_boxes = lavapipe_bounds_inflate,
    .bound = lavapipe_bound,
    .write = lavapipe_write,
};

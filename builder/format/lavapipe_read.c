/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe.h"

#include <float.h>
#include <inttypes.h>

#include "proto/base/place.h"
#include "builder/format/serialized.h"

enum { BOX = sizeof(struct lavapipe_box), KIND_MASK = 3 };

/* The sizes in the driver's header, read under a variant. */
struct sizes {
    uint32_t compacted, serialized, instances, leaf_offset, padding;
};

static struct sizes sizes_of(const unsigned char *body, uint64_t body_size, enum lavapipe_variant variant)
{
    const unsigned char *at = body + 24;
    struct sizes sizes = {.compacted = (uint32_t)body_size};
    if (variant == LAVAPIPE_COMPACTED) {
        sizes.compacted = bytes_get32(at);
        at += 4;
    } else {
        sizes.padding = bytes_get32(at + 12);
    }
    sizes.serialized = bytes_get32(at);
    sizes.instances = bytes_get32(at + 4);
    sizes.leaf_offset = bytes_get32(at + 8);
    return sizes;
}

uint32_t lavapipe_leaf_size(enum lavapipe_kind kind)
{
    static const uint8_t bytes[] = {
        [LAVAPIPE_TRIANGLE] = sizeof(struct lavapipe_triangle),
        [LAVAPIPE_BOX] = sizeof(struct lavapipe_box),
        [LAVAPIPE_INSTANCE] = sizeof(struct lavapipe_instance),
        [LAVAPIPE_AABB] = sizeof(struct lavapipe_aabb),
    };
    return bytes[kind & KIND_MASK];
}

uint32_t lavapipe_leaf_index(const struct lavapipe_view *view, uint32_t reference)
{
    return ((reference & ~(uint32_t)KIND_MASK) - view->leaf_offset) /
           lavapipe_leaf_size((enum lavapipe_kind)(reference & KIND_MASK));
}

struct lavapipe_box lavapipe_box_at(const struct lavapipe_view *view, uint32_t offset)
{
    struct lavapipe_box box;
    memcpy(&box, view->body + offset, sizeof box);
    return box;
}

static const unsigned char *leaf_at(const struct lavapipe_view *view, uint32_t leaf, size_t size)
{
    return view->body + view->leaf_offset + size * leaf;
}

struct lavapipe_triangle lavapipe_triangle_at(const struct lavapipe_view *view, uint32_t leaf)
{
    struct lavapipe_triangle triangle;
    memcpy(&triangle, leaf_at(view, leaf, sizeof triangle), sizeof triangle);
    return triangle;
}

struct lavapipe_aabb lavapipe_aabb_at(const struct lavapipe_view *view, uint32_t leaf)
{
    struct lavapipe_aabb aabb;
    memcpy(&aabb, leaf_at(view, leaf, sizeof aabb), sizeof aabb);
    return aabb;
}

struct lavapipe_instance lavapipe_instance_at(const struct lavapipe_view *view, uint32_t leaf)
{
    struct lavapipe_instance instance;
    memcpy(&instance, leaf_at(view, leaf, sizeof instance), sizeof instance);
    return instance;
}

void lavapipe_box_bounds(const struct lavapipe_box *box, float ret_bounds[6])
{
    for (int axis = 0; axis < 3; axis++) {
        ret_bounds[axis] = FLT_MAX;
        ret_bounds[3 + axis] = -FLT_MAX;
        for (int child = 0; child < 2; child++) {
            float min = box->bounds[child].min[axis], max = box->bounds[child].max[axis];
            if (box->children[child] == LAVAPIPE_NONE)
                continue;
            ret_bounds[axis] = min < ret_bounds[axis] ? min : ret_bounds[axis];
            ret_bounds[3 + axis] = max > ret_bounds[3 + axis] ? max : ret_bounds[3 + axis];
        }
    }
}

static enum bvhd_status corrupt(struct bvhd_error *error, const char *where, uint64_t value)
{
    return bvhd_error_set(error, BVHD_CORRUPT, where, "%" PRIu64 " does not fit the rest of the structure", value);
}

/* Checks that values which the headers state twice agree, and that sections follow each other. */
static enum bvhd_status check_sizes(const struct lavapipe_view *view, const struct sizes *sizes, uint64_t blob_size,
                                    struct bvhd_error *error)
{
    if (sizes->compacted != view->body_size)
        return corrupt(error, "body.compactedSize", sizes->compacted);
    if (sizes->serialized != blob_size)
        return corrupt(error, "body.serializationSize", sizes->serialized);
    if (sizes->instances != view->handle_count)
        return corrupt(error, "body.instanceCount", sizes->instances);
    if (sizes->padding != 0)
        return corrupt(error, "body.padding", sizes->padding);
    bool whole = sizes->leaf_offset >= LAVAPIPE_HEADER + BOX && (sizes->leaf_offset - LAVAPIPE_HEADER) % BOX == 0;
    if (!whole || sizes->leaf_offset > view->body_size)
        return corrupt(error, "body.leafNodesOffset", sizes->leaf_offset);
    return BVHD_OK;
}

static enum bvhd_status read_headers(struct bytes blob, enum lavapipe_variant variant, struct lavapipe_view *view,
                                     struct bvhd_error *error)
{
    struct serialized_header header;
    enum bvhd_status status = serialized_read(blob, &header, error);
    if (status != BVHD_OK)
        return status;
    if (header.micromap_count > 0)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.handleCount", "this layout has no micromaps");
    uint64_t body_offset = SERIALIZED_HANDLES + 8 * header.handle_count;
    *view = (struct lavapipe_view){
        .device.variant = variant,
        .body = blob.data + body_offset,
        .body_size = blob.size - body_offset,
        .handles = blob.data + SERIALIZED_HANDLES,
        .handle_count = header.handle_count,
    };
    memcpy(view->device.driver_uuid, header.driver_uuid, sizeof view->device.driver_uuid);
    memcpy(view->device.compatibility_uuid, header.compatibility_uuid, sizeof view->device.compatibility_uuid);
    if (header.deserialized_size != view->body_size)
        return corrupt(error, "header.deserializedSize", header.deserialized_size);
    if (view->body_size < LAVAPIPE_HEADER + BOX || blob.size > UINT32_MAX)
        return corrupt(error, "body", view->body_size);
    struct sizes sizes = sizes_of(view->body, view->body_size, variant);
    status = check_sizes(view, &sizes, blob.size, error);
    memcpy(view->bounds, view->body, sizeof view->bounds);
    view->leaf_offset = sizes.leaf_offset;
    return status;
}

static uint32_t box_count(const struct lavapipe_view *view)
{
    return (view->leaf_offset - LAVAPIPE_HEADER) / BOX;
}

/*
 * One variant pads the end, so the room can be larger than the number of leaves. But there is at most one leaf for each
 * child of a box, and the driver makes one box less than leaves.
 */
static uint32_t count_leaves(const struct lavapipe_view *view, enum lavapipe_kind kind)
{
    uint32_t room = (uint32_t)((view->body_size - view->leaf_offset) / lavapipe_leaf_size(kind)),
             boxes = box_count(view);
    return room < boxes + 1 ? room : boxes + 1;
}

/* The state of a walk over the boxes: the boxes that were met, and those that still have to be visited. */
struct box_walk {
    struct lavapipe_view *view;
    unsigned char *met; /* one bit for each box */
    struct {
        uint32_t box, level;
    } waiting[LAVAPIPE_MAX_LEVELS + 2];
    uint32_t waiting_count;
    struct bvhd_error *error;
};

static enum bvhd_status bad_child(const struct box_walk *walk, uint32_t box, int child, uint32_t reference,
                                  const char *what)
{
    return bvhd_error_set(walk->error, BVHD_CORRUPT, place("node[%" PRIu32 "].children[%d]", box, child).text,
                          "0x%" PRIx32 " %s", reference, what);
}

static enum bvhd_status check_leaf(struct box_walk *walk, uint32_t box, int child, uint32_t reference)
{
    struct lavapipe_view *view = walk->view;
    enum lavapipe_kind kind = (enum lavapipe_kind)(reference & KIND_MASK);
    uint32_t offset = reference & ~(uint32_t)KIND_MASK;
    /* The kind of the first leaf is the kind of all leaves. */
    if (view->leaf_count == 0) {
        view->kind = kind;
        view->leaf_count = kind == LAVAPIPE_INSTANCE ? (uint32_t)view->handle_count : count_leaves(view, kind);
        if ((kind == LAVAPIPE_INSTANCE) != (view->handle_count > 0))
            return bad_child(walk, box, child, reference, "is of a kind that does not go with the number of instances");
    }
    if (kind != view->kind)
        return bad_child(walk, box, child, reference, "is of another kind than a leaf before it");
    bool inside = offset >= view->leaf_offset && (offset - view->leaf_offset) % lavapipe_leaf_size(kind) == 0;
    if (!inside || (offset - view->leaf_offset) / lavapipe_leaf_size(kind) >= view->leaf_count)
        return bad_child(walk, box, child, reference, "is no leaf");
    return BVHD_OK;
}

static enum bvhd_status enter_box(struct box_walk *walk, uint32_t box, int child, uint32_t reference, uint32_t level)
{
    uint32_t offset = reference & ~(uint32_t)KIND_MASK;
    if (offset < LAVAPIPE_HEADER || (offset - LAVAPIPE_HEADER) % BOX != 0 || offset >= walk->view->leaf_offset)
        return bad_child(walk, box, child, reference, "is no box");
    uint32_t next = (offset - LAVAPIPE_HEADER) / BOX;
    if (walk->met[next / 8] >> next % 8 & 1)
        return bad_child(walk, box, child, reference, "was met before: boxes form no tree");
    if (level > LAVAPIPE_MAX_LEVELS)
        return bvhd_error_set(walk->error, BVHD_INCOMPATIBLE, place("node[%" PRIu32 "]", box).text,
                              "more than %d levels of boxes", LAVAPIPE_MAX_LEVELS);
    walk->met[next / 8] |= (unsigned char)(1u << next % 8);
    walk->view->levels = level > walk->view->levels ? level : walk->view->levels;
    walk->waiting[walk->waiting_count].box = next;
    walk->waiting[walk->waiting_count++].level = level;
    return BVHD_OK;
}

/* The walk goes depth first: at most one box waits on each level above the current one, and two on the lowest level. */
static enum bvhd_status walk_boxes(struct box_walk *walk)
{
    enum bvhd_status status = enter_box(walk, 0, 0, LAVAPIPE_HEADER | LAVAPIPE_BOX, 1);
    while (status == BVHD_OK && walk->waiting_count > 0) {
        uint32_t box = walk->waiting[--walk->waiting_count].box, level = walk->waiting[walk->waiting_count].level;
        struct lavapipe_box node = lavapipe_box_at(walk->view, LAVAPIPE_HEADER + box * BOX);
        for (int child = 0; status == BVHD_OK && child < 2; child++) {
            uint32_t reference = node.children[child];
            if (reference == LAVAPIPE_NONE)
                continue;
            if ((reference & KIND_MASK) == LAVAPIPE_BOX)
                status = enter_box(walk, box, child, reference, level + 1);
            else
                status = check_leaf(walk, box, child, reference);
        }
    }
    return status;
}

enum bvhd_status lavapipe_open_headers(struct bytes blob, enum lavapipe_variant variant, struct lavapipe_view *ret_view,
                                       struct bvhd_error *error)
{
    struct lavapipe_view view;
    enum bvhd_status status = read_headers(blob, variant, &view, error);
    if (status == BVHD_OK)
        *ret_view = view;
    return status;
}

/*
 * The leaves of a top level exist even if no box refers to them. The kind of the leaves of a bottom level without
 * references is unknown.
 */
static enum bvhd_status check_instances(struct lavapipe_view *view, struct bvhd_error *error)
{
    if (view->handle_count == 0)
        return BVHD_OK;
    view->kind = LAVAPIPE_INSTANCE;
    view->leaf_count = (uint32_t)view->handle_count;
    if (view->handle_count > (view->body_size - view->leaf_offset) / sizeof(struct lavapipe_instance))
        return corrupt(error, "body.instanceCount", view->handle_count);
    return BVHD_OK;
}

enum bvhd_status lavapipe_open(struct bytes blob, enum lavapipe_variant variant, struct memory *memory,
                               struct lavapipe_view *ret_view, struct bvhd_error *error)
{
    struct lavapipe_view view;
    enum bvhd_status status = read_headers(blob, variant, &view, error);
    if (status == BVHD_OK)
        status = check_instances(&view, error);
    if (status != BVHD_OK)
        return status;
    struct box_walk walk = {.view = &view, .error = error};
    uint32_t bitmap = (box_count(&view) + 7) / 8;
    walk.met = memory_alloc(memory, bitmap);
    if (!walk.met)
        return bvhd_error_no_memory(error, "nodes", "no memory for %" PRIu32 " bytes", bitmap);
    memset(walk.met, 0, bitmap);
    status = walk_boxes(&walk);
    memory_free(memory, walk.met);
    if (status == BVHD_OK)
        *ret_view = view;
    return status;
}

/* A blob states its own size in its body, at a place that depends on the variant. */
static bool looks_compacted(struct bytes blob)
{
    struct serialized_header header;
    if (serialized_read(blob, &header, NULL) != BVHD_OK)
        return false;
    uint64_t body_offset = serialized_end(&header);
    return blob.size - body_offset >= LAVAPIPE_HEADER && bytes_get32(blob.data + body_offset + 28) == blob.size;
}

enum bvhd_status lavapipe_open_any(struct bytes blob, struct memory *memory, struct lavapipe_view *ret_view,
                                   struct bvhd_error *error)
{
    return lavapipe_open(blob, looks_compacted(blob) ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN, memory, ret_view, error);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/embree.h"

#include <stddef.h>
#include <string.h>

#include "builder/piece/embree_cut.h"
#include "builder/piece/embree_library.h"

_Static_assert(sizeof(struct RTCBuildPrimitive) == sizeof(struct primitive_ref), "an array of refs goes to Embree");
_Static_assert(offsetof(struct RTCBuildPrimitive, lower_x) == offsetof(struct primitive_ref, min), "the minimum");
_Static_assert(offsetof(struct RTCBuildPrimitive, geomID) == offsetof(struct primitive_ref, link), "a number of 0");
_Static_assert(offsetof(struct RTCBuildPrimitive, upper_x) == offsetof(struct primitive_ref, max), "the maximum");
_Static_assert(offsetof(struct RTCBuildPrimitive, primID) == offsetof(struct primitive_ref, id), "the ref's number");

/*
 * Embree's recursion ends at a depth of DEPTH_MOST - 8. What is left there becomes balanced trees of at most 8 levels,
 * or, if that is too much, Embree fails. With LARGE_LEAF it cannot: 2^8 such leaves hold every piece.
 */
enum { DEPTH_MOST = 72, LARGE_LEAF = 32 };

_Static_assert(256 * LARGE_LEAF > 2 * EMBREE_PIECE_MOST, "balanced trees hold a whole piece");

/* A node while Embree builds. */
struct node {
    uint32_t children[2]; /* of an inner node: numbers of nodes, greater than its own; 0 until they are known */
    uint32_t first, count; /* of a leaf: its range of `leaves`; an inner node's count is 0 */
};

struct build {
    const struct embree_request *request;
    struct embree_space space;
    struct embree_triangle *triangles; /* one for each ref, if triangles may be split, else NULL */
    struct node *nodes;
    struct primitive_ref *leaves; /* the refs of all leaves, with the scene's coordinates and numbers */
    _Atomic uint32_t node_count, leaf_count; /* atomic in case the program's own Embree has more threads */
    uint32_t node_room;
    _Atomic bool is_overfull; /* Embree has made more nodes or refs than can be */
};

static struct node *next_node(struct build *build)
{
    const uint32_t number = atomic_fetch_add_explicit(&build->node_count, 1, memory_order_relaxed);
    if (number < build->node_room)
        return &build->nodes[number];
    atomic_store_explicit(&build->is_overfull, true, memory_order_relaxed);
    return &build->nodes[0];
}

static void *create_node(RTCThreadLocalAllocator allocator, unsigned children, void *context)
{
    (void)allocator;
    (void)children;
    struct node *node = next_node(context);
    *node = (struct node){.count = 0};
    return node;
}

static void set_children(void *at, void **children, unsigned count, void *context)
{
    const struct build *build = context;
    struct node *node = at;
    for (unsigned i = 0; count == 2 && i < 2; i++)
        node->children[i] = (uint32_t)((const struct node *)children[i] - build->nodes);
}

/* Boxes are made at the end, from the refs. */
static void set_bounds(void *at, const struct RTCBounds **bounds, unsigned count, void *context)
{
    (void)at;
    (void)bounds;
    (void)count;
    (void)context;
}

/* The box as Embree got it; with splits it is thickened (embree_cut.h). */
static struct box given_box(const struct build *build, const struct primitive_ref *ref)
{
    const struct box box = primitive_ref_box(ref);
    struct box given = embree_space_box(&build->space, &box);
    if (build->triangles)
        embree_space_thicken(&given);
    return given;
}

/* Returns the part of a ref that Embree has put into a leaf: all of it, or a box around what was cut. */
static struct primitive_ref part_of(const struct build *build, const struct RTCBuildPrimitive *primitive)
{
    struct primitive_ref ref = build->request->refs[primitive->primID];
    const struct box given = given_box(build, &ref),
                     part = {{primitive->lower_x, primitive->lower_y, primitive->lower_z},
                             {primitive->upper_x, primitive->upper_y, primitive->upper_z}};
    if (!build->triangles || memcmp(&given, &part, sizeof part) == 0)
        return ref;
    const struct box outer = embree_cut_outward(&build->space, &build->triangles[primitive->primID], &part);
    for (int axis = 0; axis < 3; axis++) {
        const float min = outer.min[axis] > ref.min[axis] ? outer.min[axis] : ref.min[axis],
                    max = outer.max[axis] < ref.max[axis] ? outer.max[axis] : ref.max[axis];
        if (min <= max) {
            ref.min[axis] = min;
            ref.max[axis] = max;
        }
    }
    return ref;
}

static void *create_leaf(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count,
                         void *context)
{
    (void)allocator;
    struct build *build = context;
    struct node *leaf = next_node(build);
    uint32_t first = atomic_fetch_add_explicit(&build->leaf_count, (uint32_t)count, memory_order_relaxed);
    *leaf = (struct node){.first = first, .count = (uint32_t)count};
    if (count == 0 || count > build->request->capacity || first > build->request->capacity - count)
        atomic_store_explicit(&build->is_overfull, true, memory_order_relaxed);
    else
        for (size_t i = 0; i < count; i++)
            build->leaves[first + i] = part_of(build, &primitives[i]);
    return leaf;
}

static struct RTCBounds bounds_of(const struct box *box)
{
    return (struct RTCBounds){.lower_x = box->min[0],
                              .lower_y = box->min[1],
                              .lower_z = box->min[2],
                              .upper_x = box->max[0],
                              .upper_y = box->max[1],
                              .upper_z = box->max[2]};
}

static void split(const struct RTCBuildPrimitive *primitive, unsigned axis, float position, struct RTCBounds *ret_left,
                  struct RTCBounds *ret_right, void *context)
{
    const struct build *build = context;
    const struct box part = {{primitive->lower_x, primitive->lower_y, primitive->lower_z},
                             {primitive->upper_x, primitive->upper_y, primitive->upper_z}};
    struct box left, right;
    embree_cut(&build->triangles[primitive->primID], &part, axis, position, &left, &right);
    *ret_left = bounds_of(&left);
    *ret_right = bounds_of(&right);
}

/* Writes the refs in Embree's coordinates to the scratch array, numbered by their places. */
static void give(const struct build *build)
{
    const struct embree_request *request = build->request;
    for (uint32_t i = 0; i < request->count; i++) {
        const struct box box = given_box(build, &request->refs[i]);
        request->scratch[i] = (struct primitive_ref){
            .min = {box.min[0], box.min[1], box.min[2]}, .max = {box.max[0], box.max[1], box.max[2]}, .id = i};
    }
}

static struct RTCBuildArguments arguments_for(struct build *build, uint32_t leaf_most)
{
    static const enum RTCBuildQuality qualities[] = {[EMBREE_LOW] = RTC_BUILD_QUALITY_LOW,
                                                     [EMBREE_MEDIUM] = RTC_BUILD_QUALITY_MEDIUM,
                                                     [EMBREE_HIGH] = RTC_BUILD_QUALITY_HIGH};
    const struct embree_request *request = build->request;
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = qualities[request->quality];
    arguments.maxBranchingFactor = 2;
    arguments.maxDepth = DEPTH_MOST;
    /* Morton codes say nothing about the cost of a leaf, so leaves are filled. */
    arguments.minLeafSize = request->quality == EMBREE_LOW ? request->leaf_max : 1;
    arguments.maxLeafSize = leaf_most;
    arguments.primitives = (struct RTCBuildPrimitive *)(void *)request->scratch;
    arguments.primitiveCount = request->count;
    arguments.primitiveArrayCapacity = request->capacity;
    arguments.createNode = create_node;
    arguments.setNodeChildren = set_children;
    arguments.setNodeBounds = set_bounds;
    arguments.createLeaf = create_leaf;
    arguments.splitPrimitive = build->triangles ? split : NULL;
    arguments.userPtr = build;
    return arguments;
}

/* Calls Embree once. *ret_root is NULL if it fails; the result is Embree's error then. */
static enum RTCError call(struct build *build, uint32_t leaf_most, struct memory *memory, const struct node **ret_root)
{
    const struct embree_library *library = embree_library(NULL);
    const RTCDevice device = embree_library_device();
    struct RTCBuildArguments arguments = arguments_for(build, leaf_most);
    *ret_root = NULL;
    build->node_count = build->leaf_count = 0;
    give(build);
    embree_library_count_in(memory);
    library->get_device_error(device); /* forgets an earlier one of this thread */
    arguments.bvh = library->new_bvh(device);
    if (arguments.bvh) {
        *ret_root = library->build_bvh(&arguments);
        library->release_bvh(arguments.bvh);
    }
    embree_library_count_in(NULL);
    return *ret_root ? RTC_ERROR_NONE : library->get_device_error(device);
}

/* Returns whether every inner node has two children, which Embree has made after it, so that recursion ends. */
static bool is_complete(const struct build *build)
{
    for (uint32_t i = 0; i < build->node_count; i++)
        for (int k = 0; k < 2 && build->nodes[i].count == 0; k++)
            if (build->nodes[i].children[k] <= i || build->nodes[i].children[k] >= build->node_count)
                return false;
    return true;
}

/* Chains of refs can make trees too deep for small leaves: then Embree may make large ones, which `emit` divides. */
static enum bvhd_status run(struct build *build, struct memory *memory, const struct node **ret_root,
                            struct bvhd_error *error)
{
    enum RTCError failure = call(build, build->request->leaf_max, memory, ret_root);
    if (failure != RTC_ERROR_NONE && failure != RTC_ERROR_OUT_OF_MEMORY)
        failure = call(build, LARGE_LEAF, memory, ret_root);
    if (failure == RTC_ERROR_OUT_OF_MEMORY)
        return bvhd_error_no_memory(error, "", "no memory for Embree");
    if (failure != RTC_ERROR_NONE || build->is_overfull || !is_complete(build))
        return bvhd_error_set(error, BVHD_INTERNAL, "", "Embree has failed (%d)", (int)failure);
    return BVHD_OK;
}

/* The refs of the tree below a node, in the order of its leaves, as long as they are at most `most`. */
static uint32_t gather(const struct build *build, const struct node *node, uint32_t most,
                       struct primitive_ref *ret_refs)
{
    if (node->count > 0) {
        if (node->count <= most)
            memcpy(ret_refs, build->leaves + node->first, node->count * sizeof *ret_refs);
        return node->count;
    }
    const struct node *left = &build->nodes[node->children[0]], *right = &build->nodes[node->children[1]];
    const uint32_t count = gather(build, left, most, ret_refs);
    return count >= most ? most + 1 : count + gather(build, right, most - count, ret_refs + count);
}

/* Joins parts of one primitive to one ref. Returns how many refs remain. */
static uint32_t join_parts(struct primitive_ref *refs, uint32_t count)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t k = 0;
        while (k < kept && refs[k].id != refs[i].id)
            k++;
        if (k == kept) {
            refs[kept++] = refs[i];
            continue;
        }
        for (int axis = 0; axis < 3; axis++) {
            refs[k].min[axis] = refs[i].min[axis] < refs[k].min[axis] ? refs[i].min[axis] : refs[k].min[axis];
            refs[k].max[axis] = refs[i].max[axis] > refs[k].max[axis] ? refs[i].max[axis] : refs[k].max[axis];
        }
    }
    return kept;
}

/* Writes the tree below a node of the ir, which becomes the counterpart of one of Embree's. */
struct emitter {
    const struct build *build;
    struct ir *ir;
};

static void emit_leaf(struct emitter *emitter, const struct primitive_ref *refs, uint32_t count, uint32_t at)
{
    struct ir *ir = emitter->ir;
    struct box box = box_empty();
    ir->nodes[at] = (struct ir_node){ir->ref_count, count};
    for (uint32_t i = 0; i < count; i++) {
        const struct box own = primitive_ref_box(&refs[i]);
        box_grow(&box, &own);
        ir->refs[ir->ref_count++] = refs[i].id;
    }
    ir->boxes[0][at] = box;
}

/* Makes `at` an inner node. Returns the first of its two children, which are adjacent. */
static uint32_t emit_inner(struct emitter *emitter, uint32_t at)
{
    const uint32_t first = emitter->ir->node_count;
    emitter->ir->node_count += 2;
    emitter->ir->nodes[at] = (struct ir_node){.first = first};
    return first;
}

static void bound_inner(struct emitter *emitter, uint32_t at)
{
    struct box *boxes = emitter->ir->boxes[0];
    const uint32_t first = emitter->ir->nodes[at].first;
    boxes[at] = boxes[first];
    box_grow(&boxes[at], &boxes[first + 1]);
}

/* Writes a balanced tree over the refs of a leaf that may be larger than leaf_max. */
static void emit_refs(struct emitter *emitter, const struct primitive_ref *refs, uint32_t count, uint32_t at)
{
    if (count <= emitter->build->request->leaf_max) {
        emit_leaf(emitter, refs, count, at);
        return;
    }
    const uint32_t first = emit_inner(emitter, at), half = count / 2;
    emit_refs(emitter, refs, half, first);
    emit_refs(emitter, refs + half, count - half, first + 1);
    bound_inner(emitter, at);
}

/*
 * Returns whether no more of Embree's nodes are to be written below this one, and then the refs: it is a leaf, or what
 * is below it fits into one and names a primitive twice.
 */
static bool becomes_leaf(const struct build *build, const struct node *node, struct primitive_ref ret_refs[LARGE_LEAF],
                         uint32_t *ret_count)
{
    if (node->count == 0 && !build->triangles)
        return false;
    const uint32_t most = node->count > 0 ? LARGE_LEAF : build->request->leaf_max,
                   count = gather(build, node, most, ret_refs);
    if (count > most)
        return false;
    *ret_count = join_parts(ret_refs, count);
    return node->count > 0 || *ret_count < count;
}

/* Recurses to DEPTH_MOST levels and a few more. */
static void emit(struct emitter *emitter, const struct node *node, uint32_t at)
{
    uint32_t count;
    struct primitive_ref refs[LARGE_LEAF];
    if (becomes_leaf(emitter->build, node, refs, &count)) {
        emit_refs(emitter, refs, count, at);
        return;
    }
    const uint32_t first = emit_inner(emitter, at);
    emit(emitter, &emitter->build->nodes[node->children[0]], first);
    emit(emitter, &emitter->build->nodes[node->children[1]], first + 1);
    bound_inner(emitter, at);
}

static enum bvhd_status write_tree(const struct build *build, const struct node *root, struct memory *memory,
                                   struct ir *ret_ir, struct bvhd_error *error)
{
    struct ir ir;
    struct emitter emitter = {build, &ir};
    enum bvhd_status status = ir_init(&ir, memory, 2 * build->leaf_count - 1, build->leaf_count, error);
    if (status != BVHD_OK)
        return status;
    ir.node_count = 1;
    emit(&emitter, root, 0);
    *ret_ir = ir;
    return BVHD_OK;
}

static void free_room(struct build *build, struct memory *memory)
{
    memory_free(memory, build->triangles);
    memory_free(memory, build->leaves);
    memory_free(memory, build->nodes);
}

static bool make_room(struct build *build, struct memory *memory)
{
    const struct embree_request *request = build->request;
    const bool splits = request->capacity > request->count;
    build->nodes = memory_array(memory, build->node_room, sizeof *build->nodes);
    build->leaves = memory_array(memory, request->capacity, sizeof *build->leaves);
    build->triangles = splits ? memory_array(memory, request->count, sizeof *build->triangles) : NULL;
    if (!build->nodes || !build->leaves || (splits && !build->triangles)) {
        free_room(build, memory);
        return false;
    }
    for (uint32_t i = 0; splits && i < request->count; i++)
        build->triangles[i] = embree_triangle_load(&build->space, request->canonical, request->refs[i].id);
    return true;
}

enum bvhd_status embree_build(const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error)
{
    struct box bounds, centroids;
    primitive_ref_bounds(request->refs, request->count, &bounds, &centroids);
    struct build build = {
        .request = request, .space = embree_space_for(&bounds), .node_room = 2 * request->capacity - 1};
    const struct node *root;
    if (!make_room(&build, memory))
        return bvhd_error_no_memory(error, "", "no memory for a tree");
    enum bvhd_status status = run(&build, memory, &root, error);
    if (status == BVHD_OK)
        status = write_tree(&build, root, memory, ret_ir, error);
    free_room(&build, memory);
    return status;
}

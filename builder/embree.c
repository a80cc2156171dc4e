/* SPDX-License-Identifier: Apache-2.0 */
#include "embree.h"

#include <assert.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdlib.h>

#if defined(__has_include) && __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

_Static_assert(sizeof(struct RTCBuildPrimitive) == sizeof(struct primitive_ref), "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, lower_x) == offsetof(struct primitive_ref, min), "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, geomID) == offsetof(struct primitive_ref, geometry), "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, upper_x) == offsetof(struct primitive_ref, max), "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, primID) == offsetof(struct primitive_ref, id), "refs go to Embree as they are");

/* Embree's own working memory of one build; kept for the next. */
struct workspace {
    RTCBVH bvh;
    struct workspace *next;
};

struct embree {
    RTCDevice device;
    pthread_mutex_t mutex; /* of `free` */
    struct workspace *free;
};

/*
 * One call of rtcBuildBVH. Embree knows nodes and leaves as pointers; ours are numbers in a pointer's clothes: a node is the index of its pair
 * of children with bit 0 set, a leaf its first ref and its count. Nodes are made before their children, so indices grow downwards.
 */
struct construction {
    const struct embree_request *request;
    struct ir ir;
    uint32_t node_capacity, ref_capacity;
    atomic_bool broken; /* an answer that we cannot take */
};

enum { LEAF_COUNT_BITS = 5 };

/* The construction that this thread is in. Embree must not call back from another thread: then the order of things would be chance. */
static _Thread_local struct construction *in_progress;

static void *node_handle(uint32_t pair)
{
    return (void *)((uintptr_t)pair << 1 | 1);
}

static uint32_t handle_pair(const void *handle)
{
    return (uint32_t)((uintptr_t)handle >> 1);
}

static void *leaf_handle(uint32_t first, uint32_t count)
{
    return (void *)((uintptr_t)first << (LEAF_COUNT_BITS + 1) | (uintptr_t)count << 1);
}

static struct ir_node handle_node(const void *handle)
{
    uintptr_t bits = (uintptr_t)handle;
    if (bits & 1)
        return (struct ir_node){.first = handle_pair(handle)};
    return (struct ir_node){.first = (uint32_t)(bits >> (LEAF_COUNT_BITS + 1)), .count = bits >> 1 & ((1u << LEAF_COUNT_BITS) - 1)};
}

/* The pair that stands in when a construction is broken: it always exists, and nobody will look at it. */
static void *broken(struct construction *construction)
{
    atomic_store_explicit(&construction->broken, true, memory_order_relaxed);
    return node_handle(1);
}

static bool is_foreign(const struct construction *construction)
{
    return construction != in_progress;
}

static void *create_node(RTCThreadLocalAllocator allocator, unsigned children, void *context)
{
    (void)allocator;
    struct construction *construction = context;
    if (is_foreign(construction) || children != 2 || construction->node_capacity - construction->ir.node_count < 2)
        return broken(construction);
    uint32_t pair = construction->ir.node_count;
    construction->ir.node_count += 2;
    return node_handle(pair);
}

static void set_bounds(void *node, const struct RTCBounds **bounds, unsigned children, void *context)
{
    struct construction *construction = context;
    if (is_foreign(construction))
        return;
    struct box *boxes = construction->ir.boxes[0] + handle_pair(node);
    for (unsigned i = 0; i < children && i < 2; i++) {
        const struct RTCBounds *b = bounds[i];
        boxes[i] = (struct box){{b->lower_x, b->lower_y, b->lower_z}, {b->upper_x, b->upper_y, b->upper_z}};
    }
}

static void set_children(void *node, void **handles, unsigned children, void *context)
{
    struct construction *construction = context;
    if (is_foreign(construction))
        return;
    struct ir_node *nodes = construction->ir.nodes + handle_pair(node);
    for (unsigned i = 0; i < children && i < 2; i++)
        nodes[i] = handle_node(handles[i]);
}

static void *create_leaf(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count, void *context)
{
    (void)allocator;
    struct construction *construction = context;
    struct ir *ir = &construction->ir;
    if (is_foreign(construction) || count == 0 || count > construction->request->leaf_max ||
        construction->ref_capacity - ir->ref_count < count)
        return broken(construction);
    uint32_t first = ir->ref_count;
    for (size_t i = 0; i < count; i++)
        ir->refs[ir->ref_count++] = primitives[i].primID;
    return leaf_handle(first, (uint32_t)count);
}

static struct workspace *workspace_take(struct embree *embree)
{
    pthread_mutex_lock(&embree->mutex);
    struct workspace *workspace = embree->free;
    if (workspace)
        embree->free = workspace->next;
    pthread_mutex_unlock(&embree->mutex);
    if (workspace)
        return workspace;
    workspace = malloc(sizeof *workspace);
    if (!workspace)
        return NULL;
    workspace->bvh = rtcNewBVH(embree->device);
    if (!workspace->bvh) {
        free(workspace);
        return NULL;
    }
    return workspace;
}

static void workspace_give(struct embree *embree, struct workspace *workspace)
{
    pthread_mutex_lock(&embree->mutex);
    workspace->next = embree->free;
    embree->free = workspace;
    pthread_mutex_unlock(&embree->mutex);
}

static struct RTCBuildArguments arguments_for(struct construction *construction, RTCBVH bvh)
{
    const struct embree_request *request = construction->request;
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = RTC_BUILD_QUALITY_LOW;
    arguments.maxBranchingFactor = 2;
    arguments.maxDepth = 1024;
    arguments.minLeafSize = request->leaf_max;
    arguments.maxLeafSize = request->leaf_max;
    arguments.bvh = bvh;
    arguments.primitives = (struct RTCBuildPrimitive *)(void *)request->refs;
    arguments.primitiveCount = request->count;
    arguments.primitiveArrayCapacity = request->count;
    arguments.createNode = create_node;
    arguments.setNodeBounds = set_bounds;
    arguments.setNodeChildren = set_children;
    arguments.createLeaf = create_leaf;
    arguments.userPtr = construction;
    return arguments;
}

/* Runs Embree; BVHD_OK when it gave a tree that we can take. */
static enum bvhd_status construct(struct embree *embree, struct construction *construction, struct bvhd_error *error)
{
    struct workspace *workspace = workspace_take(embree);
    if (!workspace)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for Embree");
    struct RTCBuildArguments arguments = arguments_for(construction, workspace->bvh);
    in_progress = construction;
    void *root = rtcBuildBVH(&arguments);
    in_progress = NULL;
    workspace_give(embree, workspace);
    if (!root) {
        enum RTCError reason = rtcGetDeviceError(embree->device);
        if (reason == RTC_ERROR_OUT_OF_MEMORY)
            return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for Embree");
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "", "Embree gave up on %u primitives (error %d)", construction->request->count,
                              (int)reason);
    }
    if (atomic_load_explicit(&construction->broken, memory_order_relaxed))
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "", "Embree did not keep to what was asked for %u primitives",
                              construction->request->count);
    construction->ir.nodes[0] = handle_node(root);
    return BVHD_OK;
}

/* The box that Embree does not tell. */
static void bound_root(struct ir *ir, const struct box *leaf)
{
    struct box *boxes = ir->boxes[0];
    if (ir_is_leaf(ir, 0)) {
        boxes[0] = *leaf;
        return;
    }
    boxes[0] = boxes[ir->nodes[0].first];
    box_grow(&boxes[0], &boxes[ir->nodes[0].first + 1]);
}

enum bvhd_status embree_build(struct embree *embree, const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error)
{
    assert(request->count >= 1);
    assert(request->leaf_max >= 1 && request->leaf_max < 1u << LEAF_COUNT_BITS);
    struct construction construction = {.request = request, .ref_capacity = request->count};
    struct box leaf = box_empty(), centroids;
    if (request->count <= request->leaf_max)
        primitive_bounds(request->refs, request->count, &leaf, &centroids);
    /* A root, and two nodes for every ref but one; with one ref the pair that broken() speaks of. */
    construction.node_capacity = request->count < 2 ? 3 : 2 * request->count - 1;
    enum bvhd_status status = ir_init(&construction.ir, memory, construction.node_capacity, construction.ref_capacity, error);
    if (status != BVHD_OK)
        return status;
    construction.ir.node_count = 1;
    status = construct(embree, &construction, error);
    if (status != BVHD_OK) {
        ir_finish(&construction.ir);
        return status;
    }
    bound_root(&construction.ir, &leaf);
    *ret_ir = construction.ir;
    return BVHD_OK;
}

enum bvhd_status embree_create(struct embree **ret_embree, struct bvhd_error *error)
{
    struct embree *embree = calloc(1, sizeof *embree);
    if (!embree)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for Embree");
    embree->device = rtcNewDevice("threads=1,set_affinity=0");
    if (!embree->device) {
        int reason = (int)rtcGetDeviceError(NULL);
        free(embree);
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "", "Embree has no device on this machine (error %d)", reason);
    }
    pthread_mutex_init(&embree->mutex, NULL);
    *ret_embree = embree;
    return BVHD_OK;
}

void embree_destroy(struct embree *embree)
{
    if (!embree)
        return;
    while (embree->free) {
        struct workspace *workspace = embree->free;
        embree->free = workspace->next;
        rtcReleaseBVH(workspace->bvh);
        free(workspace);
    }
    rtcReleaseDevice(embree->device);
    pthread_mutex_destroy(&embree->mutex);
    free(embree);
}

uint32_t embree_version(void)
{
    return RTC_VERSION;
}

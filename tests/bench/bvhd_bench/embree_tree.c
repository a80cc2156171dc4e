/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/embree_tree.h"

#include <stdlib.h>
#include <string.h>

#include "tests/bench/bvhd_bench/embree_api.h"
#include "tests/bench/bvhd_bench/stopwatch.h"

enum { WARM_UP = 20000 };

struct child {
    struct node *node;
    struct box box;
};

/*
 * A node is as small as possible, because its memory is part of what is measured. A leaf consists of its count and its
 * ids.
 */
struct node {
    uint32_t count; /* number of primitives of a leaf; 0: an inner node */
    uint32_t child_count;
    struct child children[];
};

static void *create_node(RTCThreadLocalAllocator allocator, unsigned children, void *context)
{
    (void)context;
    struct node *node = rtcThreadLocalAlloc(allocator, sizeof *node + children * sizeof node->children[0], 16);
    node->count = 0;
    node->child_count = children;
    return node;
}

static void set_children(void *at, void **children, unsigned count, void *context)
{
    (void)context;
    struct node *node = at;
    for (unsigned i = 0; i < count; i++)
        node->children[i].node = children[i];
}

static void set_bounds(void *at, const struct RTCBounds **bounds, unsigned count, void *context)
{
    (void)context;
    struct node *node = at;
    for (unsigned i = 0; i < count; i++)
        node->children[i].box = (struct box){{bounds[i]->lower_x, bounds[i]->lower_y, bounds[i]->lower_z},
                                             {bounds[i]->upper_x, bounds[i]->upper_y, bounds[i]->upper_z}};
}

/* The ids follow the count. */
static void *create_leaf(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count,
                         void *context)
{
    (void)context;
    uint32_t *leaf = rtcThreadLocalAlloc(allocator, (count + 1) * sizeof *leaf, 16);
    leaf[0] = (uint32_t)count;
    for (size_t i = 0; i < count; i++)
        leaf[i + 1] = primitives[i].primID;
    return leaf;
}

static void add(struct RTCBounds *bounds, const float point[3])
{
    struct box box = {{bounds->lower_x, bounds->lower_y, bounds->lower_z},
                      {bounds->upper_x, bounds->upper_y, bounds->upper_z}};
    box_add_point(&box, point);
    *bounds = (struct RTCBounds){.lower_x = box.min[0],
                                 .lower_y = box.min[1],
                                 .lower_z = box.min[2],
                                 .upper_x = box.max[0],
                                 .upper_y = box.max[1],
                                 .upper_z = box.max[2]};
}

/* Clips the bounds to the box of the primitive. */
static void narrow(struct RTCBounds *bounds, const struct RTCBuildPrimitive *primitive)
{
    float *low = &bounds->lower_x, *high = &bounds->upper_x;
    const float *own_low = &primitive->lower_x, *own_high = &primitive->upper_x;
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = low[axis] > own_low[axis] ? low[axis] : own_low[axis];
        high[axis] = high[axis] < own_high[axis] ? high[axis] : own_high[axis];
        low[axis] = low[axis] < high[axis] ? low[axis] : high[axis];
    }
}

/* Computes the boxes of the two halves of a triangle that is cut at `position`, clipped to the primitive's own box. */
static void split(const struct RTCBuildPrimitive *primitive, unsigned axis, float position, struct RTCBounds *left,
                  struct RTCBounds *right, void *context)
{
    const struct ply *mesh = context;
    const uint32_t *corners = mesh->indices + (size_t)3 * primitive->primID;
    const struct box empty = box_empty();
    struct RTCBounds nothing = {.lower_x = empty.min[0],
                                .lower_y = empty.min[1],
                                .lower_z = empty.min[2],
                                .upper_x = empty.max[0],
                                .upper_y = empty.max[1],
                                .upper_z = empty.max[2]};
    *left = *right = nothing;
    for (int k = 0; k < 3; k++) {
        const float *a = mesh->positions + (size_t)3 * corners[k],
                    *b = mesh->positions + (size_t)3 * corners[(k + 1) % 3];
        if (a[axis] <= position)
            add(left, a);
        if (a[axis] >= position)
            add(right, a);
        if ((a[axis] < position) != (b[axis] < position) && a[axis] != b[axis]) {
            float share = (position - a[axis]) / (b[axis] - a[axis]), point[3];
            for (int k2 = 0; k2 < 3; k2++)
                point[k2] = a[k2] + share * (b[k2] - a[k2]);
            point[axis] = position;
            add(left, point);
            add(right, point);
        }
    }
    narrow(left, primitive);
    narrow(right, primitive);
}

static struct RTCBuildArguments arguments_for(const struct method *method, const struct ply *mesh, uint32_t count)
{
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = embree_api_quality(method->effort);
    arguments.maxBranchingFactor = method->arity;
    arguments.maxDepth = 1024;
    arguments.primitiveCount = count;
    arguments.primitiveArrayCapacity = method->effort == EFFORT_HIGH ? 2 * (size_t)count : count;
    arguments.createNode = create_node;
    arguments.setNodeChildren = set_children;
    arguments.setNodeBounds = set_bounds;
    arguments.createLeaf = create_leaf;
    arguments.splitPrimitive = method->effort == EFFORT_HIGH ? split : NULL;
    arguments.userPtr = (void *)(uintptr_t)mesh;
    return arguments;
}

static void count_below(const struct node *node, struct tree *tree)
{
    tree->node_count++;
    tree->ref_count += node->count;
    for (uint32_t k = 0; !node->count && k < node->child_count; k++)
        count_below(node->children[k].node, tree);
}

static void copy_below(const struct node *node, uint32_t index, struct tree *tree)
{
    struct tree_node *copy = &tree->nodes[index];
    if (node->count) {
        copy->first = tree->ref_count;
        copy->refs = node->count;
        memcpy(tree->refs + tree->ref_count, (const uint32_t *)(const void *)node + 1,
               node->count * sizeof *tree->refs);
        tree->ref_count += node->count;
        return;
    }
    uint32_t first = copy->first = tree->node_count;
    copy->children = node->child_count;
    tree->node_count += node->child_count;
    for (uint32_t k = 0; k < node->child_count; k++) {
        tree->nodes[first + k].box = node->children[k].box;
        copy_below(node->children[k].node, first + k, tree);
    }
}

static struct tree copy_tree(const struct node *root, const struct box *bounds)
{
    struct tree tree = {0};
    count_below(root, &tree);
    tree.nodes = tree_need(tree.node_count, sizeof *tree.nodes);
    tree.refs = tree_need(tree.ref_count, sizeof *tree.refs);
    tree.node_count = 1;
    tree.ref_count = 0;
    tree.nodes[0].box = *bounds;
    copy_below(root, 0, &tree);
    return tree;
}

/*
 * Starts Embree's threads, which a program that builds often does only once. Restores the array of primitives
 * afterwards, because spatial splits write anywhere in it.
 */
static void warm_up(RTCDevice device, struct RTCBuildArguments arguments, const struct primitive_refs *refs)
{
    RTCBVH bvh = rtcNewBVH(device);
    if (arguments.primitiveCount > WARM_UP)
        arguments.primitiveCount = WARM_UP;
    arguments.bvh = bvh;
    if (bvh)
        rtcBuildBVH(&arguments);
    rtcReleaseBVH(bvh);
    memcpy(arguments.primitives, refs->refs, refs->count * sizeof *refs->refs);
}

struct task {
    const struct embree_tree_request *request;
    RTCDevice device;
    atomic_llong live; /* bytes that the device holds */
    struct RTCBuildArguments arguments;
};

static const char *run(struct task *task, struct embree_tree_result *result)
{
    const struct primitive_refs *refs = task->request->refs;
    memcpy(task->arguments.primitives, refs->refs, refs->count * sizeof *refs->refs);
    warm_up(task->device, task->arguments, refs);
    long long before = task->live;
    RTCBVH bvh = rtcNewBVH(task->device);
    if (!bvh)
        return "no BVH";
    task->arguments.bvh = bvh;
    double begin = stopwatch_wall_ms(), cpu_begin = stopwatch_cpu_ms();
    const struct node *root = rtcBuildBVH(&task->arguments);
    result->ms = stopwatch_wall_ms() - begin;
    result->cpu_ms = stopwatch_cpu_ms() - cpu_begin;
    result->bytes = (uint64_t)(task->live - before);
    if (root && task->request->want_tree)
        result->tree = copy_tree(root, &refs->bounds);
    rtcReleaseBVH(bvh);
    return root ? NULL : "no tree";
}

const char *embree_tree_build(const struct embree_tree_request *request, struct embree_tree_result *ret_result)
{
    const struct primitive_refs *refs = request->refs;
    struct embree_tree_result result = {0};
    struct task task = {.request = request, .arguments = arguments_for(request->method, request->mesh, refs->count)};
    if (refs->count == 0)
        return "nothing to build over";
    task.device = embree_api_device(request->threads, embree_api_count, &task.live);
    task.arguments.primitives =
        aligned_alloc(64, (task.arguments.primitiveArrayCapacity * sizeof *refs->refs + 63) & ~(size_t)63);
    const char *failure = "no device";
    if (task.device && task.arguments.primitives)
        failure = run(&task, &result);
    if (task.device)
        rtcReleaseDevice(task.device);
    free(task.arguments.primitives);
    if (!failure)
        *ret_result = result;
    return failure;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/reference_builder.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "builder/piece/embree_version.h"

_Static_assert(sizeof(struct RTCBuildPrimitive) == sizeof(struct primitive_ref), "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, lower_x) == offsetof(struct primitive_ref, min),
               "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, upper_x) == offsetof(struct primitive_ref, max),
               "refs go to Embree as they are");
_Static_assert(offsetof(struct RTCBuildPrimitive, primID) == offsetof(struct primitive_ref, id),
               "refs go to Embree as they are");

enum { WIDEST = 8 };

struct node {
    uint32_t count; /* number of primitives of a leaf; 0: an inner node */
    struct box boxes[WIDEST];
    struct node *children[WIDEST];
};

static void *create_node(RTCThreadLocalAllocator allocator, unsigned children, void *context)
{
    (void)context;
    size_t unused = (WIDEST - children) * sizeof(struct node *);
    struct node *node = rtcThreadLocalAlloc(allocator, sizeof *node - unused, 16);
    node->count = 0;
    return node;
}

static void set_children(void *at, void **children, unsigned count, void *context)
{
    (void)context;
    struct node *node = at;
    for (unsigned i = 0; i < count; i++)
        node->children[i] = children[i];
}

static void set_bounds(void *at, const struct RTCBounds **bounds, unsigned count, void *context)
{
    (void)context;
    struct node *node = at;
    for (unsigned i = 0; i < count; i++)
        node->boxes[i] = (struct box){{bounds[i]->lower_x, bounds[i]->lower_y, bounds[i]->lower_z},
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

static double cost_below(const struct node *node, const struct box *box)
{
    if (node->count)
        return box_half_area(box) * node->count;
    return box_half_area(box) + cost_below(node->children[0], &node->boxes[0]) +
           cost_below(node->children[1], &node->boxes[1]);
}

static double tree_sah(const struct node *root, const struct primitive_ref *refs, uint32_t count)
{
    struct box bounds, centroids;
    primitive_ref_bounds(refs, count, &bounds, &centroids);
    double area = box_half_area(&bounds);
    return area > 0 ? cost_below(root, &bounds) / area : 0;
}

static struct RTCBuildArguments arguments_for(enum reference_method kind, RTCBVH bvh, struct primitive_ref *refs,
                                              uint32_t count)
{
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = kind == REFERENCE_MEDIUM ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_LOW;
    arguments.maxBranchingFactor = kind == REFERENCE_MEDIUM ? 2 : WIDEST;
    arguments.maxDepth = 1024;
    arguments.bvh = bvh;
    arguments.primitives = (struct RTCBuildPrimitive *)(void *)refs;
    arguments.primitiveCount = arguments.primitiveArrayCapacity = count;
    arguments.createNode = create_node;
    arguments.setNodeChildren = set_children;
    arguments.setNodeBounds = set_bounds;
    arguments.createLeaf = create_leaf;
    return arguments;
}

static double milliseconds(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

bool reference_build(enum reference_method kind, const struct primitive_ref *refs, uint32_t count, unsigned threads,
                     struct reference_result *ret_result)
{
    char config[32];
    snprintf(config, sizeof config, "threads=%u", threads);
    size_t size = count * sizeof *refs;
    struct primitive_ref *copy = aligned_alloc(64, (size + 63) & ~(size_t)63);
    RTCDevice device = rtcNewDevice(config);
    RTCBVH bvh = device ? rtcNewBVH(device) : NULL;
    void *root = NULL;
    if (copy && bvh) {
        memcpy(copy, refs, size);
        struct RTCBuildArguments arguments = arguments_for(kind, bvh, copy, count);
        double begin = milliseconds(CLOCK_MONOTONIC), cpu_begin = milliseconds(CLOCK_PROCESS_CPUTIME_ID);
        root = rtcBuildBVH(&arguments);
        ret_result->ms = milliseconds(CLOCK_MONOTONIC) - begin;
        ret_result->cpu_ms = milliseconds(CLOCK_PROCESS_CPUTIME_ID) - cpu_begin;
        ret_result->sah = 0;
    }
    if (!root)
        fprintf(stderr, "Embree failed\n");
    else if (kind == REFERENCE_MEDIUM)
        ret_result->sah = tree_sah(root, refs, count);
    if (bvh)
        rtcReleaseBVH(bvh);
    if (device)
        rtcReleaseDevice(device);
    free(copy);
    return root;
}

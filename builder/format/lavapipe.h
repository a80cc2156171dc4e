/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe.h - the native layout of lavapipe, Mesa's CPU driver: its bytes as structs, and their reader. FORMATS.md has
 * the tables and the rules.
 *
 * A blob is Vulkan's serialized header with its handles, then the body, which the driver copies to the address of the
 * structure: 40 bytes of header, box nodes of two children each with the root first, then leaves, primitive i at place
 * i. A reference is a node's offset in the body with its kind in the two lowest bits. The body is not aligned in the
 * blob.
 *
 * Handles, one for each leaf of a top level, in leaf order: when written, each is the row + 1 of the request's table of
 * references; a loader replaces them by device addresses.
 */
#ifndef BVHD_LAVAPIPE_H
#define BVHD_LAVAPIPE_H

#include <stdint.h>

#include "proto/base/bytes.h"
#include "proto/base/device_format.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* How the driver's own header lies; which one a driver has is found by reproducing its probe, not by its version. */
enum lavapipe_variant {
    LAVAPIPE_PLAIN = 1, /* bounds, serialization size, instance count, leaf offset, padding: Mesa 25.0 */
    LAVAPIPE_COMPACTED = 2, /* bounds, compacted size, serialization size, instance count, leaf offset: Mesa 26 */
    LAVAPIPE_VARIANTS = 2
};

enum {
    LAVAPIPE_VERSION = 1, /* of what we write; part of keys */
    LAVAPIPE_HEADER = 40, /* bytes; the root follows */
    LAVAPIPE_MAX_LEVELS =
        24, /* levels of box nodes: half of the driver's stack, for a bottom level and for a top level */
    LAVAPIPE_MAX_PRIMITIVES = (1 << 24) - 1
};

enum lavapipe_kind { LAVAPIPE_TRIANGLE = 0, LAVAPIPE_BOX = 1, LAVAPIPE_INSTANCE = 2, LAVAPIPE_AABB = 3 };

#define LAVAPIPE_NONE UINT32_C(0xffffffff)
#define LAVAPIPE_GEOMETRY_OPAQUE UINT32_C(0x80000000)

/* Flags in the upper bits of an instance's sbt_and_flags. */
#define LAVAPIPE_FORCE_OPAQUE UINT32_C(0x80000000)
#define LAVAPIPE_NOT_FORCE_NO_OPAQUE UINT32_C(0x40000000)
#define LAVAPIPE_CULL_DISABLE UINT32_C(0x20000000)
#define LAVAPIPE_FLIP_FACING UINT32_C(0x10000000)

struct lavapipe_box {
    struct {
        float min[3], max[3];
    } bounds[2]; /* an absent child: min +infinity, max -infinity */
    uint32_t children[2]; /* offset | kind, or LAVAPIPE_NONE */
};

struct lavapipe_triangle {
    float corners[3][3];
    uint32_t padding;
    uint32_t primitive; /* in its geometry */
    uint32_t geometry_and_flags;
};

struct lavapipe_aabb {
    float min[3], max[3];
    uint32_t primitive;
    uint32_t geometry_and_flags;
};

struct lavapipe_instance {
    uint64_t address; /* of the bottom level; a loader sets it from the handle */
    uint32_t custom_and_mask;
    uint32_t sbt_and_flags;
    float world_to_object[12];
    uint32_t padding;
    uint32_t instance; /* position in the request */
    float object_to_world[12];
};

_Static_assert(sizeof(struct lavapipe_box) == 56 && sizeof(struct lavapipe_triangle) == 48, "layout");
_Static_assert(sizeof(struct lavapipe_aabb) == 32 && sizeof(struct lavapipe_instance) == 120, "layout");

/*
 * A blob opened for reading. Pointers lead into the blob, which outlives the view. Nothing is aligned: read nodes with
 * the functions below.
 */
struct lavapipe_view {
    struct device_format device; /* UUIDs as the blob has them, and the variant by which it was read */
    const unsigned char *body;
    uint64_t body_size;
    const unsigned char *handles; /* u64, one for each instance */
    uint64_t handle_count;
    enum lavapipe_kind kind; /* of the leaves; meaningless when leaf_count is 0 */
    uint32_t leaf_offset;
    /*
     * places of leaves, those that no box refers to included; 0 for a bottom level without references. The padding of a
     * COMPACTED one may count as one more
     */
    uint32_t leaf_count;
    uint32_t levels; /* of box nodes; 1 for an empty structure: its root has no children */
    float bounds[6]; /* as the header has them: min, max; zeros when empty */
};

/*
 * Opens a hostile blob under `variant`: sizes fit, every reference leads to a node of its kind inside of the body, box
 * nodes form a tree of at most LAVAPIPE_MAX_LEVELS, so that lavapipe_traverse.h reads without another check and ends.
 * O(size). BVHD_CORRUPT or BVHD_INCOMPATIBLE with the place, "node[17].children[1]". `memory` is for a bitmap that is
 * freed before return.
 */
enum bvhd_status lavapipe_open(struct bytes blob, enum lavapipe_variant variant, struct memory *memory,
                               struct lavapipe_view *ret_view, struct bvhd_error *error);

/* The same for a blob whose variant is not known: it states its own size in its body, where only one variant has it. */
enum bvhd_status lavapipe_open_any(struct bytes blob, struct memory *memory, struct lavapipe_view *ret_view,
                                   struct bvhd_error *error);

/*
 * Copies of nodes at `offset` of the body (kind bits cleared), or of leaf i; the caller asks only for what the view's
 * check has covered.
 */
struct lavapipe_box lavapipe_box_at(const struct lavapipe_view *view, uint32_t offset);
struct lavapipe_triangle lavapipe_triangle_at(const struct lavapipe_view *view, uint32_t leaf);
struct lavapipe_aabb lavapipe_aabb_at(const struct lavapipe_view *view, uint32_t leaf);
struct lavapipe_instance lavapipe_instance_at(const struct lavapipe_view *view, uint32_t leaf);
/* Bytes of a leaf of that kind, and which leaf a reference means. */
uint32_t lavapipe_leaf_size(enum lavapipe_kind kind);
uint32_t lavapipe_leaf_index(const struct lavapipe_view *view, uint32_t reference);

/*
 * The driver's own inverse of an instance's matrix, in float and in its order of operations, so that rays through our
 * structures give the bits that they give through the driver's own. Row-major 3x4, both. Zeros where a pivot is 0 (no
 * inverse: Vulkan does not allow such a matrix): rays hit nothing there.
 */
void lavapipe_invert(const float object_to_world[12], float ret_world_to_object[12]);

#endif

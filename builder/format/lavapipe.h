/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe.h - the native layout of lavapipe, Mesa's CPU driver: its bytes as structs, and their reader. FORMATS.md has
 * the tables and the rules.
 *
 * A blob is Vulkan's serialized header with its handles, then the body, which the driver copies to the address of the
 * structure. The body has 40 bytes of header, then box nodes of two children each with the root first, then leaves,
 * where leaf i is primitive i. A reference is a node's offset in the body with the node's kind in the two lowest bits.
 * The body is not aligned in the blob.
 *
 * A top level has one handle for each leaf, in leaf order. The writer sets each to the row + 1 of the request's
 * reference table; a loader replaces them by device addresses.
 */
#ifndef BVHD_LAVAPIPE_H
#define BVHD_LAVAPIPE_H

#include <stdint.h>

#include "proto/base/bytes.h"
#include "proto/base/device_format.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* The variants of the driver's own header. A driver's variant is found by reproducing its probe, not by its version. */
enum lavapipe_variant {
    LAVAPIPE_PLAIN = 1, /* bounds, serialization size, instance count, leaf offset, padding: Mesa 25.0 */
    LAVAPIPE_COMPACTED = 2, /* bounds, compacted size, serialization size, instance count, leaf offset: Mesa 26 */
    LAVAPIPE_VARIANTS = 2
};

enum {
    LAVAPIPE_VERSION = 1, /* of the layout as it is written here; part of keys */
    LAVAPIPE_HEADER = 40, /* bytes; the root follows */
    /* levels of box nodes in one structure: a top level and a bottom level share the driver's stack of 48 */
    LAVAPIPE_MAX_LEVELS = 24,
    LAVAPIPE_MAX_PRIMITIVES = (1 << 24) - 1
};

/* The kind of a node, as stored in references. */
enum lavapipe_kind { LAVAPIPE_TRIANGLE = 0, LAVAPIPE_BOX = 1, LAVAPIPE_INSTANCE = 2, LAVAPIPE_AABB = 3 };

/* An absent child; and the flag of opaque geometries in geometry_and_flags. */
#define LAVAPIPE_NONE UINT32_C(0xffffffff)
#define LAVAPIPE_GEOMETRY_OPAQUE UINT32_C(0x80000000)

/* Flags in the upper bits of an instance's sbt_and_flags. */
#define LAVAPIPE_FORCE_OPAQUE UINT32_C(0x80000000)
#define LAVAPIPE_NOT_FORCE_NO_OPAQUE UINT32_C(0x40000000)
#define LAVAPIPE_CULL_DISABLE UINT32_C(0x20000000)
#define LAVAPIPE_FLIP_FACING UINT32_C(0x10000000)

/* A box node with two children. */
struct lavapipe_box {
    struct {
        float min[3], max[3];
    } bounds[2]; /* an absent child: min +infinity, max -infinity */
    uint32_t children[2]; /* offset | kind, or LAVAPIPE_NONE */
};

/* A leaf with a triangle. */
struct lavapipe_triangle {
    float corners[3][3];
    uint32_t padding;
    uint32_t primitive; /* its number in its geometry */
    uint32_t geometry_and_flags;
};

/* A leaf with an AABB. */
struct lavapipe_aabb {
    float min[3], max[3];
    uint32_t primitive;
    uint32_t geometry_and_flags;
};

/* A leaf with an instance. */
struct lavapipe_instance {
    uint64_t address; /* of the bottom level; a loader sets it from the handle */
    uint32_t custom_and_mask;
    uint32_t sbt_and_flags;
    float world_to_object[12];
    uint32_t padding;
    uint32_t instance; /* its position in the request */
    float object_to_world[12];
};

_Static_assert(sizeof(struct lavapipe_box) == 56 && sizeof(struct lavapipe_triangle) == 48, "layout");
_Static_assert(sizeof(struct lavapipe_aabb) == 32 && sizeof(struct lavapipe_instance) == 120, "layout");

/*
 * A blob opened for reading. Pointers lead into the blob, which must outlive the view. Nothing is aligned: read nodes
 * with the functions below.
 */
struct lavapipe_view {
    struct device_format device; /* the blob's UUIDs, and the variant by which it was read */
    const unsigned char *body;
    uint64_t body_size;
    const unsigned char *handles; /* u64, one for each instance */
    uint64_t handle_count;
    enum lavapipe_kind kind; /* of the leaves; undefined if leaf_count is 0 */
    uint32_t leaf_offset;
    /*
     * Number of leaf places, including those that no box refers to; 0 for a bottom level without references. The
     * padding of a COMPACTED structure may count as one leaf more.
     */
    uint32_t leaf_count;
    uint32_t levels; /* of box nodes; an empty structure has 1, because its root has no children */
    float bounds[6]; /* from the header: min, max; zeros if empty */
};

/*
 * Opens a hostile blob under `variant`. It checks that sizes fit, that every reference leads to a node of its kind
 * inside the body, and that box nodes form a tree of at most LAVAPIPE_MAX_LEVELS, so that lavapipe_traverse.h reads
 * without further checks and terminates. Takes O(size) time. Returns BVHD_CORRUPT or BVHD_INCOMPATIBLE with the place,
 * "node[17].children[1]". `memory` provides a bitmap that is freed before return.
 */
enum bvhd_status lavapipe_open(struct bytes blob, enum lavapipe_variant variant, struct memory *memory,
                               struct lavapipe_view *ret_view, struct bvhd_error *error);

/*
 * Does the same for a blob of unknown variant. The variant follows from the place in the body where the blob states its
 * own size.
 */
enum bvhd_status lavapipe_open_any(struct bytes blob, struct memory *memory, struct lavapipe_view *ret_view,
                                   struct bvhd_error *error);

/*
 * Opens only the headers of a hostile blob: kind, leaf_count and levels of the view are 0. Whoever reads nodes then
 * checks each of them.
 */
enum bvhd_status lavapipe_open_headers(struct bytes blob, enum lavapipe_variant variant, struct lavapipe_view *ret_view,
                                       struct bvhd_error *error);

/*
 * Return copies of the node at `offset` of the body (kind bits cleared), or of leaf i. The caller reads only what the
 * opened view covers.
 */
struct lavapipe_box lavapipe_box_at(const struct lavapipe_view *view, uint32_t offset);
struct lavapipe_triangle lavapipe_triangle_at(const struct lavapipe_view *view, uint32_t leaf);
struct lavapipe_aabb lavapipe_aabb_at(const struct lavapipe_view *view, uint32_t leaf);
struct lavapipe_instance lavapipe_instance_at(const struct lavapipe_view *view, uint32_t leaf);
/* Returns the size of a leaf of that kind in bytes, and the leaf that a reference names. */
uint32_t lavapipe_leaf_size(enum lavapipe_kind kind);
uint32_t lavapipe_leaf_index(const struct lavapipe_view *view, uint32_t reference);

/*
 * Computes bounds around both children of a box: min, max; FLT_MAX and -FLT_MAX if there are none. For the root they
 * are bounds of everything that can be hit, whereas those in the header are for the driver, and an untrusted writer may
 * have put anything there.
 */
void lavapipe_box_bounds(const struct lavapipe_box *box, float ret_bounds[6]);

/*
 * Inverts an instance's matrix in float and in the driver's order of operations, so that rays through these structures
 * give the same bits as rays through the driver's own. Both matrices are row-major 3x4. The result is zeros if a pivot
 * is 0 (there is no inverse, and Vulkan does not allow such a matrix): rays hit nothing there.
 */
void lavapipe_invert(const float object_to_world[12], float ret_world_to_object[12]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * unpacked.h - a copy of a portable structure that is faster to traverse. The boxes of its nodes are floats and as
 * tight as the triangles allow, so that a node is tested with fewer instructions and rays that leave a surface meet
 * fewer nodes. The corners of its triangles lie beside each other, so that a triangle is one access to memory instead
 * of four. The copy takes 224 bytes a node and 48 bytes a triangle, about 70 bytes a triangle in all.
 *
 * Structures of triangles, of spheres and of linear swept spheres, and top levels are unpacked. A child's box is the
 * box in the portable node, less what lies outside all primitives below it, or outside the portable boxes of all
 * instances below it. A hit lies in the boxes of the portable nodes above it, which portable.h guarantees, and in the
 * box around its primitive, so that no hit is lost. Spheres, and the ends of linear swept spheres, are copied in the
 * order of their records, so that those of a leaf lie beside each other.
 */
#ifndef BVHD_UNPACKED_H
#define BVHD_UNPACKED_H

#include "builder/format/portable.h"

/*
 * A child is a node, or a leaf: the two highest bits are 3, or the number of its records less 1; below them is the
 * node, or the first record. So of children at equal distances leaves come first.
 */
enum { CHILD_KIND_SHIFT = 30, CHILD_INDEX_MASK = (1 << CHILD_KIND_SHIFT) - 1, CHILD_NODE = 3 };

#define CHILD_ROOT ((uint32_t)CHILD_NODE << CHILD_KIND_SHIFT)

_Static_assert(PORTABLE_LEAF_MAX <= 3 && PORTABLE_MAX_ROWS - 1 <= (int)CHILD_INDEX_MASK, "a child fits into 32 bits");

/* One node, in the place of the portable node of the same index. Children keep their slots. */
struct unpacked_node {
    float planes[6][8]; /* min xyz, max xyz; empty slots have unpacked_nowhere for min, and its negative for max */
    uint32_t children[8];
};

_Static_assert(sizeof(struct unpacked_node) == 224, "a node has no gaps");

/* A coordinate beyond all that the float box tests accept, which is still far from overflow when it is divided. */
static const float unpacked_nowhere = 0x1p61f;

/* Returns whether structures with that content, an enum portable_content, can be unpacked. */
bool unpacked_takes(uint32_t content);

/* Returns the size in bytes of a structure for which that is true: its nodes, and after them what follows them. */
uint64_t unpacked_size(const struct portable_header *header);

/* Unpacks a structure for which that is true into that many bytes, in time in proportion to its size. */
void unpacked_fill(const struct portable_view *view, struct unpacked_node *ret_nodes);

/*
 * Returns what follows the nodes of spheres and of linear swept spheres: for each record its sphere, of 4 floats, or
 * its two ends, of 8, and its id in place of one more, so that a hit needs no access to the record. After them there is
 * room for UNPACKED_SHAPES_ROOM more, so that they can be read eight at a time.
 */
enum { UNPACKED_SPHERE = 5, UNPACKED_SWEPT = 9, UNPACKED_SHAPES_ROOM = 7 };

static inline const float *unpacked_shapes(const struct portable_view *view, const struct unpacked_node *nodes)
{
    return (const float *)(const void *)(nodes + view->header->node_count);
}

/* Returns the id of a shape. */
static inline uint32_t unpacked_shape_id(const float *shape, bool is_swept)
{
    uint32_t id;
    memcpy(&id, shape + (is_swept ? UNPACKED_SWEPT : UNPACKED_SPHERE) - 1, sizeof id);
    return id;
}

/* A moving node: its boxes at t = 0, and by how much each plane has moved at t = 1. */
struct unpacked_moving_node {
    struct unpacked_node start;
    float moved[6][8];
};

_Static_assert(sizeof(struct unpacked_moving_node) == 416, "a node has no gaps");

/* A motion triangle: 16 bytes from the beginning of any corner are inside, and are numbers. */
struct unpacked_moving_triangle {
    float start[3][3], end[3][3];
    float zero;
    uint32_t id;
};

/*
 * Returns the size in bytes of an unpacked structure that moves: its nodes, and after them its triangles. Motion
 * instances stay where they are.
 */
static inline uint64_t unpacked_moving_size(const struct portable_header *header)
{
    const uint64_t nodes = header->node_count * (uint64_t)sizeof(struct unpacked_moving_node);
    if (header->content != PORTABLE_MOVING_TRIANGLES)
        return nodes;
    return nodes + header->record_count * (uint64_t)sizeof(struct unpacked_moving_triangle);
}

static inline const struct unpacked_moving_triangle *unpacked_moving_triangles(const struct portable_view *view,
                                                                               const struct unpacked_moving_node *nodes)
{
    return (const struct unpacked_moving_triangle *)(const void *)(nodes + view->header->node_count);
}

/*
 * Unpacks a structure of motion triangles or of motion instances into that many bytes (unpacked_moving.c). The view
 * stays as it is. The box of an instance is that in the portable node, moved outward by what its floats lose.
 */
void unpacked_moving_fill(const struct portable_view *view, struct unpacked_moving_node *ret_nodes);

/* Indexed triangles with their corners beside each other: what a view needs in order to have stored triangles. */
struct unpacked_triangles {
    struct portable_header header;
    struct portable_triangle triangles[];
};

/* Returns the size in bytes for a number of triangles. */
static inline uint64_t unpacked_triangles_size(uint32_t count)
{
    return sizeof(struct unpacked_triangles) + (uint64_t)count * sizeof(struct portable_triangle);
}

/*
 * Copies the triangles of a view of indexed ones, and changes the view so that it has these copies as its records. They
 * have the same rows, ids and corners, so that rays have the same hits.
 */
void unpacked_store_corners(struct portable_view *view, struct unpacked_triangles *ret_triangles);

#endif

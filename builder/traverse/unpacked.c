/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/unpacked.h"

#include <math.h>

#include "builder/traverse/traverse_walk.h"

static float lesser(float a, float b)
{
    return a < b ? a : b;
}

static float greater(float a, float b)
{
    return a > b ? a : b;
}

/* Makes a box empty: one of an empty slot, or one that is to be extended. */
static void box_clear(float box[6], float nowhere)
{
    for (int axis = 0; axis < 3; axis++) {
        box[axis] = nowhere;
        box[3 + axis] = -nowhere;
    }
}

static void box_of_all(float box[6])
{
    for (int axis = 0; axis < 3; axis++) {
        box[axis] = -INFINITY;
        box[3 + axis] = INFINITY;
    }
}

/* Extends a box by the box around a point, or around another box. */
static void box_add(float box[6], const float min[3], const float max[3])
{
    for (int axis = 0; axis < 3; axis++) {
        box[axis] = lesser(min[axis], box[axis]);
        box[3 + axis] = greater(max[axis], box[3 + axis]);
    }
}

/* Finds the box around the boxes of all children of a node. */
static void box_of_node(const struct unpacked_node *node, float ret_box[6])
{
    box_clear(ret_box, INFINITY);
    for (int axis = 0; axis < 3; axis++)
        for (int slot = 0; slot < 8; slot++) {
            const float low = node->planes[axis][slot], high = node->planes[3 + axis][slot];
            const bool is_empty = low > high; /* then the planes are not far enough away for huge coordinates */
            ret_box[axis] = lesser(is_empty ? INFINITY : low, ret_box[axis]);
            ret_box[3 + axis] = greater(is_empty ? -INFINITY : high, ret_box[3 + axis]);
        }
}

static void box_of_records(const struct portable_view *view, uint32_t first, uint32_t count, float ret_box[6])
{
    box_clear(ret_box, INFINITY);
    for (uint32_t record = first; record < first + count; record++) {
        const float *corners[3];
        traverse_corners(view, record, corners);
        for (int k = 0; k < 3; k++)
            box_add(ret_box, corners[k], corners[k]);
    }
}

/*
 * Returns a plane of a portable node's grid as a float, moved outward by at most two steps of float. In double its
 * rounding error is less than half a step of float.
 */
static float plane(float origin, uint8_t steps, float scale, float outward)
{
    return nextafterf((float)(origin + (double)steps * scale), outward);
}

static float scale_of(uint8_t exponent)
{
    return exponent == 0 ? 0 : ldexpf(1, exponent - 127);
}

static void fill_child(const struct portable_view *view, const struct portable_node *from, unsigned slot,
                       uint32_t inner, const struct unpacked_node *nodes, struct unpacked_node *to)
{
    float box[6];
    if (from->meta[slot] == 0) {
        to->children[slot] = 0;
        box_clear(box, unpacked_nowhere);
    } else if (from->inner_mask >> slot & 1) {
        to->children[slot] = inner | (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
        box_of_node(&nodes[inner], box);
    } else {
        const uint32_t count = (uint32_t)__builtin_popcount(from->meta[slot] >> 5),
                       first = from->first_record + (from->meta[slot] & 31);
        to->children[slot] = (count - 1) << CHILD_KIND_SHIFT | first;
        if (view->header->content <= PORTABLE_TRIANGLES)
            box_of_records(view, first, count, box);
        else
            box_of_all(box);
    }
    for (int axis = 0; axis < 3; axis++) {
        float scale = scale_of(from->exponent[axis]), origin = from->origin[axis];
        to->planes[axis][slot] = greater(box[axis], plane(origin, from->lo[axis][slot], scale, -INFINITY));
        to->planes[3 + axis][slot] = lesser(box[3 + axis], plane(origin, from->hi[axis][slot], scale, INFINITY));
    }
}

void unpacked_fill(const struct portable_view *view, struct unpacked_node *ret_nodes)
{
    /* Children follow their parents, so that their boxes are known. */
    for (uint32_t index = view->header->node_count; index-- > 0;) {
        const struct portable_node *from = &view->nodes[index];
        uint32_t inner = from->first_child;
        for (unsigned slot = 0; slot < 8; slot++) {
            fill_child(view, from, slot, inner, ret_nodes, &ret_nodes[index]);
            inner += from->inner_mask >> slot & 1;
        }
    }
}

void unpacked_store_corners(struct portable_view *view, struct unpacked_triangles *ret_triangles)
{
    ret_triangles->header = *view->header;
    ret_triangles->header.content = PORTABLE_TRIANGLES;
    for (uint32_t record = 0; record < view->header->record_count; record++) {
        const float *corners[3];
        struct portable_triangle *to = &ret_triangles->triangles[record];
        *to = (struct portable_triangle){.id = traverse_corners_indexed(view, record, corners)};
        memcpy(to->v0, corners[0], sizeof to->v0);
        memcpy(to->v1, corners[1], sizeof to->v1);
        memcpy(to->v2, corners[2], sizeof to->v2);
    }
    view->header = &ret_triangles->header;
    view->records = ret_triangles->triangles;
}

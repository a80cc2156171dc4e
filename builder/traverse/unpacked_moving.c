/* SPDX-License-Identifier: Apache-2.0 */
/* unpacked_moving.c - unpacks structures of motion triangles and of motion instances. */
#include "builder/traverse/unpacked.h"

#include <math.h>

/* The boxes of t = 0 and t = 1. */
struct keys {
    struct box at[2];
};

static struct keys keys_of_records(const struct portable_view *view, uint32_t first, uint32_t count)
{
    const struct portable_indexed_triangle *triangles = view->records;
    struct keys keys = {{box_empty(), box_empty()}};
    for (uint32_t record = first; record < first + count; record++)
        for (int k = 0; k < 3; k++) {
            const float *vertex = view->vertices + (uint64_t)6 * triangles[record].vertices[k];
            box_add_point(&keys.at[0], vertex);
            box_add_point(&keys.at[1], vertex + 3);
        }
    return keys;
}

/* Returns the boxes around all children of a node, of which `moved` still has the planes of t = 1. */
static struct keys keys_of_node(const struct unpacked_moving_node *node)
{
    struct keys keys = {{box_empty(), box_empty()}};
    for (unsigned slot = 0; slot < 8; slot++)
        for (int key = 0; key < 2; key++) {
            const float(*planes)[8] = key ? node->moved : node->start.planes;
            const struct box box = {{planes[0][slot], planes[1][slot], planes[2][slot]},
                                    {planes[3][slot], planes[4][slot], planes[5][slot]}};
            if (!box_is_empty(&box))
                box_grow(&keys.at[key], &box);
        }
    return keys;
}

/* Unpacks a node, whose children are, with the planes of t = 1 in `moved`. */
static void fill_node(const struct portable_view *view, uint32_t index, const struct unpacked_moving_node *nodes,
                      struct unpacked_moving_node *to)
{
    const struct portable_node *from = portable_node_at(view, index);
    uint32_t inner = from->first_child;
    for (unsigned slot = 0; slot < 8; slot++) {
        struct keys keys;
        for (int plane = 0; plane < 6; plane++)
            to->start.planes[plane][slot] = to->moved[plane][slot] = plane < 3 ? unpacked_nowhere : -unpacked_nowhere;
        to->start.children[slot] = 0;
        if (from->meta[slot] == 0)
            continue;
        if (from->inner_mask >> slot & 1) {
            to->start.children[slot] = inner | (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
            keys = keys_of_node(&nodes[inner++]);
        } else {
            const uint32_t count = (uint32_t)__builtin_popcount(from->meta[slot] >> 5),
                           first = from->first_record + (from->meta[slot] & 31);
            to->start.children[slot] = (count - 1) << CHILD_KIND_SHIFT | first;
            keys = keys_of_records(view, first, count);
        }
        for (int axis = 0; axis < 3; axis++) {
            to->start.planes[axis][slot] = keys.at[0].min[axis];
            to->start.planes[3 + axis][slot] = keys.at[0].max[axis];
            to->moved[axis][slot] = keys.at[1].min[axis];
            to->moved[3 + axis][slot] = keys.at[1].max[axis];
        }
    }
}

static void fill_triangle(const struct portable_view *view, uint32_t record, struct unpacked_moving_triangle *to)
{
    const struct portable_indexed_triangle *from = (const struct portable_indexed_triangle *)view->records + record;
    for (int k = 0; k < 3; k++) {
        const float *vertex = view->vertices + (uint64_t)6 * from->vertices[k];
        memcpy(to->start[k], vertex, sizeof to->start[k]);
        memcpy(to->end[k], vertex + 3, sizeof to->end[k]);
    }
    to->zero = 0;
    to->id = from->id;
}

/* Returns a plane of a portable node as a float, moved outward; in double it is exact. */
static float plane_at(const struct portable_node *node, int axis, uint8_t steps, float outward)
{
    const double step = node->exponent[axis] ? ldexp(1, node->exponent[axis] - 127) : 0;
    return nextafterf((float)(node->origin[axis] + steps * step), outward);
}

/* Unpacks a node of a top level, with the planes of t = 1 in `moved`. */
static void fill_top_node(const struct portable_view *view, uint32_t index, struct unpacked_moving_node *to)
{
    const struct portable_node *from = portable_node_at(view, index);
    const struct portable_moving_node *moving = (const struct portable_moving_node *)(const void *)from;
    uint32_t inner = from->first_child;
    for (unsigned slot = 0; slot < 8; slot++) {
        const bool is_empty = from->meta[slot] == 0, is_inner = from->inner_mask >> slot & 1;
        const uint32_t count = (uint32_t)__builtin_popcount(from->meta[slot] >> 5),
                       first = from->first_record + (from->meta[slot] & 31);
        to->start.children[slot] = is_empty   ? 0
                                   : is_inner ? inner | (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT
                                              : (count - 1) << CHILD_KIND_SHIFT | first;
        inner += is_inner;
        for (int axis = 0; axis < 3; axis++) {
            to->start.planes[axis][slot] =
                is_empty ? unpacked_nowhere : plane_at(from, axis, from->lo[axis][slot], -INFINITY);
            to->start.planes[3 + axis][slot] =
                is_empty ? -unpacked_nowhere : plane_at(from, axis, from->hi[axis][slot], INFINITY);
            to->moved[axis][slot] =
                is_empty ? unpacked_nowhere : plane_at(from, axis, moving->end_lo[axis][slot], -INFINITY);
            to->moved[3 + axis][slot] =
                is_empty ? -unpacked_nowhere : plane_at(from, axis, moving->end_hi[axis][slot], INFINITY);
        }
    }
}

/* Children follow their parents, so that their boxes are known when they are needed. */
void unpacked_moving_fill(const struct portable_view *view, struct unpacked_moving_node *ret_nodes)
{
    const uint32_t node_count = view->header->node_count;
    const bool has_triangles = view->header->content == PORTABLE_MOVING_TRIANGLES;
    struct unpacked_moving_triangle *triangles = (void *)(ret_nodes + node_count);
    for (uint32_t index = node_count; index-- > 0;)
        if (has_triangles)
            fill_node(view, index, ret_nodes, &ret_nodes[index]);
        else
            fill_top_node(view, index, &ret_nodes[index]);
    for (uint32_t index = 0; index < node_count; index++)
        for (int plane = 0; plane < 6; plane++)
            for (unsigned slot = 0; slot < 8; slot++)
                ret_nodes[index].moved[plane][slot] -= ret_nodes[index].start.planes[plane][slot];
    for (uint32_t record = 0; has_triangles && record < view->header->record_count; record++)
        fill_triangle(view, record, &triangles[record]);
}

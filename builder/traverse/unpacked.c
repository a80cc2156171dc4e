/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/unpacked.h"

#include <math.h>

#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/round_records.h"

static float lesser(float a, float b)
{
    return a < b ? a : b;
}

static float greater(float a, float b)
{
    return a > b ? a : b;
}

/* Returns an empty box: one of an empty slot, or one that is to be extended. */
static struct box box_cleared(float nowhere)
{
    return (struct box){{nowhere, nowhere, nowhere}, {-nowhere, -nowhere, -nowhere}};
}

/* Returns the box around the boxes of all children of a node. */
static struct box box_of_node(const struct unpacked_node *node)
{
    struct box box = box_cleared(INFINITY);
    for (int axis = 0; axis < 3; axis++)
        for (int slot = 0; slot < 8; slot++) {
            const float low = node->planes[axis][slot], high = node->planes[3 + axis][slot];
            const bool is_empty = low > high; /* then the planes are not far enough away for huge coordinates */
            box.min[axis] = lesser(is_empty ? INFINITY : low, box.min[axis]);
            box.max[axis] = greater(is_empty ? -INFINITY : high, box.max[axis]);
        }
    return box;
}

/* Returns the box around records, or the whole space if they do not tell where they are. */
static struct box box_of_records(const struct portable_view *view, uint32_t first, uint32_t count)
{
    const struct leaf_kind *kind = leaf_kind_of(view);
    struct box box = box_cleared(kind->grow ? INFINITY : -INFINITY);
    if (kind->grow)
        kind->grow(view, first, count, &box);
    return box;
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
    struct box box;
    if (from->meta[slot] == 0) {
        to->children[slot] = 0;
        box = box_cleared(unpacked_nowhere);
    } else if (from->inner_mask >> slot & 1) {
        to->children[slot] = inner | (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
        box = box_of_node(&nodes[inner]);
    } else {
        const uint32_t count = (uint32_t)__builtin_popcount(from->meta[slot] >> 5),
                       first = from->first_record + (from->meta[slot] & 31);
        to->children[slot] = (count - 1) << CHILD_KIND_SHIFT | first;
        box = box_of_records(view, first, count);
    }
    for (int axis = 0; axis < 3; axis++) {
        float scale = scale_of(from->exponent[axis]), origin = from->origin[axis];
        to->planes[axis][slot] = greater(box.min[axis], plane(origin, from->lo[axis][slot], scale, -INFINITY));
        to->planes[3 + axis][slot] = lesser(box.max[axis], plane(origin, from->hi[axis][slot], scale, INFINITY));
    }
}

bool unpacked_takes(uint32_t content)
{
    return leaf_kinds[content]->can_unpack;
}

uint64_t unpacked_size(const struct portable_header *header)
{
    return header->node_count * (uint64_t)sizeof(struct unpacked_node) +
           ((uint64_t)header->record_count + UNPACKED_SHAPES_ROOM) * leaf_kinds[header->content]->shape_floats *
               sizeof(float);
}

/* Copies the vertices of round records. */
static void fill_shapes(const struct portable_view *view, float *ret_shapes)
{
    const uint32_t floats = leaf_kind_of(view)->shape_floats, count = view->header->record_count;
    if (floats == 0)
        return;
    for (uint32_t i = 0; i < count; i++) {
        const struct portable_round *round = round_record_at(view, i);
        float *shape = ret_shapes + (uint64_t)floats * i;
        memcpy(shape, round_vertex_of(view, round), (floats - 1) * sizeof(float));
        memcpy(shape + floats - 1, &round->id, sizeof round->id);
    }
    memset(ret_shapes + (uint64_t)floats * count, 0, UNPACKED_SHAPES_ROOM * floats * sizeof(float));
}

void unpacked_fill(const struct portable_view *view, struct unpacked_node *ret_nodes)
{
    fill_shapes(view, (float *)(void *)(ret_nodes + view->header->node_count));
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

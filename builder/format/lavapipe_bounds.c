/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe_bounds.h"

enum { NODE_CHUNK = 4096 };

struct box lavapipe_bounds_join(const struct box *first, const struct box *second)
{
    struct box box;
    for (int axis = 0; axis < 3; axis++) {
        box.min[axis] = first->min[axis] < second->min[axis] ? first->min[axis] : second->min[axis];
        box.max[axis] = first->max[axis] > second->max[axis] ? first->max[axis] : second->max[axis];
    }
    return box;
}

static struct box triangle_box(const struct canonical_geometry *geometry, uint32_t index)
{
    float corners[3][3];
    struct box boxes[3], pair;
    canonical_triangle(geometry, index, corners);
    for (int k = 0; k < 3; k++) {
        memcpy(boxes[k].min, corners[k], sizeof corners[k]);
        memcpy(boxes[k].max, corners[k], sizeof corners[k]);
    }
    pair = lavapipe_bounds_join(&boxes[0], &boxes[1]);
    return lavapipe_bounds_join(&pair, &boxes[2]);
}

static struct box aabb_box(const struct canonical_geometry *geometry, uint32_t index)
{
    struct box box;
    memcpy(box.min, geometry->boxes + (uint64_t)6 * index, sizeof box.min);
    memcpy(box.max, geometry->boxes + (uint64_t)6 * index + 3, sizeof box.max);
    return box;
}

/* The bounds of an empty structure are zeros in the driver's header. */
static struct box instance_box(const struct canonical *canonical, const struct canonical_geometry *geometry,
                               uint32_t index)
{
    struct canonical_instance instance = canonical_instance(geometry, index);
    struct box bounds = canonical->references[instance.reference - 1].bounds, box;
    if (box_is_empty(&bounds))
        bounds = (struct box){{0, 0, 0}, {0, 0, 0}};
    for (int row = 0; row < 3; row++) {
        const float *m = instance.transform + 4 * row;
        box.min[row] = box.max[row] = m[3];
        for (int axis = 0; axis < 3; axis++) {
            float from = m[axis] * bounds.min[axis], to = m[axis] * bounds.max[axis];
            box.min[row] += from < to ? from : to;
            box.max[row] += from > to ? from : to;
        }
    }
    return box;
}

struct box lavapipe_bounds_leaf(const struct canonical *canonical, uint32_t id)
{
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    uint32_t index = id - geometry->first_primitive;
    if (geometry->type == GEOMETRY_TRIANGLES)
        return triangle_box(geometry, index);
    return geometry->type == GEOMETRY_AABBS ? aabb_box(geometry, index) : instance_box(canonical, geometry, index);
}

struct inflation {
    const struct canonical *canonical;
    struct ir *ir;
    float slack;
};

static float largest_side(const struct box *box)
{
    float largest = 0;
    for (int axis = 0; axis < 3; axis++) {
        float side = box->max[axis] - box->min[axis];
        largest = side > largest ? side : largest;
    }
    return largest;
}

static void inflate_box(const struct box *whole, float slack, struct box *box)
{
    for (int axis = 0; axis < 3; axis++) {
        float min = box->min[axis] - slack, max = box->max[axis] + slack;
        box->min[axis] = min > whole->min[axis] ? min : whole->min[axis];
        box->max[axis] = max < whole->max[axis] ? max : whole->max[axis];
    }
}

/* A tree's boxes must be finite; the comparisons ignore NaN. */
void lavapipe_bounds_grow(struct box *box, const struct box *drivers)
{
    for (int axis = 0; axis < 3; axis++) {
        float min = drivers->min[axis] < -FLT_MAX ? -FLT_MAX : drivers->min[axis];
        float max = drivers->max[axis] > FLT_MAX ? FLT_MAX : drivers->max[axis];
        box->min[axis] = min < box->min[axis] ? min : box->min[axis];
        box->max[axis] = max > box->max[axis] ? max : box->max[axis];
    }
}

static void inflate_leaves(void *context, size_t index)
{
    const struct inflation *inflation = context;
    struct ir *ir = inflation->ir;
    size_t node, end;
    for (parallel_chunk(index, NODE_CHUNK, ir->node_count, &node, &end); node < end; node++) {
        if (!ir_is_leaf(ir, (uint32_t)node))
            continue;
        struct box drivers = lavapipe_bounds_leaf(inflation->canonical, ir->refs[ir->nodes[node].first]);
        if (inflation->canonical->type == STRUCTURE_TOP)
            lavapipe_bounds_grow(&ir->boxes[0][node], &drivers);
        else
            inflate_box(&drivers, inflation->slack, &ir->boxes[0][node]);
    }
}

static bool refit(struct ir *ir, const atomic_bool *cancel)
{
    for (uint32_t node = ir->node_count; node-- > 0;) {
        if (parallel_cancelled_at(cancel, node))
            return false;
        if (ir_is_leaf(ir, node))
            continue;
        const struct box *children = &ir->boxes[0][ir->nodes[node].first];
        ir->boxes[0][node] = children[0];
        box_grow(&ir->boxes[0][node], &children[1]);
    }
    return true;
}

bool lavapipe_bounds_inflate(const struct canonical *canonical, const struct parallel *parallel,
                             const atomic_bool *cancel, struct ir *ir)
{
    if (ir->node_count == 0)
        return true;
    struct inflation inflation = {canonical, ir, largest_side(&ir->boxes[0][0]) * 0x1p-16f};
    size_t chunks = parallel_chunks(NODE_CHUNK, ir->node_count);
    return parallel_for_until(parallel, cancel, chunks, inflate_leaves, &inflation) && refit(ir, cancel);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* moving_triangles.c - motion triangles: what they have beyond triangles, their vertices at t = 1. */
#include "builder/input/classification.h"
#include "builder/input/reach.h"
#include "builder/input/triangles.h"
#include "builder/input/triangles_refs.h"
#include "builder/input/validate.h"
#include "builder/input/vertex_format.h"
#include "proto/base/place.h"

static const char end_data[] = "triangles.motion.vertexData";

/* The vertices at t = 1 must be there for whatever names those at t = 0. */
static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    const struct geometry_range *range = &subject->geometry->range;
    enum bvhd_status status = triangles_check_memory(subject);
    if (status != BVHD_OK || range->primitive_count == 0)
        return status;
    const uint64_t last = (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count - 1;
    if (!triangles->end_vertices.data ||
        (triangles->index_type == INDEX_NONE &&
         !bytes_reach(triangles->end_vertices.size, range->primitive_offset, triangles->vertex_stride, last,
                      vertex_format_find(triangles->vertex_format)->size)))
        return validate_refuse_memory(subject, BVHD_VUID_11820, end_data, &triangles->end_vertices, "vertices");
    return BVHD_OK;
}

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->positions = data;
    geometry->end_positions = data ? geometry->positions + (size_t)3 * geometry->vertex_count : NULL;
}

static enum bvhd_status finish(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    enum bvhd_status status = triangles_finish(fetch, index, error);
    if (status != BVHD_OK || geometry->range.primitive_count == 0 || triangles->index_type == INDEX_NONE)
        return status;
    const uint64_t last = (uint64_t)geometry->range.first_vertex + fetch->sources[index].highest;
    if (bytes_reach(triangles->end_vertices.size, 0, triangles->vertex_stride, last,
                    vertex_format_find(triangles->vertex_format)->size))
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_11820,
                           place("infos[%u].geometries[%u].%s", fetch->index, index, end_data).text,
                           "%llu bytes do not hold vertex %llu", (unsigned long long)triangles->end_vertices.size,
                           (unsigned long long)last);
}

static void fetch_vertices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry_triangles *triangles = &fetch->input->geometries[index].triangles;
    const struct form_geometry *row = fetch_row(fetch, index);
    float *positions = (float *)(void *)(fetch->block + row->data_offset) + (size_t)3 * first;
    triangles_read_vertices(fetch, index, &triangles->vertices, first, count, positions);
    triangles_read_vertices(fetch, index, &triangles->end_vertices, first, count,
                            positions + (size_t)3 * row->vertex_count);
}

/* Returns the box of clamped corners. */
static struct box box_of(const float corners[3][3])
{
    struct box box = box_empty();
    for (int k = 0; k < 3; k++) {
        const float clamped[3] = {classification_clamp(corners[k][0]), classification_clamp(corners[k][1]),
                                  classification_clamp(corners[k][2])};
        box_add_point(&box, clamped);
    }
    return box;
}

static bool are_same(const float keys[2][3][3], int a, int b)
{
    bool same = true;
    for (int key = 0; key < 2; key++)
        for (int axis = 0; axis < 3; axis++)
            same &= keys[key][a][axis] == keys[key][b][axis];
    return same;
}

/*
 * Returns whether the triangle has no area at any time, whatever rounding moves its corners: two corners are one, or
 * all are on a line along an axis. Corners that are on another line at both ends may leave it between them.
 */
static bool has_no_area(const float keys[2][3][3], const struct box boxes[2])
{
    int flat = 0;
    for (int axis = 0; axis < 3; axis++)
        flat += boxes[0].min[axis] == boxes[0].max[axis] && boxes[1].min[axis] == boxes[1].max[axis];
    return flat >= 2 || are_same(keys, 0, 1) || are_same(keys, 1, 2) || are_same(keys, 2, 0);
}

static struct classification look_at_keys(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index, struct box ret_boxes[2])
{
    struct classification finding = {.box = box_empty()};
    float keys[2][3][3];
    for (int key = 0; key < 2; key++) {
        canonical_triangle_at(geometry, index, key, keys[key]);
        ret_boxes[key] = box_of((const float(*)[3])keys[key]);
    }
    if (classification_has_nan(keys[0][0], 18))
        return finding;
    finding.active = true;
    const bool is_infinite = classification_has_infinity(keys[0][0], 18);
    finding.degenerate = !is_infinite && has_no_area((const float(*)[3][3])keys, ret_boxes);
    finding.kept = ((canonical->flags & BUILD_ALLOW_UPDATE) || !(is_infinite || finding.degenerate)) &&
                   !canonical_is_transparent(geometry, index);
    box_grow(&finding.box, &ret_boxes[0]);
    box_grow(&finding.box, &ret_boxes[1]);
    return finding;
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    struct box boxes[2];
    return look_at_keys(canonical, geometry, index, boxes);
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return triangles_refs_collect_moving(look, canonical, geometry, first, end, counts, refs);
}

/* The place of a vertex at any time is between its places at both ends. */
static void outline(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach)
{
    for (int key = 0; key < 2; key++)
        reach_add_vertices(reach, canonical_positions(geometry, key) + (size_t)3 * first, count);
}

const struct input_kind input_moving_triangles = {
    .version = CANONICAL_VERSION_ROUND,
    .corners = 3,
    .check_memory = check_memory,
    .describe = triangles_describe,
    .update_is_sound = triangles_update_is_sound,
    .view = view,
    .fetch_primitives = triangles_fetch_indices,
    .finish = finish,
    .rebase = triangles_rebase,
    .fetch_vertices = fetch_vertices,
    .check_foreign = triangles_check_foreign,
    .look = look,
    .look_at_keys = look_at_keys,
    .grow_keys = triangles_refs_grow_keys,
    .prefetch_keys = triangles_refs_prefetch_keys,
    .collect = collect,
    .outline = outline,
};

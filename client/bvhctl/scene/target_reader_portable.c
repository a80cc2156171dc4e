/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/target_reader.h"

#include <math.h>
#include <string.h>

#include "builder/format/record_kind.h"
#include "builder/traverse/motion.h"
#include "client/bvhctl/scene/survey.h"

static const struct {
    enum structure_content content;
    const char *name;
} contents[] = {
    [PORTABLE_INDEXED_TRIANGLES] = {CONTENT_TRIANGLES, "indexed triangles"},
    [PORTABLE_TRIANGLES] = {CONTENT_TRIANGLES, "triangles"},
    [PORTABLE_AABBS] = {CONTENT_AABBS, "AABBs"},
    [PORTABLE_INSTANCES] = {CONTENT_INSTANCES, "instances"},
    [PORTABLE_SPHERES] = {CONTENT_SPHERES, "spheres"},
    [PORTABLE_SWEPT_SPHERES] = {CONTENT_SWEPT_SPHERES, "linear swept spheres"},
    [PORTABLE_MOVING_TRIANGLES] = {CONTENT_TRIANGLES, "motion triangles"},
    [PORTABLE_MOVING_INSTANCES] = {CONTENT_INSTANCES, "motion instances"},
};

static enum bvhd_status open_structure(struct structure *structure, struct bvhd_error *error)
{
    struct portable_view *view = &structure->view.portable;
    enum bvhd_status status = portable_open(structure->blob, structure->memory, view, error);
    if (status != BVHD_OK)
        return status;
    const struct portable_header *header = view->header;
    structure->content = contents[header->content].content;
    structure->moves = record_kind_moves(record_kind_of(header->content));
    structure->primitive_count = header->primitive_count;
    structure->record_count = header->record_count;
    structure->geometries =
        memory_array(structure->memory, (uint64_t)header->geometry_count + 1, sizeof *structure->geometries);
    if (!structure->geometries)
        return bvhd_error_no_memory(error, "geometries", "no memory for them");
    for (uint32_t i = 0; i < header->geometry_count; i++) {
        const struct portable_geometry *row = &view->geometries[i];
        structure->geometries[i] =
            (struct structure_geometry){i, row->flags, row->first_primitive, row->primitive_count};
    }
    structure->geometry_count = header->geometry_count;
    return BVHD_OK;
}

static void get_bounds(const struct structure *structure, float ret_bounds[6])
{
    const struct portable_header *header = structure->view.portable.header;
    memset(ret_bounds, 0, 6 * sizeof *ret_bounds);
    if (header->node_count)
        memcpy(ret_bounds, header->bounds, sizeof header->bounds);
}

static void get_triangle(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3],
                         uint32_t *ret_primitive)
{
    const struct portable_view *view = &structure->view.portable;
    if (structure->moves) {
        *ret_primitive = motion_corners(view, row, motion_weights_at(time), ret_corners) & PORTABLE_ID_MASK;
        return;
    }
    if (view->header->content == PORTABLE_TRIANGLES) {
        const struct portable_triangle *record = (const struct portable_triangle *)view->records + row;
        memcpy(ret_corners[0], record->v0, sizeof record->v0);
        memcpy(ret_corners[1], record->v1, sizeof record->v1);
        memcpy(ret_corners[2], record->v2, sizeof record->v2);
        *ret_primitive = record->id & PORTABLE_ID_MASK;
        return;
    }
    const struct portable_indexed_triangle *record = (const struct portable_indexed_triangle *)view->records + row;
    for (int i = 0; i < 3; i++)
        memcpy(ret_corners[i], view->vertices + UINT64_C(3) * record->vertices[i], sizeof ret_corners[i]);
    *ret_primitive = record->id & PORTABLE_ID_MASK;
}

static struct structure_round get_round(const struct structure *structure, uint32_t row)
{
    const struct portable_view *view = &structure->view.portable;
    const struct portable_round *record = (const struct portable_round *)view->records + row;
    bool is_swept = structure->content == CONTENT_SWEPT_SPHERES;
    struct structure_round round = {.caps = is_swept ? portable_round_caps(record->id) : 0,
                                    .primitive = record->id & PORTABLE_ID_MASK};
    for (uint64_t end = 0; end < 2; end++)
        memcpy(round.ends[end], view->vertices + 4 * (record->vertex + (is_swept ? end : 0)), sizeof round.ends[end]);
    return round;
}

static struct structure_instance get_moving_instance(const struct portable_view *view, uint32_t row)
{
    const struct portable_moving_instance *record = (const struct portable_moving_instance *)view->records + row;
    struct structure_instance instance = {
        .motion = record->motion, .instance = record->instance, .bottom = record->handle};
    memcpy(instance.start, record->start, sizeof instance.start);
    memcpy(instance.end, record->end, sizeof instance.end);
    return instance;
}

static struct structure_instance get_instance(const struct structure *structure, uint32_t row)
{
    const struct portable_view *view = &structure->view.portable;
    if (structure->moves)
        return get_moving_instance(view, row);
    const struct portable_instance *record = (const struct portable_instance *)view->records + row;
    struct structure_instance instance = {.instance = record->instance, .bottom = record->handle};
    memcpy(instance.start, record->object_to_world, sizeof record->object_to_world);
    memcpy(instance.end, record->object_to_world, sizeof record->object_to_world);
    return instance;
}

static const char *content_name(const struct structure *structure)
{
    return contents[structure->view.portable.header->content].name;
}

/* ---- the survey ---- */

static void count_bytes(const struct portable_view *view, uint64_t blob_size, struct survey *survey)
{
    const struct portable_header *header = view->header;
    const struct record_kind *kind = record_kind_of(header->content);
    survey->node_bytes = header->node_count * (uint64_t)kind->node_size;
    survey->record_bytes = header->record_count * (uint64_t)kind->size;
    survey->vertex_bytes = header->vertex_count * (uint64_t)kind->vertex_size;
    survey->geometry_bytes = header->geometry_count * (uint64_t)sizeof(struct portable_geometry);
    survey->header_bytes = blob_size - header->body_size + sizeof *header;
    survey->other_bytes = blob_size - survey->header_bytes - survey->node_bytes - survey->record_bytes -
                          survey->vertex_bytes - survey->geometry_bytes;
}

/* Returns half the area of a box whose sides are given in steps of the node's grid. */
static double half_area(const struct portable_node *node, const double steps[3])
{
    double side[3];
    for (int axis = 0; axis < 3; axis++)
        side[axis] = node->exponent[axis] ? ldexp(steps[axis], node->exponent[axis] - 127) : 0;
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
}

/*
 * Returns half the area of a slot's box; of one that moves the mean over all times. Its sides are linear in the time,
 * and the area is quadratic, for which Simpson's rule is exact.
 */
static double slot_half_area(const struct portable_node *node, bool moves, unsigned slot)
{
    const struct portable_moving_node *moving = (const struct portable_moving_node *)node;
    double start[3], middle[3], end[3];
    for (int axis = 0; axis < 3; axis++)
        start[axis] = node->hi[axis][slot] - node->lo[axis][slot];
    if (!moves)
        return half_area(node, start);
    for (int axis = 0; axis < 3; axis++) {
        end[axis] = moving->end_hi[axis][slot] - moving->end_lo[axis][slot];
        middle[axis] = (start[axis] + end[axis]) / 2;
    }
    return (half_area(node, start) + 4 * half_area(node, middle) + half_area(node, end)) / 6;
}

/* Returns the number of records in a leaf slot, which `meta` has in unary. */
static unsigned leaf_count(uint8_t meta)
{
    return (unsigned)__builtin_popcount(meta >> 5);
}

/* Counts node `index`. Parents come before their children in the file, so the level of a node is known by then. */
static void count_node(const struct portable_view *view, uint32_t index, uint8_t *levels, struct survey *survey)
{
    const struct portable_node *node = portable_node_at(view, index);
    const bool moves = record_kind_moves(record_kind_of(view->header->content));
    unsigned children = 0, inner = 0;
    survey->level_nodes[levels[index]]++;
    for (unsigned slot = 0; slot < 8; slot++) {
        if (node->meta[slot] == 0)
            continue;
        bool is_inner = node->inner_mask >> slot & 1;
        children++;
        survey->sah += slot_half_area(node, moves, slot) * (is_inner ? 1 : leaf_count(node->meta[slot]));
        if (is_inner)
            levels[node->first_child + inner++] = levels[index] + 1;
        else
            survey->leaf_records[leaf_count(node->meta[slot])]++;
    }
    survey->inner_children += inner;
    survey->leaf_children += children - inner;
    survey->node_children[children]++;
}

static enum bvhd_status take_survey(const struct structure *structure, struct memory *memory, struct survey *survey)
{
    const struct portable_view *view = &structure->view.portable;
    const struct portable_header *header = view->header;
    survey->arity = 8;
    survey->leaf_max = PORTABLE_LEAF_MAX;
    survey->depth = header->depth;
    survey->nodes = header->node_count;
    survey->records = header->record_count;
    survey_add_figure(survey, "version", header->version);
    survey_add_figure(survey, "build_flags", header->build_flags);
    survey_add_figure(survey, "vertices", header->vertex_count);
    count_bytes(view, structure->blob.size, survey);
    if (header->node_count == 0)
        return BVHD_OK;
    uint8_t *levels = memory_alloc(memory, header->node_count);
    if (!levels)
        return BVHD_NO_MEMORY;
    levels[0] = 0;
    for (uint32_t i = 0; i < header->node_count; i++)
        count_node(view, i, levels, survey);
    memory_free(memory, levels);
    struct box bounds;
    memcpy(&bounds, header->bounds, sizeof bounds);
    survey->sah = survey->sah / box_half_area(&bounds) + 1;
    return BVHD_OK;
}

const struct target_reader target_reader_portable = {
    .target = TARGET_PORTABLE,
    .driver_uuid = portable_driver_uuid,
    .has_handle_per_row = true,
    .open = open_structure,
    .bounds = get_bounds,
    .triangle = get_triangle,
    .round = get_round,
    .instance = get_instance,
    .content_name = content_name,
    .survey = take_survey,
};

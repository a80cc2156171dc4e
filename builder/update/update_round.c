/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_round.c - updates of spheres and of linear swept spheres. Vulkan has rules for what updates may change in
 * triangles alone; those here are the same about what these kinds have instead.
 */
#include "builder/format/swept_shape.h"
#include "builder/input/canonical_form.h"
#include "builder/update/update_kind.h"

enum { FLOATS = 4 }; /* of a vertex */

static void describe(const struct form_geometry *form, struct record_geometry *row)
{
    row->radius_format = form->radius_format;
    row->swept_modes = form->swept_modes;
}

static bool spheres_are_sound(const struct record_geometry *row)
{
    return row->indexed <= 1 && row->swept_modes == 0 && (row->indexed || row->index_sum == 0);
}

static bool swept_are_sound(const struct record_geometry *row)
{
    return row->indexed == (row->primitive_count > 0) &&
           row->swept_modes <= (FORM_SWEPT_SUCCESSIVE | FORM_SWEPT_CHAINED) && (row->indexed || row->index_sum == 0);
}

#define RULES(member)                                                                                                  \
    {                                                                                                                  \
        {BVHD_VUID_NONE, offsetof(struct record_geometry, vertex_format), member ".vertexFormat"},                     \
            {BVHD_VUID_NONE, offsetof(struct record_geometry, radius_format), member ".radiusFormat"},                 \
            {BVHD_VUID_NONE, offsetof(struct record_geometry, index_type), member ".indexType"},                       \
    }

static const struct update_rule sphere_rules[] = RULES("spheres"), swept_rules[] = RULES("linearSweptSpheres");

/* Compares the vertices that primitives name, and which of their ends have caps, which indices say, too. */
static enum bvhd_status check_indices(const struct update_comparison *comparison, uint32_t g, const char *field)
{
    const struct record_geometry *before = &comparison->source->geometries[g], *now = &comparison->now->geometries[g];
    if (before->lowest_index == now->lowest_index && before->index_sum == now->index_sum &&
        before->vertex_count == now->vertex_count && before->indexed == now->indexed)
        return BVHD_OK;
    return bvhd_error_set(comparison->error, BVHD_INVALID, update_place(comparison, g, field).text,
                          "the indices are not those of the source of the update");
}

static enum bvhd_status check_spheres(const struct update_comparison *comparison, uint32_t g)
{
    return check_indices(comparison, g, "spheres.indexData");
}

static enum bvhd_status check_swept(const struct update_comparison *comparison, uint32_t g)
{
    static const struct {
        uint32_t bit;
        const char *field;
    } modes[] = {{FORM_SWEPT_SUCCESSIVE, "linearSweptSpheres.indexingMode"},
                 {FORM_SWEPT_CHAINED, "linearSweptSpheres.endCapsMode"}};
    const uint32_t before = comparison->source->geometries[g].swept_modes,
                   now = comparison->now->geometries[g].swept_modes;
    for (int i = 0; i < 2; i++)
        if ((before ^ now) & modes[i].bit)
            return bvhd_error_set(comparison->error, BVHD_INVALID, update_place(comparison, g, modes[i].field).text,
                                  "it is %d, but %d in the source of the update", (now & modes[i].bit) != 0,
                                  (before & modes[i].bit) != 0);
    return check_indices(comparison, g, "linearSweptSpheres.indexData");
}

static uint64_t active_spheres(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        const size_t vertex = geometry->indices ? geometry->indices[first + i] : first + i;
        found |= (uint64_t)!update_any_nan(geometry->positions + FLOATS * vertex, FLOATS) << i;
    }
    return found;
}

static uint64_t active_swept(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        const size_t end = geometry->indices[first + i] & CANONICAL_END_MASK;
        found |= (uint64_t)!update_any_nan(geometry->positions + FLOATS * end, 2 * FLOATS) << i;
    }
    return found;
}

static bool has_nan(const struct canonical_geometry *geometry, size_t first, size_t count)
{
    return update_any_nan(geometry->positions + FLOATS * first, FLOATS * count);
}

/* Copies the records of a node, which name `ends` vertices each: their vertices have the same rows. */
static bool copy(const struct refit_records *records, uint32_t first, unsigned count, uint32_t ends)
{
    const struct portable_header *header = records->source->header;
    const struct portable_round *source = (const struct portable_round *)records->source->records + first;
    bool sound = header->vertex_count >= ends;
    for (unsigned i = 0; sound && i < count; i++)
        sound = source[i].vertex <= header->vertex_count - ends &&
                (source[i].id & PORTABLE_ID_MASK) < header->primitive_count;
    memcpy(records->written.records + (uint64_t)first * sizeof *source, source, count * sizeof *source);
    return sound;
}

static bool write_spheres(const struct refit_records *records, uint32_t first, unsigned count)
{
    return copy(records, first, count, 1);
}

static bool write_swept(const struct refit_records *records, uint32_t first, unsigned count)
{
    return copy(records, first, count, 2);
}

static inline const struct portable_round *written_at(const struct refit_records *records, uint32_t record)
{
    const void *written = records->written.records;
    return (const struct portable_round *)written + record;
}

static inline struct vec4_box box_of_sphere(const struct refit_records *records, uint32_t record)
{
    const uint64_t vertex = written_at(records, record)->vertex;
    const struct box box = swept_shape_sphere(records->vertices + FLOATS * vertex);
    return vec4_box_from(&box);
}

static inline struct vec4_box box_of_swept(const struct refit_records *records, uint32_t record)
{
    const struct portable_round *round = written_at(records, record);
    const float *first = records->vertices + FLOATS * (uint64_t)round->vertex;
    const struct box box = swept_shape_box(first, first + FLOATS, portable_round_caps(round->id));
    return vec4_box_from(&box);
}

static void sphere_boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                         struct refit_node ret_leaves[8])
{
    update_boxes(records, first, counts, ret_leaves, box_of_sphere);
}

static void swept_boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                        struct refit_node ret_leaves[8])
{
    update_boxes(records, first, counts, ret_leaves, box_of_swept);
}

const struct update_kind update_spheres = {
    .version = 2,
    .describe = describe,
    .row_is_sound = spheres_are_sound,
    .rules = sphere_rules,
    .rule_count = sizeof sphere_rules / sizeof *sphere_rules,
    .check = check_spheres,
    .active = active_spheres,
    .has_nan = has_nan,
    .write = write_spheres,
    .boxes = sphere_boxes,
};

const struct update_kind update_swept_spheres = {
    .version = 2,
    .describe = describe,
    .row_is_sound = swept_are_sound,
    .rules = swept_rules,
    .rule_count = sizeof swept_rules / sizeof *swept_rules,
    .check = check_swept,
    .active = active_swept,
    .has_nan = has_nan,
    .write = write_swept,
    .boxes = swept_boxes,
};

/* SPDX-License-Identifier: Apache-2.0 */
/* update_triangles.c - updates of triangles. */
#include "builder/update/update_triangles.h"

#include "builder/input/canonical_form.h"

void update_triangles_describe(const struct form_geometry *form, struct record_geometry *row)
{
    row->has_transform = (form->update & FORM_UPDATE_TRANSFORM) != 0;
    row->max_vertex = form->max_vertex;
}

bool update_triangles_row_is_sound(const struct record_geometry *row)
{
    return row->indexed <= 1 && row->has_transform <= 1 && (row->indexed || row->index_sum == 0);
}

const struct update_rule update_triangles_rules[UPDATE_TRIANGLES_RULES] = {
    {BVHD_VUID_03763, offsetof(struct record_geometry, vertex_format), "triangles.vertexFormat"},
    {BVHD_VUID_03764, offsetof(struct record_geometry, max_vertex), "triangles.maxVertex"},
    {BVHD_VUID_03765, offsetof(struct record_geometry, index_type), "triangles.indexType"},
};

static enum bvhd_status check_transform(const struct update_comparison *comparison, uint32_t g, uint32_t before,
                                        uint32_t now)
{
    const struct place where = update_place(comparison, g, "triangles.transformData");
    if (before == now)
        return BVHD_OK;
    return now ? bvhd_error_rule(comparison->error, BVHD_VUID_03766, where.text,
                                 "a transform, but the source of the update has none")
               : bvhd_error_rule(comparison->error, BVHD_VUID_03767, where.text,
                                 "no transform, but the source of the update has one");
}

/* Returns whether all corners are vertex 0, as they are with a vertex stride of 0, whatever the indices are. */
static bool is_one_vertex(const struct record_geometry *row)
{
    return row->indexed && row->vertex_count == 1 && row->lowest_index == 0;
}

static enum bvhd_status check_indices(const struct update_comparison *comparison, uint32_t g,
                                      const struct record_geometry *before, const struct record_geometry *now)
{
    if (is_one_vertex(before) != is_one_vertex(now))
        return bvhd_error_set(comparison->error, BVHD_UNSUPPORTED,
                              update_place(comparison, g, "triangles.vertexStride").text,
                              "updates do not change a stride to or from 0");
    if (before->lowest_index == now->lowest_index && before->index_sum == now->index_sum &&
        before->vertex_count == now->vertex_count && before->indexed == now->indexed)
        return BVHD_OK;
    return bvhd_error_rule(comparison->error, BVHD_VUID_03768, update_place(comparison, g, "triangles.indexData").text,
                           "the indices are not those of the source of the update");
}

enum bvhd_status update_triangles_check(const struct update_comparison *comparison, uint32_t g)
{
    const struct record_geometry *before = &comparison->source->geometries[g], *now = &comparison->now->geometries[g];
    enum bvhd_status status = check_transform(comparison, g, before->has_transform, now->has_transform);
    return status == BVHD_OK ? check_indices(comparison, g, before, now) : status;
}

static uint64_t active(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        float corners[3][3];
        canonical_triangle(geometry, first + i, corners);
        found |= (uint64_t)!update_any_nan(corners[0], 9) << i;
    }
    return found;
}

static bool has_nan(const struct canonical_geometry *geometry, size_t first, size_t count)
{
    return update_any_nan(geometry->positions + 3 * first, 3 * count);
}

static bool is_indexed(const struct refit_records *records)
{
    return records->written.kind == &record_indexed_triangles;
}

bool update_triangles_copy(const struct refit_records *records, uint32_t first, unsigned count)
{
    const struct portable_header *header = records->source->header;
    const struct portable_indexed_triangle *source =
        (const struct portable_indexed_triangle *)records->source->records + first;
    const uint32_t vertices = header->vertex_count, primitives = header->primitive_count;
    bool sound = true;
    for (unsigned i = 0; i < count; i++) {
        const uint32_t *rows = source[i].vertices;
        sound &= rows[0] < vertices && rows[1] < vertices && rows[2] < vertices &&
                 (source[i].id & PORTABLE_ID_MASK) < primitives;
    }
    memcpy(records->written.records + (uint64_t)first * sizeof *source, source, count * sizeof *source);
    return sound;
}

static bool write(const struct refit_records *records, uint32_t first, unsigned count)
{
    const struct portable_triangle *source = (const struct portable_triangle *)records->source->records + first;
    uint32_t ids[REFIT_RECORDS_MAX];
    if (is_indexed(records))
        return update_triangles_copy(records, first, count);
    for (unsigned i = 0; i < count; i++)
        ids[i] = source[i].id & PORTABLE_ID_MASK;
    return update_write(records, first, ids, count);
}

static inline struct vec4_box box_of_indexed(const struct refit_records *records, uint32_t record)
{
    const void *written = records->written.records;
    const uint32_t *rows = ((const struct portable_indexed_triangle *)written)[record].vertices;
    const float *at = records->vertices;
    return update_triangles_box(at + 3 * (uint64_t)rows[0], at + 3 * (uint64_t)rows[1], at + 3 * (uint64_t)rows[2]);
}

static inline struct vec4_box box_of_stored(const struct refit_records *records, uint32_t record)
{
    const void *written = records->written.records;
    const struct portable_triangle *triangle = (const struct portable_triangle *)written + record;
    return update_triangles_box(triangle->v0, triangle->v1, triangle->v2);
}

static void boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                  struct refit_node ret_leaves[8])
{
    if (is_indexed(records))
        update_boxes(records, first, counts, ret_leaves, box_of_indexed);
    else
        update_boxes(records, first, counts, ret_leaves, box_of_stored);
}

const struct update_kind update_triangles = {
    .version = 1,
    .describe = update_triangles_describe,
    .row_is_sound = update_triangles_row_is_sound,
    .rules = update_triangles_rules,
    .rule_count = UPDATE_TRIANGLES_RULES,
    .check = update_triangles_check,
    .active = active,
    .has_nan = has_nan,
    .write = write,
    .boxes = boxes,
};

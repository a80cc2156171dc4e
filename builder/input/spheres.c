/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/round.h"

#include "builder/format/swept_shape.h"
#include "builder/input/vertex_format.h"
#include "proto/base/place.h"

static const struct round_rules rules = {
    .indices_given = BVHD_VUID_11822,
    .indices = BVHD_VUID_11823,
    .vertices = BVHD_VUID_11824,
    .radii = BVHD_VUID_11825,
    .negative = BVHD_VUID_10436,
};

static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    return round_check_memory(subject, &rules, 1);
}

static void describe(const struct geometry *geometry, bool is_update, struct form_geometry *row)
{
    row->indexed =
        row->primitive_count > 0 && (geometry->spheres.index_type != INDEX_NONE || round_is_one_vertex(geometry));
    round_describe(geometry, is_update, row);
}

static bool update_is_sound(const struct form_geometry *row)
{
    return row->update == FORM_UPDATE_RECORDED && row->max_vertex == 0 && row->swept_modes == 0 &&
           (row->indexed || row->lowest_index == 0) && vertex_format_find(row->vertex_format) &&
           radius_format_find(row->radius_format);
}

static uint32_t *indices_of(const struct fetch *fetch, uint32_t index)
{
    return (uint32_t *)(void *)(fetch->block + fetch_row(fetch, index)->index_offset);
}

static void fetch_indices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_span span = {UINT32_MAX, 0};
    if (!fetch_row(fetch, index)->indexed)
        return;
    uint32_t *target = indices_of(fetch, index) + first;
    if (geometry->spheres.index_type == INDEX_NONE) { /* indexed without indices: strides of 0 */
        memset(target, 0, count * sizeof *target);
        return;
    }
    round_read_indices(geometry, first, count, target);
    fetch_span_grow(target, count, &span);
    fetch_span_note(&span, &fetch->sources[index]);
}

/* Indices have to change where the lowest is not 0, or all vertices are one. */
static enum bvhd_status finish(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    struct form_geometry *row = fetch_row(fetch, index);
    enum bvhd_status status = BVHD_OK;
    if (row->primitive_count > 0 && geometry->spheres.index_type != INDEX_NONE)
        status = round_check_named(fetch, index, &rules, indices_of(fetch, index), row->primitive_count, 1, error);
    if (status != BVHD_OK)
        return status;
    if (!row->indexed) {
        source->lowest = 0;
        return round_count_vertices(fetch, index, row->primitive_count, UINT32_MAX, error);
    }
    if (round_is_one_vertex(geometry))
        source->lowest = source->highest = 0;
    if (row->update & FORM_UPDATE_RECORDED)
        row->lowest_index = source->lowest;
    fetch->must_rebase |= source->lowest > 0 || round_is_one_vertex(geometry);
    return round_count_vertices(fetch, index, (uint64_t)source->highest - source->lowest + 1, UINT32_MAX, error);
}

static void rebase(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    if (!fetch_row(fetch, index)->indexed)
        return;
    uint32_t *indices = indices_of(fetch, index) + first;
    const uint32_t lowest = fetch->sources[index].lowest;
    if (round_is_one_vertex(&fetch->input->geometries[index]))
        memset(indices, 0, count * sizeof *indices);
    else
        for (uint32_t i = 0; lowest > 0 && i < count; i++)
            indices[i] -= lowest;
}

static void fetch_vertices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    float *target = (float *)(void *)(fetch->block + fetch_row(fetch, index)->data_offset) + (size_t)4 * first;
    round_read_vertices(fetch, index, (uint64_t)fetch->sources[index].lowest + first, count, target);
}

static const float *sphere_of(const struct canonical_geometry *geometry, uint32_t index)
{
    return geometry->positions + (uint64_t)4 * (geometry->indices ? geometry->indices[index] : index);
}

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const float radius = sphere_of(geometry, i)[3];
        if (radius < 0)
            return bvhd_error_rule(error, rules.negative,
                                   place("infos[%u].geometries[%u].spheres[%u].radius", info, index, i).text,
                                   "%g is negative", (double)radius);
    }
    return BVHD_OK;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint32_t highest = 0, lowest = UINT32_MAX;
    for (uint32_t i = 0; geometry->indices && i < geometry->primitive_count; i++) {
        highest = geometry->indices[i] > highest ? geometry->indices[i] : highest;
        lowest = geometry->indices[i] < lowest ? geometry->indices[i] : lowest;
    }
    if (geometry->indices && highest != geometry->vertex_count - 1)
        return form_corrupt_row(error, index, "vertexCount", "not the highest index plus one");
    if (geometry->indices && lowest != 0)
        return form_corrupt_row(error, index, "indices", "they do not start at 0");
    return BVHD_OK;
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    const float *sphere = sphere_of(geometry, index);
    struct classification finding = {.box = box_empty()};
    if (classification_has_nan(sphere, 4))
        return finding;
    const bool is_infinite = classification_has_infinity(sphere, 4);
    finding.active = true;
    finding.degenerate = !is_infinite && sphere[3] == 0;
    finding.kept = (canonical->flags & BUILD_ALLOW_UPDATE) || !(is_infinite || finding.degenerate);
    finding.box = swept_shape_sphere(sphere);
    return finding;
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return classification_collect(look, canonical, geometry, first, end, counts, refs);
}

const struct input_kind input_spheres = {
    .version = CANONICAL_VERSION_ROUND,
    .has_radii = true,
    .corners = 1,
    .check_memory = check_memory,
    .describe = describe,
    .update_is_sound = update_is_sound,
    .view = round_view,
    .fetch_primitives = fetch_indices,
    .finish = finish,
    .rebase = rebase,
    .fetch_vertices = fetch_vertices,
    .check_contents = check_contents,
    .check_foreign = check_foreign,
    .look = look,
    .collect = collect,
    .outline = round_outline,
};

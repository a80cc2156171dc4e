/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/triangles.h"

#include "builder/input/reach.h"
#include "builder/input/transform.h"
#include "builder/input/triangle_micromap.h"
#include "builder/input/triangles_refs.h"
#include "builder/input/validate.h"
#include "builder/input/vertex_format.h"
#include "proto/base/place.h"

/* Numbers of items that stay in the first-level cache between two passes over them. */
enum { INDEX_BLOCK = 4096, VERTEX_BLOCK = 2048 };

static enum bvhd_status check_range(const struct validate_subject *subject, const struct vertex_format *format)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    const struct geometry_range *range = &subject->geometry->range;
    bool indexed = triangles->index_type != INDEX_NONE;
    uint32_t alignment = !indexed ? format->alignment : triangles->index_type == INDEX_UINT16 ? 2 : 4;
    if (range->primitive_offset % alignment != 0)
        return bvhd_error_rule(subject->error, indexed ? BVHD_VUID_03656 : BVHD_VUID_03657,
                               VALIDATE_RANGE_PLACE(subject, "primitiveOffset"), "%u is no multiple of %u",
                               range->primitive_offset, alignment);
    if (triangles->transform.data && range->transform_offset % 16 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03658, VALIDATE_RANGE_PLACE(subject, "transformOffset"),
                               "%u is no multiple of 16", range->transform_offset);
    uint64_t vertices = (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count;
    if (!indexed && range->primitive_count > 0 && vertices - 1 > triangles->max_vertex)
        return bvhd_error_rule(subject->error, BVHD_VUID_10775, VALIDATE_RANGE_PLACE(subject, "primitiveCount"),
                               "%u triangles from vertex %u on reach past maxVertex %u", range->primitive_count,
                               range->first_vertex, triangles->max_vertex);
    return BVHD_OK;
}

/*
 * Checks that the memory of a geometry is there. Vertices that are named by indices are checked once the indices are
 * known.
 */
static enum bvhd_status check_arrays(const struct validate_subject *subject, const struct vertex_format *format)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    const struct geometry_range *range = &subject->geometry->range;
    bool indexed = triangles->index_type != INDEX_NONE;
    uint64_t last = (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count - 1;
    uint64_t index_size = triangles->index_type == INDEX_UINT16 ? 2 : 4;
    if (!triangles->vertices.data || (!indexed && !bytes_reach(triangles->vertices.size, range->primitive_offset,
                                                               triangles->vertex_stride, last, format->size)))
        return validate_refuse_memory(subject, BVHD_VUID_03771, "triangles.vertexData", &triangles->vertices,
                                      "vertices");
    if (indexed &&
        (!triangles->indices.data || !bytes_reach(triangles->indices.size, range->primitive_offset, 3 * index_size,
                                                  range->primitive_count - 1, 3 * index_size)))
        return validate_refuse_memory(subject, BVHD_VUID_03772, "triangles.indexData", &triangles->indices, "indices");
    if (triangles->transform.data &&
        !bytes_reach(triangles->transform.size, range->transform_offset, 0, 0, 12 * sizeof(float)))
        return validate_refuse_memory(subject, BVHD_VUID_03773, "triangles.transformData", &triangles->transform,
                                      "matrix");
    return BVHD_OK;
}

enum bvhd_status triangles_check_memory(const struct validate_subject *subject)
{
    const struct vertex_format *format = vertex_format_find(subject->geometry->triangles.vertex_format);
    enum bvhd_status status = check_range(subject, format);
    if (status == BVHD_OK && subject->geometry->range.primitive_count > 0)
        status = check_arrays(subject, format);
    return status == BVHD_OK ? triangle_micromap_check_memory(subject) : status;
}

void triangles_describe(const struct geometry *geometry, bool is_update, struct form_geometry *row)
{
    const struct geometry_triangles *triangles = &geometry->triangles;
    row->indexed = row->primitive_count > 0 && (triangles->index_type != INDEX_NONE || triangles->vertex_stride == 0);
    if (!is_update)
        return;
    row->update = FORM_UPDATE_RECORDED | (triangles->transform.data ? FORM_UPDATE_TRANSFORM : 0);
    row->vertex_format = triangles->vertex_format;
    row->max_vertex = triangles->max_vertex;
    row->index_type = triangles->index_type;
}

bool triangles_update_is_sound(const struct form_geometry *row)
{
    return (row->update & ~(uint32_t)FORM_UPDATE_TRANSFORM) == FORM_UPDATE_RECORDED &&
           (row->indexed || row->lowest_index == 0) && vertex_format_find(row->vertex_format);
}

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->positions = data;
}

static void to_u32(const unsigned char *source, size_t count, uint32_t *ret_indices)
{
    for (size_t i = 0; i < count; i++)
        ret_indices[i] = bytes_get16(source + 2 * i);
}

static void copy_indices(const unsigned char *source, uint32_t type, size_t count, uint32_t *ret_indices,
                         struct fetch_span *span)
{
    if (type == INDEX_UINT16)
        to_u32(source, count, ret_indices);
    else
        memcpy(ret_indices, source, count * sizeof *ret_indices);
    fetch_settle();
    fetch_span_grow(ret_indices, count, span);
}

void triangles_fetch_indices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    const struct form_geometry *row = fetch_row(fetch, index);
    if (!row->indexed)
        return;
    uint32_t *target = (uint32_t *)(void *)(fetch->block + row->index_offset) + (size_t)3 * first;
    size_t total = (size_t)3 * count;
    if (triangles->index_type == INDEX_NONE) { /* indexed without indices: a stride of 0 */
        memset(target, 0, total * sizeof *target);
        return;
    }
    size_t size = triangles->index_type == INDEX_UINT16 ? 2 : 4;
    const unsigned char *source = triangles->indices.data + geometry->range.primitive_offset + (size_t)3 * first * size;
    struct fetch_span span = {UINT32_MAX, 0};
    for (size_t at = 0; at < total; at += INDEX_BLOCK) {
        size_t some = total - at < INDEX_BLOCK ? total - at : INDEX_BLOCK;
        copy_indices(source + at * size, triangles->index_type, some, target + at, &span);
    }
    fetch_span_note(&span, &fetch->sources[index]);
}

static enum bvhd_status report_index(const struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const uint32_t *indices = (const void *)(fetch->block + fetch_row(fetch, index)->index_offset);
    uint64_t k = 0;
    while ((uint64_t)geometry->range.first_vertex + indices[k] <= geometry->triangles.max_vertex)
        k++;
    return bvhd_error_rule(
        error, BVHD_VUID_10774,
        place("infos[%u].geometries[%u].triangles.indices[%llu]", fetch->index, index, (unsigned long long)k).text,
        "firstVertex %u + index %u is over maxVertex %u", geometry->range.first_vertex, indices[k],
        geometry->triangles.max_vertex);
}

/*
 * Checks the geometry's indices after all have been read: against maxVertex, and whether the vertices that they name
 * are there.
 */
static enum bvhd_status check_indices(const struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    if (triangles->index_type == INDEX_NONE)
        /* validate_input has checked these vertices. */
        return BVHD_OK;
    uint64_t last = (uint64_t)geometry->range.first_vertex + fetch->sources[index].highest;
    if (last > triangles->max_vertex)
        return report_index(fetch, index, error);
    if (!bytes_reach(triangles->vertices.size, 0, triangles->vertex_stride, last,
                     vertex_format_find(triangles->vertex_format)->size))
        return bvhd_error_rule(error, BVHD_VUID_03771,
                               place("infos[%u].geometries[%u].triangles.vertexData", fetch->index, index).text,
                               "%llu bytes do not hold vertex %llu", (unsigned long long)triangles->vertices.size,
                               (unsigned long long)last);
    return BVHD_OK;
}

static enum bvhd_status read_transform(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    if (!geometry->triangles.transform.data)
        return BVHD_OK;
    memcpy(source->matrix, geometry->triangles.transform.data + geometry->range.transform_offset,
           sizeof source->matrix);
    fetch_settle();
    source->transformed = !transform_is_identity(source->matrix);
    if (validate_invertible(source->matrix))
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_03799,
                           place("infos[%u].geometries[%u].triangles.transformData", fetch->index, index).text,
                           "the 3x3 part is not invertible");
}

/*
 * Counts the vertices in use. Records the lowest index in the row of an updatable geometry. Indices have to change
 * where the lowest is not 0, or the stride is 0.
 */
static enum bvhd_status count_vertices(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    struct canonical_geometry *geometry = &fetch->view.geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    struct form_geometry *row = fetch_row(fetch, index);
    bool is_one_vertex = fetch->input->geometries[index].triangles.vertex_stride == 0;
    if (!row->indexed) {
        source->lowest = 0;
        geometry->vertex_count = 3 * row->primitive_count;
        return BVHD_OK;
    }
    if (is_one_vertex)
        source->lowest = source->highest = 0;
    if (source->highest - source->lowest == UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u].geometries[%u]", fetch->index, index).text,
                              "2^32 vertices");
    geometry->vertex_count = source->highest - source->lowest + 1;
    if (row->update & FORM_UPDATE_RECORDED)
        row->lowest_index = source->lowest;
    fetch->must_rebase |= source->lowest > 0 || is_one_vertex;
    return BVHD_OK;
}

enum bvhd_status triangles_finish(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    if (fetch_row(fetch, index)->primitive_count == 0)
        return BVHD_OK;
    enum bvhd_status status = check_indices(fetch, index, error);
    if (status == BVHD_OK)
        status = read_transform(fetch, index, error);
    return status == BVHD_OK ? count_vertices(fetch, index, error) : status;
}

/*
 * Makes indices count from the lowest one in use, because only the span of vertices that a geometry uses is kept: many
 * geometries may share one large array. With a stride of 0 all indices name one vertex.
 */
void triangles_rebase(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct form_geometry *row = fetch_row(fetch, index);
    if (!row->indexed)
        return;
    uint32_t *indices = (uint32_t *)(void *)(fetch->block + row->index_offset) + (size_t)3 * first;
    uint32_t lowest = fetch->sources[index].lowest;
    if (fetch->input->geometries[index].triangles.vertex_stride == 0)
        memset(indices, 0, (size_t)3 * count * sizeof *indices);
    else
        for (size_t i = 0; lowest > 0 && i < (size_t)3 * count; i++)
            indices[i] -= lowest;
}

void triangles_read_vertices(const struct fetch *fetch, uint32_t index, const struct bytes *array, uint32_t first,
                             uint32_t count, float *ret_positions)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    const struct vertex_format *format = vertex_format_find(triangles->vertex_format);
    const struct fetch_source *source = &fetch->sources[index];
    uint64_t stride = triangles->vertex_stride,
             offset = triangles->index_type == INDEX_NONE ? geometry->range.primitive_offset : 0;
    uint64_t vertex = (uint64_t)geometry->range.first_vertex + source->lowest + first;
    const unsigned char *vertices = array->data + offset + stride * vertex;
    for (uint32_t at = 0; at < count; at += VERTEX_BLOCK) {
        uint32_t some = count - at < VERTEX_BLOCK ? count - at : VERTEX_BLOCK;
        float *target = ret_positions + (size_t)3 * at;
        format->decode(vertices + at * stride, stride, some, target);
        if (source->transformed)
            transform_points(source->matrix, target, some);
    }
}

static void fetch_vertices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    float *positions = (float *)(void *)(fetch->block + fetch_row(fetch, index)->data_offset) + (size_t)3 * first;
    triangles_read_vertices(fetch, index, &fetch->input->geometries[index].triangles.vertices, first, count, positions);
}

enum bvhd_status triangles_check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint32_t highest = 0, lowest = UINT32_MAX;
    for (uint64_t i = 0; geometry->indices && i < (uint64_t)3 * geometry->primitive_count; i++) {
        highest = geometry->indices[i] > highest ? geometry->indices[i] : highest;
        lowest = geometry->indices[i] < lowest ? geometry->indices[i] : lowest;
    }
    if (geometry->indices && highest != geometry->vertex_count - 1)
        return form_corrupt_row(error, index, "vertexCount", "not the highest index plus one");
    if (geometry->indices && lowest != 0)
        return form_corrupt_row(error, index, "indices", "they do not start at 0");
    return triangle_micromap_check_foreign(canonical, index, error);
}

static void outline(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach)
{
    reach_add_vertices(reach, geometry->positions + (size_t)3 * first, count);
}

const struct input_kind input_triangles = {
    .version = CANONICAL_VERSION,
    .corners = 3,
    .check_memory = triangles_check_memory,
    .describe = triangles_describe,
    .update_is_sound = triangles_update_is_sound,
    .view = view,
    .fetch_primitives = triangles_fetch_indices,
    .finish = triangles_finish,
    .rebase = triangles_rebase,
    .fetch_vertices = fetch_vertices,
    .check_foreign = triangles_check_foreign,
    .look = triangles_refs_look,
    .grow_keys = triangles_refs_grow_keys,
    .prefetch_keys = triangles_refs_prefetch_keys,
    .collect = triangles_refs_collect,
    .outline = outline,
};

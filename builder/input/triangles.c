/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include "builder/input/canonical_form.h"

static void describe(const struct geometry *geometry, bool is_update, struct form_geometry *row)
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

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->positions = data;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
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
    return BVHD_OK;
}

const struct input_kind input_triangles = {
    .corners = 3,
    .vertex_size = 3 * sizeof(float),
    .primitive_size = 3 * sizeof(uint32_t),
    .describe = describe,
    .view = view,
    .check_foreign = check_foreign,
};

/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind_internal.h"
#include "proto/base/validate_shape.h"

static const struct kind_rules rules = {
    .vertex_format = BVHD_VUID_03797,
    .vertex_format_parameter = BVHD_VUID_TrianglesData_vertexFormat_parameter,
    .vertex_stride = BVHD_VUID_03735,
    .large_stride = BVHD_VUID_03819,
    .index_type = BVHD_VUID_03798,
    .index_type_parameter = BVHD_VUID_TrianglesData_indexType_parameter,
};

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    enum bvhd_status status = kind_check_vertices(subject, triangles->vertex_format, triangles->vertex_stride, &rules);
    if (status == BVHD_OK)
        status = kind_check_index_type(subject, triangles->index_type, &rules);
    return status == BVHD_OK ? kind_check_triangle_micromap(subject) : status;
}

static uint64_t vertices(const struct geometry *geometry)
{
    const struct geometry_triangles *triangles = &geometry->triangles;
    if (geometry->range.primitive_count == 0)
        return 0;
    if (triangles->vertex_stride == 0)
        return 1;
    if (triangles->index_type == INDEX_NONE)
        return 3 * (uint64_t)geometry->range.primitive_count;
    uint64_t given = triangles->vertices.size / triangles->vertex_stride, named = (uint64_t)triangles->max_vertex + 1;
    return named <= given ? named : given + 1;
}

const struct kind kind_triangles = {
    .type = GEOMETRY_TRIANGLES,
    .vulkan_type = GEOMETRY_TRIANGLES,
    .number = KIND_TRIANGLES,
    .noun = "triangles",
    .member = "triangles",
    .too_many = BVHD_VUID_03795,
    .can_be_cut = true,
    .primitive_bytes = 3 * sizeof(uint32_t),
    .vertex_bytes = 3 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};

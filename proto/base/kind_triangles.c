/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vertex_element.h"
#include "proto/base/vulkan_name.h"

/* Values of VkFormat that decide which rule a wrong one breaks, and an index type that triangles may not have. */
enum { FORMAT_LAST_OF_CORE = 184, FORMAT_FIRST_OF_EXTENSIONS = 1000000000, INDEX_UINT8 = 1000265000 };

/* Numbers of extensions may be formats that are newer than this program, those below them are known. */
static enum bvhd_status refuse_format(const struct validate_subject *subject)
{
    uint32_t format = subject->geometry->triangles.vertex_format;
    bool is_format = format <= FORMAT_LAST_OF_CORE || format >= FORMAT_FIRST_OF_EXTENSIONS;
    return bvhd_error_rule(subject->error, is_format ? BVHD_VUID_03797 : BVHD_VUID_TrianglesData_vertexFormat_parameter,
                           VALIDATE_GEOMETRY_PLACE(subject, "triangles.vertexFormat"),
                           "vertexFormat is %s, which is no %s", vulkan_name(VULKAN_FORMAT, format).text,
                           is_format ? "format of vertices" : "VkFormat");
}

static enum bvhd_status check_stride(const struct validate_subject *subject, const struct vertex_element *format)
{
    uint64_t stride = subject->geometry->triangles.vertex_stride;
    if (stride % format->alignment != 0)
        return bvhd_error_rule(
            subject->error, BVHD_VUID_03735, VALIDATE_GEOMETRY_PLACE(subject, "triangles.vertexStride"),
            "%" PRIu64 " is no multiple of %u, as %s needs", stride, format->alignment, format->name);
    if (stride > UINT32_MAX)
        return bvhd_error_rule(subject->error, BVHD_VUID_03819,
                               VALIDATE_GEOMETRY_PLACE(subject, "triangles.vertexStride"),
                               "%" PRIu64 " is over 2^32 - 1", stride);
    return BVHD_OK;
}

static enum bvhd_status check_index_type(const struct validate_subject *subject)
{
    uint32_t type = subject->geometry->triangles.index_type;
    if (type == INDEX_NONE || type == INDEX_UINT16 || type == INDEX_UINT32)
        return BVHD_OK;
    return bvhd_error_rule(
        subject->error, type == INDEX_UINT8 ? BVHD_VUID_03798 : BVHD_VUID_TrianglesData_indexType_parameter,
        VALIDATE_GEOMETRY_PLACE(subject, "triangles.indexType"), "indexType is %s, none of UINT16, UINT32 and NONE",
        vulkan_name(VULKAN_INDEX_TYPE, type).text);
}

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    const struct vertex_element *format = vertex_element_find(subject->geometry->triangles.vertex_format);
    if (!format)
        return refuse_format(subject);
    enum bvhd_status status = subject->ignores_strides ? BVHD_OK : check_stride(subject, format);
    return status == BVHD_OK ? check_index_type(subject) : status;
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
    .number = KIND_TRIANGLES,
    .noun = "triangles",
    .member = "triangles",
    .too_many = BVHD_VUID_03795,
    .primitive_bytes = 3 * sizeof(uint32_t),
    .vertex_bytes = 3 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};

/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind_internal.h"
#include "proto/base/validate_shape.h"

static const struct kind_rules rules = {
    .vertex_format = BVHD_VUID_10434,
    .vertex_format_parameter = BVHD_VUID_SpheresData_vertexFormat_parameter,
    .vertex_stride = BVHD_VUID_10431,
    .large_stride = BVHD_VUID_10432,
    .radius_format = BVHD_VUID_10435,
    .radius_format_parameter = BVHD_VUID_SpheresData_radiusFormat_parameter,
    .index_type = BVHD_VUID_10437,
    .index_type_parameter = BVHD_VUID_SpheresData_indexType_parameter,
};

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    return kind_check_spheres(subject, &subject->geometry->spheres, &rules);
}

static uint64_t vertices(const struct geometry *geometry)
{
    const uint32_t count = geometry->range.primitive_count;
    if (count > 0 && kind_is_one_sphere(&geometry->spheres))
        return 1;
    if (count == 0 || geometry->spheres.index_type == INDEX_NONE)
        return count;
    return kind_named_spheres(&geometry->spheres);
}

const struct kind kind_spheres = {
    .type = GEOMETRY_SPHERES,
    .vulkan_type = GEOMETRY_SPHERES,
    .number = KIND_SPHERES,
    .noun = "spheres",
    .member = "spheres",
    .too_many = BVHD_VUID_NONE, /* maxPrimitiveCount limits triangles and AABBs */
    .primitive_bytes = sizeof(uint32_t),
    .vertex_bytes = 4 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};

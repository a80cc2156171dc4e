/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

static const struct kind_rules rules = {
    .vertex_format = BVHD_VUID_10423,
    .vertex_format_parameter = BVHD_VUID_LinearSweptSpheresData_vertexFormat_parameter,
    .vertex_stride = BVHD_VUID_10421,
    .large_stride = BVHD_VUID_10422,
    .radius_format = BVHD_VUID_10424,
    .radius_format_parameter = BVHD_VUID_LinearSweptSpheresData_radiusFormat_parameter,
    .index_type = BVHD_VUID_10428,
    .index_type_parameter = BVHD_VUID_LinearSweptSpheresData_indexType_parameter,
};

static enum bvhd_status check_modes(const struct validate_subject *subject, const struct geometry_swept_spheres *swept)
{
    if (swept->indexing_mode != SWEPT_LIST && swept->indexing_mode != SWEPT_SUCCESSIVE)
        return bvhd_error_rule(subject->error, BVHD_VUID_LinearSweptSpheresData_indexingMode_parameter,
                               VALIDATE_GEOMETRY_PLACE(subject, "linearSweptSpheres.indexingMode"),
                               "indexingMode is %u, which is no VkRayTracingLssIndexingModeNV", swept->indexing_mode);
    if (swept->end_caps_mode != SWEPT_CAPS_NONE && swept->end_caps_mode != SWEPT_CAPS_CHAINED)
        return bvhd_error_rule(subject->error, BVHD_VUID_LinearSweptSpheresData_endCapsMode_parameter,
                               VALIDATE_GEOMETRY_PLACE(subject, "linearSweptSpheres.endCapsMode"),
                               "endCapsMode is %u, which is no VkRayTracingLssPrimitiveEndCapsModeNV",
                               swept->end_caps_mode);
    if (swept->indexing_mode == SWEPT_SUCCESSIVE && swept->ends.index_type == INDEX_NONE)
        return bvhd_error_rule(subject->error, BVHD_VUID_10427,
                               VALIDATE_GEOMETRY_PLACE(subject, "linearSweptSpheres.indexingMode"),
                               "SUCCESSIVE needs indices, and indexType is NONE");
    return BVHD_OK;
}

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    const struct geometry_swept_spheres *swept = &subject->geometry->swept_spheres;
    enum bvhd_status status = kind_check_spheres(subject, &swept->ends, &rules);
    return status == BVHD_OK ? check_modes(subject, swept) : status;
}

/* Every primitive gets a pair of ends of its own, except that successive ones share them. */
static uint64_t vertices(const struct geometry *geometry)
{
    const struct geometry_swept_spheres *swept = &geometry->swept_spheres;
    const uint32_t count = geometry->range.primitive_count;
    if (count > 0 && kind_is_one_sphere(&swept->ends))
        return 2;
    if (count == 0 || swept->indexing_mode != SWEPT_SUCCESSIVE)
        return 2 * (uint64_t)count;
    return kind_named_spheres(&swept->ends) + 1;
}

const struct kind kind_swept_spheres = {
    .type = GEOMETRY_SWEPT_SPHERES,
    .vulkan_type = GEOMETRY_SWEPT_SPHERES,
    .number = KIND_SWEPT_SPHERES,
    .noun = "linear swept spheres",
    .member = "linearSweptSpheres",
    .too_many = BVHD_VUID_NONE, /* maxPrimitiveCount limits triangles and AABBs */
    .can_be_cut = true,
    .primitive_bytes = sizeof(uint32_t),
    .vertex_bytes = 4 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};

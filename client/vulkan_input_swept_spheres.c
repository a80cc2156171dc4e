/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "client/vulkan_input_round.h"

/* A mode that Vulkan does not have uses nothing, so that nothing is read for it. */
static struct round_use use_in(VkRayTracingLssIndexingModeNV mode)
{
    switch ((uint32_t)mode) {
    case SWEPT_LIST:
        return (struct round_use){.vertices = 2, .indices = 2};
    case SWEPT_SUCCESSIVE:
        return (struct round_use){.indices = 1, .following = 1};
    default:
        return (struct round_use){0};
    }
}

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryLinearSweptSpheresDataNV *swept = data;
    const struct round_use use = use_in(swept->indexingMode);
    VkAccelerationStructureGeometrySpheresDataNV ends;
    _Static_assert(sizeof ends == offsetof(VkAccelerationStructureGeometryLinearSweptSpheresDataNV, indexingMode),
                   "both structs begin alike");
    (void)entry;
    memcpy(&ends, swept, sizeof ends); /* C allows no access to it through a pointer to the other type */
    geometry->swept_spheres = (struct geometry_swept_spheres){
        .ends = vulkan_input_round(&ends, &geometry->range, &use),
        .indexing_mode = (uint32_t)swept->indexingMode,
        .end_caps_mode = (uint32_t)swept->endCapsMode,
    };
    return BVHD_OK;
}

const struct vulkan_input_kind vulkan_input_swept_spheres = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV,
    .is_chained = true,
    .type_rule = BVHD_VUID_LinearSweptSpheresData_sType_sType,
    .convert = convert,
};

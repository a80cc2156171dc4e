/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_kind.h"

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryAabbsDataKHR *aabbs = data;
    const struct geometry_range *range = &geometry->range;
    (void)entry;
    uint64_t size = 0;
    if (vulkan_input_is_countable(range))
        size = vulkan_input_extent(range->primitive_offset, aabbs->stride, range->primitive_count,
                                   sizeof(VkAabbPositionsKHR));
    geometry->aabbs = (struct geometry_aabbs){aabbs->stride, vulkan_input_bytes(aabbs->data.hostAddress, size)};
    return BVHD_OK;
}

const struct vulkan_input_kind vulkan_input_aabbs = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
    .type_rule = BVHD_VUID_AabbsData_sType_sType,
    .chain_rule = BVHD_VUID_AabbsData_pNext_pNext,
    .convert = convert,
};

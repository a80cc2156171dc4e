/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_round.h"

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    static const struct round_use use = {.vertices = 1, .indices = 1};
    (void)entry;
    geometry->spheres = vulkan_input_round(data, &geometry->range, &use);
    return BVHD_OK;
}

const struct vulkan_input_kind vulkan_input_spheres = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
    .is_chained = true,
    .type_rule = BVHD_VUID_SpheresData_sType_sType,
    .convert = convert,
};

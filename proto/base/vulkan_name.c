/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/vulkan_name.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdio.h>

/* The numbers are written out, because installed headers of Vulkan are often older than some of the extensions. */
static const struct {
    enum vulkan_enum of;
    uint32_t value;
    const char *name;
} names[] = {
#define VERTEX_FORMAT(name, value, size, alignment) {VULKAN_FORMAT, value, "VK_FORMAT_" #name},
#include "proto/base/vertex_formats.def"
#undef VERTEX_FORMAT
    {VULKAN_FORMAT, 0, "VK_FORMAT_UNDEFINED"},
    {VULKAN_FORMAT, 23, "VK_FORMAT_R8G8B8_UNORM"},
    {VULKAN_FORMAT, 84, "VK_FORMAT_R16G16B16_UNORM"},
    {VULKAN_FORMAT, 98, "VK_FORMAT_R32_UINT"},
    {VULKAN_FORMAT, 100, "VK_FORMAT_R32_SFLOAT"},
    {VULKAN_FORMAT, 104, "VK_FORMAT_R32G32B32_UINT"},
    {VULKAN_FORMAT, 105, "VK_FORMAT_R32G32B32_SINT"},
    {VULKAN_FORMAT, 107, "VK_FORMAT_R32G32B32A32_UINT"},
    {VULKAN_FORMAT, 108, "VK_FORMAT_R32G32B32A32_SINT"},
    {VULKAN_FORMAT, 112, "VK_FORMAT_R64_SFLOAT"},
    {VULKAN_FORMAT, 122, "VK_FORMAT_B10G11R11_UFLOAT_PACK32"},
    {VULKAN_INDEX_TYPE, 0, "VK_INDEX_TYPE_UINT16"},
    {VULKAN_INDEX_TYPE, 1, "VK_INDEX_TYPE_UINT32"},
    {VULKAN_INDEX_TYPE, 1000165000, "VK_INDEX_TYPE_NONE_KHR"},
    {VULKAN_INDEX_TYPE, 1000265000, "VK_INDEX_TYPE_UINT8_KHR"},
    {VULKAN_TYPE, 0, "VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR"},
    {VULKAN_TYPE, 1, "VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR"},
    {VULKAN_TYPE, 2, "VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR"},
    {VULKAN_GEOMETRY_TYPE, 0, "VK_GEOMETRY_TYPE_TRIANGLES_KHR"},
    {VULKAN_GEOMETRY_TYPE, 1, "VK_GEOMETRY_TYPE_AABBS_KHR"},
    {VULKAN_GEOMETRY_TYPE, 2, "VK_GEOMETRY_TYPE_INSTANCES_KHR"},
    {VULKAN_GEOMETRY_TYPE, 1000429004, "VK_GEOMETRY_TYPE_SPHERES_NV"},
    {VULKAN_GEOMETRY_TYPE, 1000429005, "VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV"},
    {VULKAN_GEOMETRY_TYPE, 1000478000, "VK_GEOMETRY_TYPE_DENSE_GEOMETRY_FORMAT_TRIANGLES_AMDX"},
    {VULKAN_GEOMETRY_TYPE, 1000623000, "VK_GEOMETRY_TYPE_MICROMAP_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150000, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150002, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150003, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150004, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150005, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150006, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150017, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR"},
    {VULKAN_STRUCTURE_TYPE, 1000150020, "VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR"},
};

static struct vulkan_name number(const char *prefix, uint32_t value)
{
    struct vulkan_name result;
    snprintf(result.text, sizeof result.text, "%s%" PRIu32, prefix, value);
    return result;
}

struct vulkan_name vulkan_name(enum vulkan_enum of, uint32_t value)
{
    struct vulkan_name result;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].of == of && names[i].value == value) {
            snprintf(result.text, sizeof result.text, "%s", names[i].name);
            return result;
        }
    return number("", value);
}

struct vulkan_name vulkan_geometry_noun(uint32_t type)
{
    switch (type) {
    case 0:
        return (struct vulkan_name){"triangles"};
    case 1:
        return (struct vulkan_name){"AABBs"};
    case 2:
        return (struct vulkan_name){"instances"};
    default:
        return number("geometry type ", type);
    }
}

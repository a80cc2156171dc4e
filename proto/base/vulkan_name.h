/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_name.h - the names of Vulkan's enumerants for the texts of errors: vulkan_name(VULKAN_FORMAT, 100).text */
#ifndef BVHD_VULKAN_NAME_H
#define BVHD_VULKAN_NAME_H

#include <stdint.h>

/* The enumerations whose values are named. */
enum vulkan_enum { VULKAN_STRUCTURE_TYPE, VULKAN_TYPE, VULKAN_GEOMETRY_TYPE, VULKAN_FORMAT, VULKAN_INDEX_TYPE };

struct vulkan_name {
    char text[96];
};

/*
 * Returns the name of a value, such as "VK_FORMAT_R32_SFLOAT", or its number if the name is not known. The structure
 * type 0 is a number: it is that of a struct whose sType was not set.
 */
struct vulkan_name vulkan_name(enum vulkan_enum of, uint32_t value);

#endif

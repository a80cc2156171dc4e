/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_input_micromap.h - what the conversions of micromaps and of triangles with them share. Only for
 * vulkan_input*.c.
 */
#ifndef BVHD_VULKAN_INPUT_MICROMAP_H
#define BVHD_VULKAN_INPUT_MICROMAP_H

#include <bvhd/vulkan_khr.h>

#include "client/vulkan_input_kind.h"

/* The usage counts of a struct, in the form that is given: an array, or an array of pointers. */
struct usage_source {
    uint32_t count;
    const void *array;
    const void *const *pointers;
    const char *member; /* of the geometry, in places */
    enum bvhd_vuid both_rule; /* about both forms at once */
    enum bvhd_vuid pointer_rule; /* about a pointer of the array that is NULL */
};

/*
 * Copies the usage counts of a geometry into memory of the entry. Returns BVHD_INVALID if both forms are given, or
 * neither although there are some, and BVHD_NO_MEMORY. A geometry has usage counts of one struct.
 */
enum bvhd_status vulkan_input_copy_usages(const struct input_entry *entry, const struct geometry *geometry,
                                          const struct usage_source *source, struct bytes *ret_usages);

/*
 * Converts the struct in the chain of a geometry's triangles that says which micromap they have, if there is one. The
 * range of `geometry` is set.
 */
enum bvhd_status vulkan_input_attach(const struct input_entry *entry,
                                     const VkAccelerationStructureGeometryTrianglesDataKHR *triangles,
                                     struct geometry *geometry);

/*
 * Gives the entry those references of the call that its triangles name as micromaps. Returns BVHD_INVALID for one
 * without a key, and BVHD_NO_MEMORY. Unknown handles are left for prepare to report.
 */
enum bvhd_status vulkan_input_select_micromaps(const struct input_entry *entry);

#endif

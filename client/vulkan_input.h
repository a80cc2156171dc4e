/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_input.h - from Vulkan's own structs, with host addresses, to the neutral description (rows F17, F18).
 *
 * Checks what only shows in these structs: sType, pNext, that exactly one of pGeometries and ppGeometries is set
 * (03788), that ranges are there (11702), that no instance names what another entry of the call builds (03407).
 * Everything else is left to validate.h. How many bytes lie behind an address follows from the ranges, strides, formats
 * and maxVertex, as Vulkan defines them; the addresses themselves are trusted, as by Vulkan. Arrays of instance
 * pointers are gathered into records.
 */
#ifndef BVHD_VULKAN_INPUT_H
#define BVHD_VULKAN_INPUT_H

#include <vulkan/vulkan_core.h>

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

struct vulkan_input;

/*
 * `ranges[i]` has infos[i].geometryCount entries. `references` are the structures that instances may name:
 * reference.handle is the VkAccelerationStructureKHR as a number, unique; each entry's description has those that its
 * instances name. `options` apply to every entry. An entry that breaks a rule has its error in ret_errors[i] (of
 * `count` entries; the others get BVHD_OK) and an empty description; the others are not disturbed. The geometry's
 * memory must live until the builds are prepared. BVHD_NO_MEMORY when nothing could be made.
 */
enum bvhd_status vulkan_input_create(const VkAccelerationStructureBuildGeometryInfoKHR *infos, uint32_t count,
                                     const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                     const struct reference *references, uint32_t reference_count,
                                     const struct build_options *options, struct vulkan_input **ret_input,
                                     struct bvhd_error *ret_errors);

/* The same from the caller's budget, which must outlive the vulkan_input. */
enum bvhd_status vulkan_input_create_in(struct memory *memory, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                        uint32_t count, const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                        const struct reference *references, uint32_t reference_count,
                                        const struct build_options *options, struct vulkan_input **ret_input,
                                        struct bvhd_error *ret_errors);

/* One description an entry, `count` of them; owned by the vulkan_input. */
const struct build_input *vulkan_input_entries(const struct vulkan_input *input);

/* NULL-safe. */
void vulkan_input_destroy(struct vulkan_input *input);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_input.h - converts Vulkan's own structs, with host addresses, to the neutral description.
 *
 * It checks what only these structs show: sType, pNext, that exactly one of pGeometries and ppGeometries is set (VUID
 * 03788), that ranges are given (11702), that no instance names a structure that another entry of the call builds and
 * that is not among the references (03407). validate.h checks everything else. The number of bytes behind an address
 * follows from the ranges, strides, formats and maxVertex, as Vulkan defines them; the addresses themselves are
 * trusted, as they are by Vulkan. Arrays of instance pointers are gathered into records.
 */
#ifndef BVHD_VULKAN_INPUT_H
#define BVHD_VULKAN_INPUT_H

#include <vulkan/vulkan_core.h>

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

struct vulkan_input;

/*
 * Converts `count` infos; `ranges[i]` has infos[i].geometryCount entries. `references` are the structures that
 * instances may name: reference.handle is the VkAccelerationStructureKHR as a number, unique; each entry's description
 * gets those that its instances name. `options` apply to every entry. An entry that breaks a rule has its error in
 * ret_errors[i] (BVHD_OK for the others) and an empty description; the others are not affected. The geometry's memory
 * must live until the builds are prepared. BVHD_NO_MEMORY if nothing could be made.
 */
enum bvhd_status vulkan_input_create(const VkAccelerationStructureBuildGeometryInfoKHR *infos, uint32_t count,
                                     const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                     const struct reference *references, uint32_t reference_count,
                                     const struct build_options *options, struct vulkan_input **ret_input,
                                     struct bvhd_error *ret_errors);

/* Does the same with memory from the caller's budget, which must outlive the vulkan_input. */
enum bvhd_status vulkan_input_create_in(struct memory *memory, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                        uint32_t count, const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                        const struct reference *references, uint32_t reference_count,
                                        const struct build_options *options, struct vulkan_input **ret_input,
                                        struct bvhd_error *ret_errors);

/* Returns `count` descriptions, one for each info; they belong to the vulkan_input. */
const struct build_input *vulkan_input_entries(const struct vulkan_input *input);

/*
 * Copies the instances of an entry that has references, so that the caller's memory is not needed for them. Returns
 * false without memory.
 */
bool vulkan_input_own_records(struct vulkan_input *input, uint32_t entry);

/* Sets the key of what an entry updates. */
void vulkan_input_set_source_key(struct vulkan_input *input, uint32_t entry, const struct key *key);

/* Sets reference `slot` of an entry. */
void vulkan_input_complete_reference(struct vulkan_input *input, uint32_t entry, uint32_t slot,
                                     const struct reference *reference);

/* Frees the input. NULL is allowed. */
void vulkan_input_destroy(struct vulkan_input *input);

#endif

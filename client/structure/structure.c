/* SPDX-License-Identifier: Apache-2.0 */
#include "client/structure/structure.h"

#include <stdbool.h>
#include <string.h>

#include "client/argument.h"
#include "client/library.h"
#include "proto/base/place.h"
#include "proto/base/vulkan_name.h"

/* Structs that may follow the create info; numbers, because installed headers are often older. */
enum { MOTION_INFO = 1000327002, OPAQUE_CAPTURE = 1000316005, STRUCTURE_OPACITY_MICROMAP = 1000623000 };

/* VkAccelerationStructureCreateFlagBitsKHR */
enum { CREATE_ADDRESS_REPLAY = 1, CREATE_MOTION = 4, CREATE_DESCRIPTOR_REPLAY = 8, CREATE_KNOWN = 13 };

struct bvhd_structure *structure_of(VkAccelerationStructureKHR handle)
{
    return (struct bvhd_structure *)(uintptr_t)handle;
}

VkAccelerationStructureKHR bvhd_structure_handle(const struct bvhd_structure *structure)
{
    return (VkAccelerationStructureKHR)(uintptr_t)structure;
}

enum bvhd_status structure_check_argument(const void *argument, const char *name, enum bvhd_vuid rule,
                                          struct bvhd_error *error)
{
    return argument ? BVHD_OK : bvhd_error_rule(error, rule, name, "%s is NULL", name);
}

static enum bvhd_status check_type(const struct structure_head *head, VkStructureType type, struct bvhd_error *error)
{
    if (type == head->type)
        return BVHD_OK;
    return bvhd_error_rule(error, head->type_rule, place("%s.sType", head->name).text, "sType is %s, not %s",
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)type).text,
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)head->type).text);
}

enum bvhd_status structure_check_head(const struct structure_head *head, const void *info, struct bvhd_error *error)
{
    const VkBaseInStructure *base = info;
    enum bvhd_status status = check_type(head, base->sType, error);
    if (status != BVHD_OK || !base->pNext)
        return status;
    return bvhd_error_rule(error, head->chain_rule, place("%s.pNext", head->name).text, "no struct may follow here");
}

/* ---- creation ---- */

/* Checks the structs that follow: two are known, each at most once. *ret_motion is NULL or the one about motion. */
static enum bvhd_status check_chain(const VkAccelerationStructureCreateInfoKHR *info,
                                    const VkAccelerationStructureMotionInfoNV **ret_motion, struct bvhd_error *error)
{
    const void *motion = NULL, *capture = NULL;
    for (const VkBaseInStructure *next = info->pNext; next; next = next->pNext) {
        const void **seen = (uint32_t)next->sType == MOTION_INFO      ? &motion
                            : (uint32_t)next->sType == OPAQUE_CAPTURE ? &capture
                                                                      : NULL;
        if (!seen)
            return bvhd_error_rule(error, BVHD_VUID_CreateInfo_pNext_pNext, "info.pNext",
                                   "a struct whose sType is %s does not belong here",
                                   vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)next->sType).text);
        if (*seen)
            return bvhd_error_rule(error, BVHD_VUID_CreateInfo_sType_unique, "info.pNext",
                                   "two structs have the sType %u", (unsigned)next->sType);
        *seen = next;
    }
    *ret_motion = motion;
    if (capture && !(info->createFlags & CREATE_DESCRIPTOR_REPLAY))
        return bvhd_error_rule(error, BVHD_VUID_08109, "info.pNext",
                               "a descriptor to replay needs the flag DESCRIPTOR_BUFFER_CAPTURE_REPLAY");
    return BVHD_OK;
}

static enum bvhd_status check_motion_info(const VkAccelerationStructureCreateInfoKHR *info,
                                          const VkAccelerationStructureMotionInfoNV *motion, struct bvhd_error *error)
{
    if (motion && motion->flags != 0)
        return bvhd_error_rule(error, BVHD_VUID_MotionInfo_flags_zerobitmask, "info.pNext.flags",
                               "flags is 0x%x, and none is defined", motion->flags);
    if (info->createFlags & CREATE_MOTION && info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR && !motion)
        return bvhd_error_rule(error, BVHD_VUID_04954, "info.pNext",
                               "a top level with motion needs VkAccelerationStructureMotionInfoNV");
    return BVHD_OK;
}

/* Flags of capture and replay belong to features that are not enabled, because bvhd has none of them. */
static enum bvhd_status check_flags(const VkAccelerationStructureCreateInfoKHR *info, struct bvhd_error *error)
{
    const uint32_t flags = info->createFlags;
    if (flags & ~(uint32_t)CREATE_KNOWN)
        return bvhd_error_rule(error, BVHD_VUID_CreateInfo_createFlags_parameter, "info.createFlags",
                               "unknown bits 0x%x", flags & ~(uint32_t)CREATE_KNOWN);
    if (info->deviceAddress != 0 && !(flags & CREATE_ADDRESS_REPLAY))
        return bvhd_error_rule(error, BVHD_VUID_03612, "info.deviceAddress",
                               "an address needs the flag DEVICE_ADDRESS_CAPTURE_REPLAY");
    if (flags & CREATE_ADDRESS_REPLAY)
        return bvhd_error_rule(error, BVHD_VUID_03613, "info.createFlags",
                               "the feature accelerationStructureCaptureReplay is not offered");
    if (flags & CREATE_DESCRIPTOR_REPLAY)
        return bvhd_error_rule(error, BVHD_VUID_08108, "info.createFlags",
                               "the feature descriptorBufferCaptureReplay is not offered");
    return BVHD_OK;
}

static enum bvhd_status check_create(const VkAccelerationStructureCreateInfoKHR *info,
                                     const VkAccelerationStructureMotionInfoNV **ret_motion, struct bvhd_error *error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                               BVHD_VUID_CreateInfo_sType_sType, BVHD_VUID_CreateInfo_pNext_pNext,
                                               "info"};
    enum bvhd_status status = check_type(&head, info->sType, error);
    if (status == BVHD_OK)
        status = check_chain(info, ret_motion, error);
    if (status != BVHD_OK)
        return status;
    if ((uint32_t)info->type == STRUCTURE_OPACITY_MICROMAP)
        return bvhd_error_rule(error, BVHD_VUID_11600, "info.type", "opacity micromaps are not created by this struct");
    if ((uint32_t)info->type > STRUCTURE_GENERIC)
        return bvhd_error_rule(error, BVHD_VUID_CreateInfo_type_parameter, "info.type",
                               "type is %u, which is no VkAccelerationStructureTypeKHR", (unsigned)info->type);
    status = check_flags(info, error);
    if (status == BVHD_OK)
        status = check_motion_info(info, *ret_motion, error);
    if (status == BVHD_OK && info->offset % 256 != 0)
        status = bvhd_error_rule(error, BVHD_VUID_03734, "info.offset", "%llu is no multiple of 256",
                                 (unsigned long long)info->offset);
    return status;
}

enum bvhd_status bvhd_structure_create(const VkAccelerationStructureCreateInfoKHR *info,
                                       struct bvhd_structure **ret_structure, struct bvhd_error *ret_error)
{
    const VkAccelerationStructureMotionInfoNV *motion = NULL;
    enum bvhd_status status = structure_check_argument(info, "info", BVHD_VUID_Create_pCreateInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = structure_check_argument(ret_structure, "ret_structure",
                                          BVHD_VUID_Create_pAccelerationStructure_parameter, ret_error);
    if (status == BVHD_OK)
        status = check_create(info, &motion, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_structure *structure = memory_alloc(&library_memory, sizeof *structure);
    if (!structure)
        return bvhd_error_no_memory(ret_error, "structure", "no memory for it");
    *structure = (struct bvhd_structure){
        .type = (uint32_t)info->type,
        .size = info->size,
        .moves = (info->createFlags & CREATE_MOTION) != 0,
        .max_instances = motion ? motion->maxInstances : UINT64_MAX,
    };
    *ret_structure = structure;
    return BVHD_OK;
}

void bvhd_structure_destroy(struct bvhd_structure *structure)
{
    if (!structure)
        return;
    structure_release(&structure->contents);
    bvhd_blob_unref(structure->contents.blob);
    memory_free(&library_memory, structure);
}

/* ---- contents ---- */

/* An empty native structure may be of either type. */
bool structure_takes(const struct bvhd_structure *structure, uint32_t type)
{
    return structure->type == STRUCTURE_GENERIC || type == STRUCTURE_GENERIC || structure->type == type;
}

bool structure_takes_motion(const struct bvhd_structure *structure, uint32_t flags)
{
    return structure->moves == ((flags & BUILD_MOTION) != 0);
}

enum bvhd_status structure_check_instances(const struct bvhd_structure *structure, uint32_t motion_instances,
                                           const char *where, struct bvhd_error *error)
{
    if (motion_instances <= structure->max_instances)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_INVALID, where, "it was created for %llu motion instances, and there are %u",
                          (unsigned long long)structure->max_instances, motion_instances);
}

void structure_release(const struct structure_contents *contents)
{
    positions_unref(contents->positions);
}

void structure_replace(struct bvhd_structure *structure, const struct structure_contents *contents)
{
    const struct structure_contents before = structure->contents;
    structure->contents = *contents;
    structure_release(&before);
    bvhd_blob_unref(before.blob);
}

enum bvhd_status bvhd_structure_get(const struct bvhd_structure *structure, struct bvhd_structure_state *ret_state)
{
    if (!structure || !ret_state)
        return BVHD_INVALID;
    const struct structure_contents *contents = &structure->contents;
    *ret_state = (struct bvhd_structure_state){
        .created_type = (VkAccelerationStructureTypeKHR)structure->type,
        .created_size = structure->size,
    };
    if (!contents->blob)
        return BVHD_OK;
    ret_state->is_built = 1;
    ret_state->type = (VkAccelerationStructureTypeKHR)contents->type;
    ret_state->flags = contents->flags;
    ret_state->target = (enum bvhd_target)contents->target;
    ret_state->data = bvhd_blob_data(contents->blob);
    ret_state->data_size = bvhd_blob_size(contents->blob);
    return BVHD_OK;
}

/* ---- results ---- */

/* Returns whether an info updates a structure that needs no more than its compacted size. */
static bool updates_compacted(const VkAccelerationStructureBuildGeometryInfoKHR *info)
{
    const bool is_update = info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    const struct bvhd_structure *source = is_update ? structure_of(info->srcAccelerationStructure) : NULL;
    return source && source->contents.is_compacted;
}

/* The size that a build needs is the one that was to be asked for, even if the result is smaller. */
static enum bvhd_status bound_size(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                   const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                   const struct build_options *options, uint64_t *ret_size, struct bvhd_error *error)
{
    uint32_t *counts = memory_array(&library_memory, (uint64_t)info->geometryCount + 1, sizeof *counts);
    if (!counts)
        return bvhd_error_no_memory(error, "info", "no memory for %u geometries", info->geometryCount);
    for (uint32_t i = 0; i < info->geometryCount; i++)
        counts[i] = ranges[i].primitiveCount;
    enum bvhd_status status = structure_bound(info, counts, options, ret_size, error);
    memory_free(&library_memory, counts);
    return status;
}

static enum bvhd_status check_room(const struct bvhd_structure *structure, uint64_t needed, struct bvhd_error *error)
{
    if (structure->size >= needed)
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_10126, "info.dstAccelerationStructure",
                           "it was created with %llu bytes, and the build needs %llu",
                           (unsigned long long)structure->size, (unsigned long long)needed);
}

static enum bvhd_status check_size(const struct bvhd_structure *structure,
                                   const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                   const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                   const struct bvhd_result *result, const struct structure_contents *contents,
                                   struct bvhd_error *error)
{
    const struct build_options options = {.quality = (enum build_quality)result->quality,
                                          .target = contents->target,
                                          .layout_flags = contents->layout_flags};
    uint64_t needed = contents->body_size;
    enum bvhd_status status = contents->is_compacted ? BVHD_OK : bound_size(info, ranges, &options, &needed, error);
    return status == BVHD_OK ? check_room(structure, needed, error) : status;
}

static enum bvhd_status check_created_type(const struct bvhd_structure *structure, uint32_t type,
                                           struct bvhd_error *error)
{
    if (structure_takes(structure, type))
        return BVHD_OK;
    const bool is_top = type == STRUCTURE_TOP;
    return bvhd_error_rule(error, is_top ? BVHD_VUID_03699 : BVHD_VUID_03700, "info.dstAccelerationStructure",
                           "it was created as a %s level, not as a %s level or GENERIC", is_top ? "bottom" : "top",
                           is_top ? "top" : "bottom");
}

/* Checks that the object was created with motion exactly if the info has motion, and for as many instances. */
static enum bvhd_status check_motion(const struct bvhd_structure *structure,
                                     const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                     const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct bvhd_error *error)
{
    if (!structure_takes_motion(structure, info->flags) && structure->moves)
        return bvhd_error_rule(error, BVHD_VUID_04927, "info.flags", "the destination was created with MOTION");
    if (!structure_takes_motion(structure, info->flags))
        return bvhd_error_rule(error, BVHD_VUID_04928, "info.dstAccelerationStructure",
                               "it was created without MOTION");
    const bool has_instances = structure->moves && info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    return structure_check_instances(structure, has_instances && info->geometryCount > 0 ? ranges[0].primitiveCount : 0,
                                     "info.dstAccelerationStructure", error);
}

/* Checks that the result is one of the info, and reads it. */
static enum bvhd_status read_result(const struct bvhd_result *result,
                                    const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                    struct structure_contents *ret_contents, struct bvhd_error *error)
{
    enum bvhd_status status = structure_read(result->blob, ret_contents, error);
    if (status != BVHD_OK)
        return status;
    const bool is_native = ret_contents->target != TARGET_PORTABLE;
    if ((ret_contents->type != (uint32_t)info->type && ret_contents->type != STRUCTURE_GENERIC) ||
        (!is_native && ret_contents->flags != info->flags)) {
        structure_release(ret_contents);
        return bvhd_error_set(error, BVHD_INVALID, "result", "it was built with another type or other flags");
    }
    ret_contents->type = (uint32_t)info->type;
    ret_contents->flags = info->flags;
    return BVHD_OK;
}

static enum bvhd_status hold(struct bvhd_structure *structure, const VkAccelerationStructureBuildGeometryInfoKHR *info,
                             const VkAccelerationStructureBuildRangeInfoKHR *ranges, const struct bvhd_result *result,
                             struct bvhd_error *error)
{
    struct structure_contents contents;
    enum bvhd_status status = check_created_type(structure, (uint32_t)info->type, error);
    if (status == BVHD_OK)
        status = check_motion(structure, info, ranges, error);
    if (status == BVHD_OK)
        status = read_result(result, info, &contents, error);
    if (status != BVHD_OK)
        return status;
    contents.is_compacted = updates_compacted(info);
    status = check_size(structure, info, ranges, result, &contents, error);
    if (status != BVHD_OK) {
        structure_release(&contents);
        return status;
    }
    bvhd_blob_ref(contents.blob);
    structure_replace(structure, &contents);
    return BVHD_OK;
}

enum bvhd_status bvhd_structure_hold(struct bvhd_structure *structure,
                                     const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                     const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                     const struct bvhd_result *result, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {structure, "structure"}, {info, "info"}, {result, "result"});
    if (status == BVHD_OK && result->error.status != BVHD_OK) {
        if (ret_error)
            *ret_error = result->error;
        return result->error.status;
    }
    if (status == BVHD_OK && info->geometryCount > 0 && !ranges)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "ranges", "ranges is NULL, but geometryCount is %u",
                                info->geometryCount);
    if (status == BVHD_OK && !result->blob)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "result", "the result has no blob");
    return status == BVHD_OK ? hold(structure, info, ranges, result, ret_error) : status;
}

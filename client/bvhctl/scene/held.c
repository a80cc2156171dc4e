/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/held.h"

#include <stdio.h>
#include <string.h>

#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "client/bvhctl/base/files.h"

/* `build_flags` are those of the bytes that it is for: structures with MOTION are created with it. */
static enum bvhd_status create(uint64_t size, VkAccelerationStructureTypeKHR type, uint32_t build_flags,
                               struct held *held, struct bvhd_error *error)
{
    const VkAccelerationStructureMotionInfoNV motion = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_MOTION_INFO_NV, .maxInstances = UINT32_MAX};
    const bool moves = build_flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV;
    const VkAccelerationStructureCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
        .pNext = moves ? &motion : NULL,
        .createFlags = moves ? VK_ACCELERATION_STRUCTURE_CREATE_MOTION_BIT_NV : 0u,
        .size = size,
        .type = type};
    return bvhd_structure_create(&info, &held->structure, error);
}

/*
 * A native structure is compatible with the driver that its own header names: files are looked at and copied on
 * machines without that driver, too.
 */
static enum bvhd_status deserialize(struct bytes bytes, struct held *held, struct bvhd_error *error)
{
    struct bvhd_format format = {.struct_size = sizeof format};
    const VkCopyMemoryToAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.hostAddress = bytes.data,
        .dst = bvhd_structure_handle(held->structure),
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    if (bytes.size >= 2 * SERIALIZED_UUID_SIZE) {
        memcpy(format.driver_uuid, bytes.data, sizeof format.driver_uuid);
        memcpy(format.compatibility_uuid, bytes.data + SERIALIZED_UUID_SIZE, sizeof format.compatibility_uuid);
    }
    return bvhd_structure_deserialize(&info, bytes.size, &format, error);
}

/* Returns the flags of a structure, as far as its bytes tell. Whether they are sound is found out later. */
static uint32_t flags_of(struct bytes bytes)
{
    struct portable_view view;
    return portable_open_sections(bytes, &view, NULL) == BVHD_OK ? view.header->build_flags : 0;
}

enum bvhd_status held_open(const char *path, struct memory *memory, struct held *ret_held, struct bvhd_error *error)
{
    static _Alignas(16) const unsigned char nothing[16];
    struct held held = {0};
    unsigned char *data = NULL;
    uint64_t size = 0;
    enum bvhd_status status = files_read(path, UINT64_MAX, memory, &data, &size, error);
    if (status != BVHD_OK)
        return status;
    const struct bytes bytes = {data ? data : nothing, size};
    status = create(UINT64_MAX, VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, flags_of(bytes), &held, error);
    if (status == BVHD_OK)
        status = deserialize(bytes, &held, error);
    memory_free(memory, data);
    if (status == BVHD_OK)
        bvhd_structure_get(held.structure, &held.state);
    if (status == BVHD_OK && held.state.data_size != size)
        status = bvhd_error_set(error, BVHD_CORRUPT, path, "%llu bytes follow the structure",
                                (unsigned long long)(size - held.state.data_size));
    if (status != BVHD_OK) {
        snprintf(error->where, sizeof error->where, "%s", path);
        bvhd_structure_destroy(held.structure);
        return status;
    }
    *ret_held = held;
    return BVHD_OK;
}

enum bvhd_status held_property(const struct held *held, VkQueryType type, uint64_t *ret_value, struct bvhd_error *error)
{
    const VkAccelerationStructureKHR handle = bvhd_structure_handle(held->structure);
    VkDeviceSize value = 0;
    const struct bvhd_structure_properties properties = {.struct_size = sizeof properties,
                                                         .structure_count = 1,
                                                         .query_type = type,
                                                         .structures = &handle,
                                                         .data_size = sizeof value,
                                                         .data = &value,
                                                         .stride = sizeof value};
    enum bvhd_status status = bvhd_structure_query(&properties, error);
    if (status == BVHD_OK)
        *ret_value = value;
    else if (error)
        error->where[0] = '\0';
    return status;
}

enum bvhd_status held_copy(const struct held *source, VkCopyAccelerationStructureModeKHR mode, struct held *ret_held,
                           struct bvhd_error *error)
{
    /* Without the flag there is no compacted size, and the copy names the rule. */
    const bool is_compacted = mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR &&
                              source->state.flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
    const VkQueryType property = is_compacted ? VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR
                                              : VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SIZE_KHR;
    struct held held = {0};
    uint64_t size = 0;
    enum bvhd_status status = held_property(source, property, &size, error);
    if (status == BVHD_OK)
        status = create(size, source->state.type, source->state.flags, &held, error);
    if (status != BVHD_OK)
        return status;
    const VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                     .src = bvhd_structure_handle(source->structure),
                                                     .dst = bvhd_structure_handle(held.structure),
                                                     .mode = mode};
    status = bvhd_structure_copy(&info, error);
    if (status != BVHD_OK) {
        bvhd_structure_destroy(held.structure);
        return status;
    }
    bvhd_structure_get(held.structure, &held.state);
    *ret_held = held;
    return BVHD_OK;
}

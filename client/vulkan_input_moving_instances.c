/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_records.h"
#include "proto/base/place.h"

enum { TYPE_BITS = 15 }; /* of a pointer to an instance */

/* The instances of each type: their sizes, and where they have the reference. */
static const struct {
    uint32_t size, reference;
} types[MOTION_TYPES] = {
    [MOTION_STATIC] = {sizeof(VkAccelerationStructureInstanceKHR), 56},
    [MOTION_MATRIX] = {sizeof(VkAccelerationStructureMatrixMotionInstanceNV), 104},
    [MOTION_SRT] = {sizeof(VkAccelerationStructureSRTMotionInstanceNV), 136},
};
_Static_assert(sizeof(VkAccelerationStructureMotionInstanceNV) == MOTION_RECORD_SIZE &&
                   sizeof(VkAccelerationStructureMatrixMotionInstanceNV) == 112 &&
                   sizeof(VkAccelerationStructureSRTMotionInstanceNV) == 144,
               "motion records are read by offset");

static uint64_t reference(const unsigned char *record)
{
    const uint32_t type = bytes_get32(record);
    return type < MOTION_TYPES ? bytes_get64(record + MOTION_RECORD_DATA + types[type].reference) : 0;
}

/* The low bits of the pointer say the type of the instance behind it. */
static enum bvhd_status gather(const struct input_entry *entry, uint32_t index, uint64_t pointer,
                               unsigned char *ret_record)
{
    const uint32_t type = pointer & TYPE_BITS;
    const void *instance = (const void *)(uintptr_t)(pointer & ~(uint64_t)TYPE_BITS);
    if (!instance)
        return vulkan_input_refuse_pointer(entry, index);
    if (type >= MOTION_TYPES)
        return bvhd_error_rule(entry->error, BVHD_VUID_MotionInstance_type_parameter,
                               place("infos[%u].geometries[0].instances[%u]", entry->index, index).text,
                               "the low bits of the pointer are %u, which is no VkAccelerationStructure"
                               "MotionInstanceTypeNV",
                               type);
    memset(ret_record, 0, MOTION_RECORD_STRIDE);
    bytes_put32(ret_record, type);
    memcpy(ret_record + MOTION_RECORD_DATA, instance, types[type].size);
    return BVHD_OK;
}

const struct input_records input_motion_records = {MOTION_RECORD_STRIDE, MOTION_RECORD_SIZE, reference, gather};

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    return vulkan_input_convert_records(entry, &input_motion_records, data, geometry);
}

const struct vulkan_input_kind vulkan_input_moving_instances = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
    .type_rule = BVHD_VUID_InstancesData_sType_sType,
    .chain_rule = BVHD_VUID_InstancesData_pNext_pNext,
    .convert = convert,
};

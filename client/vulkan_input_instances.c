/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_records.h"
#include "proto/base/place.h"
#include "proto/base/request_limits.h"

enum { RECORD_SIZE = sizeof(VkAccelerationStructureInstanceKHR), RECORD_REFERENCE = 56 };
_Static_assert(RECORD_SIZE == 64, "instance records are read by offset");

enum bvhd_status vulkan_input_refuse_pointer(const struct input_entry *entry, uint32_t index)
{
    return bvhd_error_rule(entry->error, BVHD_VUID_03778,
                           place("infos[%u].geometries[0].instances[%u]", entry->index, index).text,
                           "the pointer to this instance is NULL");
}

static uint64_t reference(const unsigned char *record)
{
    return bytes_get64(record + RECORD_REFERENCE);
}

static enum bvhd_status gather(const struct input_entry *entry, uint32_t index, uint64_t pointer,
                               unsigned char *ret_record)
{
    if (!pointer)
        return vulkan_input_refuse_pointer(entry, index);
    memcpy(ret_record, (const void *)(uintptr_t)pointer, RECORD_SIZE);
    return BVHD_OK;
}

const struct input_records input_records = {RECORD_SIZE, RECORD_SIZE, reference, gather};

/* Returns how the records of a geometry are read, which consists of instances. */
static const struct input_records *records_of(const struct geometry *geometry)
{
    return geometry->type == GEOMETRY_MOVING_INSTANCES ? &input_motion_records : &input_records;
}

/* Copies the records behind the pointers into an array that the entry owns; the range then starts at 0. */
static enum bvhd_status gather_all(const struct input_entry *entry, const struct input_records *records,
                                   const unsigned char *pointers, struct geometry *geometry)
{
    uint32_t count = geometry->range.primitive_count;
    unsigned char *array = memory_array(entry->call->memory, count, records->stride);
    if (!array)
        return vulkan_input_no_memory(entry);
    entry->owned->records = array;
    pointers += geometry->range.primitive_offset;
    for (uint32_t i = 0; i < count; i++) {
        const uint64_t pointer = bytes_get64(pointers + i * sizeof pointer);
        enum bvhd_status status = records->gather(entry, i, pointer, array + (size_t)i * records->stride);
        if (status != BVHD_OK)
            return status;
    }
    geometry->range.primitive_offset = 0;
    geometry->instances.records = (struct bytes){array, (uint64_t)count * records->stride};
    return BVHD_OK;
}

/*
 * Returns whether records may be read: the description is valid as far as it is needed here. validate_input rejects all
 * others before it reads records.
 */
static bool are_readable(const struct input_entry *entry, const struct geometry *geometry)
{
    return entry->info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR && entry->info->geometryCount == 1 &&
           geometry->range.primitive_count > 0 && geometry->range.primitive_count <= LIMIT_MAX_INSTANCES &&
           geometry->range.primitive_offset % 16 == 0;
}

static bool is_built_elsewhere(const struct input_entry *entry, uint64_t handle)
{
    const struct input_call *call = entry->call;
    uint32_t at = handle_find(call->destinations, call->count, handle);
    if (at != HANDLE_NONE && call->destinations[at].number == entry->index)
        at++;
    return at < call->count && call->destinations[at].handle == handle;
}

/* Marks the references that the records name. Unknown handles are left for prepare to report. */
static enum bvhd_status mark_named(const struct input_entry *entry, const struct geometry *geometry,
                                   unsigned char *marks)
{
    const struct input_call *call = entry->call;
    const struct input_records *format = records_of(geometry);
    const unsigned char *records = geometry->instances.records.data + geometry->range.primitive_offset;
    uint64_t last = 0;
    for (uint32_t i = 0; i < geometry->range.primitive_count; i++) {
        uint64_t handle = format->reference(records + (size_t)i * format->stride);
        if (handle == last)
            continue;
        last = handle;
        uint32_t at = handle ? handle_find(call->known, call->reference_count, handle) : HANDLE_NONE;
        if (at != HANDLE_NONE)
            marks[call->known[at].number] = 1;
        else if (handle != 0 && is_built_elsewhere(entry, handle))
            return bvhd_error_rule(
                entry->error, BVHD_VUID_03407,
                place("infos[%u].geometries[0].instances[%u].accelerationStructureReference", entry->index, i).text,
                "another entry of this call builds into this structure");
    }
    return BVHD_OK;
}

/* Selects the references of a top level that its instances name, so that the description is self-contained. */
static enum bvhd_status select_references(const struct input_entry *entry, const struct geometry *geometry)
{
    uint32_t count = entry->call->reference_count;
    unsigned char *marks = memory_alloc(entry->call->memory, (uint64_t)count + 1);
    if (!marks)
        return vulkan_input_no_memory(entry);
    memset(marks, 0, (size_t)count + 1);
    enum bvhd_status status = mark_named(entry, geometry, marks);
    if (status == BVHD_OK)
        status = vulkan_input_copy_marked(entry, marks);
    memory_free(entry->call->memory, marks);
    return status;
}

enum bvhd_status vulkan_input_convert_records(const struct input_entry *entry, const struct input_records *records,
                                              const void *data, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryInstancesDataKHR *instances = data;
    const struct geometry_range *range = &geometry->range;
    uint64_t size = 0;
    /* An array of pointers has no records to read. */
    if (!instances->arrayOfPointers && range->primitive_count <= LIMIT_MAX_INSTANCES)
        size = vulkan_input_extent(range->primitive_offset, records->stride, range->primitive_count, records->size);
    geometry->instances.records = vulkan_input_bytes(instances->data.hostAddress, size);
    if (!instances->data.hostAddress || !are_readable(entry, geometry))
        return BVHD_OK;
    enum bvhd_status status =
        instances->arrayOfPointers ? gather_all(entry, records, instances->data.hostAddress, geometry) : BVHD_OK;
    return status == BVHD_OK ? select_references(entry, geometry) : status;
}

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    return vulkan_input_convert_records(entry, &input_records, data, geometry);
}

bool vulkan_input_own_records(struct vulkan_input *input, uint32_t entry)
{
    struct entry_memory *owned = &input->owned[entry];
    if (owned->records)
        return true;
    struct geometry *geometry = owned->geometries;
    const struct bytes given = geometry->instances.records;
    const uint64_t size = given.size - geometry->range.primitive_offset;
    owned->records = memory_alloc(input->memory, size);
    if (!owned->records)
        return false;
    memcpy(owned->records, given.data + geometry->range.primitive_offset, size);
    geometry->range.primitive_offset = 0;
    geometry->instances.records = (struct bytes){owned->records, size};
    return true;
}

const struct vulkan_input_kind vulkan_input_instances = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
    .type_rule = BVHD_VUID_InstancesData_sType_sType,
    .chain_rule = BVHD_VUID_InstancesData_pNext_pNext,
    .convert = convert,
};

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input.h"

#include "proto/base/handle_table.h"
#include "proto/base/place.h"
#include "proto/base/request_limits.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vertex_element.h"
#include "proto/base/vulkan_name.h"

enum { RECORD_SIZE = sizeof(VkAccelerationStructureInstanceKHR), RECORD_REFERENCE = 56 };
_Static_assert(RECORD_SIZE == 64, "instance records are read by offset");

/* The memory that one entry owns. */
struct entry_memory {
    struct geometry *geometries;
    struct reference *references;
    unsigned char *records; /* instance records, gathered from pointers */
};

struct vulkan_input {
    struct memory *memory;
    uint32_t count;
    struct build_input *entries;
    struct entry_memory *owned;
};

/* The arguments of one call, and tables that are derived from them once. */
struct input_call {
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    uint32_t count;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
    const struct reference *references;
    uint32_t reference_count;
    const struct build_options *options;
    struct memory *memory;
    struct handle_entry *known; /* references, sorted by handle */
    struct handle_entry *destinations; /* destinations, sorted by handle */
};

/* The entry that is being converted. */
struct input_entry {
    const struct input_call *call;
    const VkAccelerationStructureBuildGeometryInfoKHR *info;
    uint32_t index;
    struct entry_memory *owned;
    struct bvhd_error *error;
};

/*
 * pNext structs that Vulkan allows but bvhd does not support. The types are numbers, because installed headers are
 * often older than these extensions.
 */
static const struct {
    uint32_t type;
    const char *name;
} foreign_structs[] = {
    {1000327000, "motion triangles"},
    {1000396009, "an opacity micromap"},
    {1000397002, "a displacement micromap"},
    {1000429009, "linear swept spheres"},
    {1000429010, "spheres"},
    {1000478001, "dense geometry"},
    {1000623002, "micromap data"},
    {1000623003, "an opacity micromap"},
};

static enum bvhd_status no_memory(const struct input_entry *entry)
{
    return bvhd_error_no_memory(entry->error, place("infos[%u]", entry->index).text, "no memory for the description");
}

static enum bvhd_status check_chain(const struct input_entry *entry, enum bvhd_vuid vuid, struct place where,
                                    const void *chain)
{
    if (!chain)
        return BVHD_OK;
    const VkBaseInStructure *first = chain;
    for (size_t i = 0; i < sizeof foreign_structs / sizeof foreign_structs[0]; i++)
        if ((uint32_t)first->sType == foreign_structs[i].type)
            return bvhd_error_set(entry->error, BVHD_UNSUPPORTED, where.text, "%s is not supported",
                                  foreign_structs[i].name);
    return bvhd_error_rule(entry->error, vuid, where.text, "a struct whose sType is %s does not belong here",
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)first->sType).text);
}

static enum bvhd_status check_structure_type(const struct input_entry *entry, enum bvhd_vuid vuid, struct place where,
                                             VkStructureType type, VkStructureType expected)
{
    if (type == expected)
        return BVHD_OK;
    return bvhd_error_rule(entry->error, vuid, where.text, "sType is %s, not %s",
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)type).text,
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)expected).text);
}

/* Checks sType and pNext of the data of geometry `index`. */
static enum bvhd_status check_data_head(const struct input_entry *entry, uint32_t index,
                                        const VkAccelerationStructureGeometryKHR *source)
{
    static const struct {
        VkStructureType type;
        enum bvhd_vuid type_rule, chain_rule;
        const char *name;
    } heads[] = {
        {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR, BVHD_VUID_TrianglesData_sType_sType,
         BVHD_VUID_TrianglesData_pNext_pNext, "triangles"},
        {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR, BVHD_VUID_AabbsData_sType_sType,
         BVHD_VUID_AabbsData_pNext_pNext, "aabbs"},
        {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR, BVHD_VUID_InstancesData_sType_sType,
         BVHD_VUID_InstancesData_pNext_pNext, "instances"},
    };
    uint32_t type = (uint32_t)source->geometryType;
    if (type > GEOMETRY_INSTANCES)
        return BVHD_OK; /* validate_input reports it */
    const VkBaseInStructure *head = (const void *)&source->geometry;
    enum bvhd_status status = check_structure_type(
        entry, heads[type].type_rule, place("infos[%u].geometries[%u].%s.sType", entry->index, index, heads[type].name),
        head->sType, heads[type].type);
    if (status != BVHD_OK)
        return status;
    return check_chain(entry, heads[type].chain_rule,
                       place("infos[%u].geometries[%u].%s.pNext", entry->index, index, heads[type].name), head->pNext);
}

static enum bvhd_status check_geometry_head(const struct input_entry *entry, uint32_t index,
                                            const VkAccelerationStructureGeometryKHR *source)
{
    enum bvhd_status status = check_structure_type(
        entry, BVHD_VUID_Geometry_sType_sType, place("infos[%u].geometries[%u].sType", entry->index, index),
        source->sType, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR);
    if (status == BVHD_OK)
        status = check_chain(entry, BVHD_VUID_Geometry_pNext_pNext,
                             place("infos[%u].geometries[%u].pNext", entry->index, index), source->pNext);
    return status == BVHD_OK ? check_data_head(entry, index, source) : status;
}

/*
 * Refuses a number of geometries that no structure may have, before memory is asked for them. What else is wrong is
 * left to validate_input, which knows the limits that are announced.
 */
static enum bvhd_status check_geometry_count(const struct input_entry *entry)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = entry->info;
    const struct limits limits = limits_default();
    if (info->geometryCount <= 1)
        return BVHD_OK;
    enum bvhd_status status = BVHD_OK;
    if (info->geometryCount > limits.max_geometries)
        status = validate_type((uint32_t)info->type, info->flags, entry->index, entry->error);
    return status == BVHD_OK
               ? validate_geometry_count((uint32_t)info->type, info->geometryCount, entry->index, &limits, entry->error)
               : status;
}

static enum bvhd_status check_head(const struct input_entry *entry)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = entry->info;
    enum bvhd_status status =
        check_structure_type(entry, BVHD_VUID_BuildGeometryInfo_sType_sType, place("infos[%u].sType", entry->index),
                             info->sType, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR);
    if (status == BVHD_OK)
        status = check_chain(entry, BVHD_VUID_BuildGeometryInfo_pNext_pNext, place("infos[%u].pNext", entry->index),
                             info->pNext);
    if (status == BVHD_OK)
        status = check_geometry_count(entry);
    if (status != BVHD_OK || info->geometryCount == 0)
        return status;
    if ((info->pGeometries != NULL) == (info->ppGeometries != NULL))
        return bvhd_error_rule(entry->error, BVHD_VUID_03788, place("infos[%u].pGeometries", entry->index).text,
                               info->pGeometries
                                   ? "pGeometries and ppGeometries are both set"
                                   : "pGeometries and ppGeometries are both NULL, but geometryCount is %u",
                               info->geometryCount);
    bool is_array = entry->call->ranges != NULL;
    if (is_array && entry->call->ranges[entry->index])
        return BVHD_OK;
    struct place ranges = place("ranges[%u]", entry->index);
    return bvhd_error_rule(entry->error, is_array ? BVHD_VUID_11702 : BVHD_VUID_Build_ppBuildRangeInfos_parameter,
                           ranges.text, "%s is NULL, but geometryCount is %u", is_array ? ranges.text : "ranges",
                           info->geometryCount);
}

/*
 * Returns offset + stride * (count - 1) + size: the bytes that `count` elements need. It returns 0 if there are no
 * elements, if the sum does not fit 64 bits, or if the stride breaks Vulkan's rules: the memory of a program that
 * passes nonsense must not be read at such lengths. is_countable does the same for numbers of primitives.
 */
static uint64_t extent(uint64_t offset, uint64_t stride, uint64_t count, uint64_t size)
{
    uint64_t bytes;
    if (count == 0 || stride > UINT32_MAX || !bytes_mul(stride, count - 1, &bytes) ||
        !bytes_add(bytes, offset, &bytes) || !bytes_add(bytes, size, &bytes))
        return 0;
    return bytes;
}

/* Returns whether a structure can have this many primitives; validate_input refuses others without their data. */
static bool is_countable(const struct geometry_range *range)
{
    return range->primitive_count <= LIMIT_MAX_PRIMITIVES;
}

static struct bytes bytes_at(const void *address, uint64_t size)
{
    return (struct bytes){address, address ? size : 0};
}

static uint64_t element_size(uint32_t format)
{
    const struct vertex_element *element = vertex_element_find(format);
    return element ? element->size : 0;
}

/*
 * With indices, any vertex up to maxVertex may be used, and the array begins at vertex 0; without indices the range
 * says what is read.
 */
static uint64_t vertex_bytes(const VkAccelerationStructureGeometryTrianglesDataKHR *source,
                             const struct geometry_range *range)
{
    uint64_t size = element_size((uint32_t)source->vertexFormat);
    if (range->primitive_count == 0 || !is_countable(range))
        return 0;
    if (source->indexType != VK_INDEX_TYPE_NONE_KHR)
        return extent(0, source->vertexStride, (uint64_t)source->maxVertex + 1, size);
    return extent(range->primitive_offset, source->vertexStride,
                  (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count, size);
}

/* For an unknown index type the size is unknown: nothing is read, and validate_input reports it. */
static uint64_t index_bytes(const VkAccelerationStructureGeometryTrianglesDataKHR *source,
                            const struct geometry_range *range)
{
    uint64_t size = source->indexType == VK_INDEX_TYPE_UINT16 ? 2 : source->indexType == VK_INDEX_TYPE_UINT32 ? 4 : 0;
    return size > 0 && is_countable(range) ? extent(range->primitive_offset, 3 * size, range->primitive_count, 3 * size)
                                           : 0;
}

static struct geometry_triangles convert_triangles(const VkAccelerationStructureGeometryTrianglesDataKHR *source,
                                                   const struct geometry_range *range)
{
    bool indexed = source->indexType != VK_INDEX_TYPE_NONE_KHR;
    return (struct geometry_triangles){
        .vertex_format = (uint32_t)source->vertexFormat,
        .max_vertex = source->maxVertex,
        .vertex_stride = source->vertexStride,
        .index_type = (uint32_t)source->indexType,
        .vertices = bytes_at(source->vertexData.hostAddress, vertex_bytes(source, range)),
        .indices = bytes_at(indexed ? source->indexData.hostAddress : NULL, index_bytes(source, range)),
        .transform = bytes_at(source->transformData.hostAddress,
                              extent(range->transform_offset, 0, 1, sizeof(VkTransformMatrixKHR))),
    };
}

static struct geometry_aabbs convert_aabbs(const VkAccelerationStructureGeometryAabbsDataKHR *source,
                                           const struct geometry_range *range)
{
    uint64_t size = is_countable(range) ? extent(range->primitive_offset, source->stride, range->primitive_count,
                                                 sizeof(VkAabbPositionsKHR))
                                        : 0;
    return (struct geometry_aabbs){source->stride, bytes_at(source->data.hostAddress, size)};
}

/* Copies the records behind the pointers into an array that the entry owns; the range then starts at 0. */
static enum bvhd_status gather(const struct input_entry *entry, const unsigned char *pointers,
                               struct geometry *geometry)
{
    uint32_t count = geometry->range.primitive_count;
    unsigned char *records = memory_array(entry->call->memory, count, RECORD_SIZE);
    if (!records)
        return no_memory(entry);
    entry->owned->records = records;
    pointers += geometry->range.primitive_offset;
    for (uint32_t i = 0; i < count; i++) {
        const void *record;
        memcpy(&record, pointers + i * sizeof record, sizeof record);
        if (!record)
            return bvhd_error_rule(entry->error, BVHD_VUID_03778,
                                   place("infos[%u].geometries[0].instances[%u]", entry->index, i).text,
                                   "the pointer to this instance is NULL");
        memcpy(records + (size_t)i * RECORD_SIZE, record, RECORD_SIZE);
    }
    geometry->range.primitive_offset = 0;
    geometry->instances.records = (struct bytes){records, (uint64_t)count * RECORD_SIZE};
    return BVHD_OK;
}

/*
 * Returns whether records may be read: the description is valid as far as it is needed here. validate_input rejects all
 * others before it reads records.
 */
static bool are_readable(const struct input_entry *entry, const struct geometry *geometry)
{
    return entry->info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR && entry->info->geometryCount == 1 &&
           !(entry->info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV) &&
           geometry->range.primitive_count > 0 && geometry->range.primitive_count <= LIMIT_MAX_INSTANCES &&
           geometry->range.primitive_offset % 16 == 0;
}

static enum bvhd_status convert_instances(const struct input_entry *entry,
                                          const VkAccelerationStructureGeometryInstancesDataKHR *source,
                                          struct geometry *geometry)
{
    const struct geometry_range *range = &geometry->range;
    bool is_possible = range->primitive_count <= LIMIT_MAX_INSTANCES;
    uint64_t size = is_possible ? extent(range->primitive_offset, RECORD_SIZE, range->primitive_count, RECORD_SIZE) : 0;
    /* An array of pointers has no records to read. */
    geometry->instances.records = bytes_at(source->data.hostAddress, source->arrayOfPointers ? 0 : size);
    if (!source->arrayOfPointers || !source->data.hostAddress || !are_readable(entry, geometry))
        return BVHD_OK;
    return gather(entry, source->data.hostAddress, geometry);
}

static enum bvhd_status convert_geometry(const struct input_entry *entry, uint32_t index, struct geometry *geometry)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = entry->info;
    const VkAccelerationStructureGeometryKHR *source =
        info->pGeometries ? &info->pGeometries[index] : info->ppGeometries[index];
    const VkAccelerationStructureBuildRangeInfoKHR *range = &entry->call->ranges[entry->index][index];
    if (!source)
        return bvhd_error_rule(entry->error, BVHD_VUID_BuildGeometryInfo_ppGeometries_parameter,
                               place("infos[%u].ppGeometries[%u]", entry->index, index).text,
                               "ppGeometries[%u] is NULL, but geometryCount is %u", index, info->geometryCount);
    enum bvhd_status status = check_geometry_head(entry, index, source);
    if (status != BVHD_OK)
        return status;
    *geometry = (struct geometry){
        .type = (uint32_t)source->geometryType,
        .flags = source->flags,
        .range = {range->primitiveCount, range->primitiveOffset, range->firstVertex, range->transformOffset},
    };
    if (geometry->type == GEOMETRY_TRIANGLES)
        geometry->triangles = convert_triangles(&source->geometry.triangles, &geometry->range);
    else if (geometry->type == GEOMETRY_AABBS)
        geometry->aabbs = convert_aabbs(&source->geometry.aabbs, &geometry->range);
    else if (geometry->type == GEOMETRY_INSTANCES)
        status = convert_instances(entry, &source->geometry.instances, geometry);
    return status;
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
    const unsigned char *records = geometry->instances.records.data + geometry->range.primitive_offset;
    uint64_t last = 0;
    for (uint32_t i = 0; i < geometry->range.primitive_count; i++) {
        uint64_t handle = bytes_get64(records + (size_t)i * RECORD_SIZE + RECORD_REFERENCE);
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

static enum bvhd_status copy_marked(const struct input_entry *entry, const unsigned char *marks,
                                    struct build_input *description)
{
    const struct input_call *call = entry->call;
    uint32_t count = 0;
    for (uint32_t i = 0; i < call->reference_count; i++)
        count += marks[i];
    if (count == 0)
        return BVHD_OK;
    struct reference *references = memory_array(call->memory, count, sizeof *references);
    if (!references)
        return no_memory(entry);
    entry->owned->references = references;
    description->references = references;
    description->reference_count = count;
    for (uint32_t i = 0; i < call->reference_count; i++)
        if (marks[i])
            *references++ = call->references[i];
    return BVHD_OK;
}

/* Selects the references of a top level that its instances name, so that the description is self-contained. */
static enum bvhd_status select_references(const struct input_entry *entry, struct build_input *description)
{
    const struct geometry *geometry = description->geometries;
    if (description->geometry_count != 1 || geometry->type != GEOMETRY_INSTANCES || !geometry->instances.records.data ||
        !are_readable(entry, geometry))
        return BVHD_OK;
    uint32_t count = entry->call->reference_count;
    unsigned char *marks = memory_alloc(entry->call->memory, (uint64_t)count + 1);
    if (!marks)
        return no_memory(entry);
    memset(marks, 0, (size_t)count + 1);
    enum bvhd_status status = mark_named(entry, geometry, marks);
    if (status == BVHD_OK)
        status = copy_marked(entry, marks, description);
    memory_free(entry->call->memory, marks);
    return status;
}

static enum bvhd_status convert_geometries(const struct input_entry *entry, struct build_input *description)
{
    uint32_t count = entry->info->geometryCount;
    if (count == 0)
        return BVHD_OK;
    struct geometry *geometries = memory_array(entry->call->memory, count, sizeof *geometries);
    if (!geometries)
        return no_memory(entry);
    entry->owned->geometries = geometries;
    description->geometries = geometries;
    description->geometry_count = count;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < count; i++)
        status = convert_geometry(entry, i, &geometries[i]);
    return status;
}

static enum bvhd_status convert_entry(const struct input_entry *entry, struct build_input *ret_description)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = entry->info;
    enum bvhd_status status = check_head(entry);
    if (status != BVHD_OK)
        return status;
    struct build_input description = {
        .type = (uint32_t)info->type,
        .flags = info->flags,
        .mode = (uint32_t)info->mode,
        .destination = (uint64_t)info->dstAccelerationStructure,
        .source = (uint64_t)info->srcAccelerationStructure,
        .options = *entry->call->options,
    };
    status = convert_geometries(entry, &description);
    if (status == BVHD_OK)
        status = select_references(entry, &description);
    if (status == BVHD_OK)
        *ret_description = description;
    return status;
}

static void free_owned(struct entry_memory *owned, struct memory *memory)
{
    memory_free(memory, owned->geometries);
    memory_free(memory, owned->references);
    memory_free(memory, owned->records);
    *owned = (struct entry_memory){0};
}

static void convert_entries(const struct input_call *call, struct vulkan_input *input, struct bvhd_error *ret_errors)
{
    for (uint32_t i = 0; i < call->count; i++) {
        struct input_entry entry = {call, &call->infos[i], i, &input->owned[i], &ret_errors[i]};
        ret_errors[i] = (struct bvhd_error){.status = BVHD_OK};
        if (convert_entry(&entry, &input->entries[i]) != BVHD_OK)
            free_owned(&input->owned[i], call->memory);
    }
}

/* Makes sorted tables of all references and of all destinations; false without memory. */
static bool sort_handles(struct input_call *call)
{
    uint32_t references = call->reference_count, count = call->count;
    call->known = memory_array(call->memory, (uint64_t)references + 1, 2 * sizeof *call->known);
    call->destinations = memory_array(call->memory, (uint64_t)count + 1, 2 * sizeof *call->destinations);
    if (!call->known || !call->destinations)
        return false;
    for (uint32_t i = 0; i < references; i++)
        call->known[i] = (struct handle_entry){call->references[i].handle, i};
    for (uint32_t i = 0; i < count; i++)
        call->destinations[i] = (struct handle_entry){(uint64_t)call->infos[i].dstAccelerationStructure, i};
    handle_sort(call->known, call->known + references, references);
    handle_sort(call->destinations, call->destinations + count, count);
    return true;
}

/* Makes an input with `count` empty entries; NULL without memory. */
static struct vulkan_input *make_empty(struct memory *memory, uint32_t count)
{
    struct vulkan_input *input = memory_alloc(memory, sizeof *input);
    if (!input)
        return NULL;
    *input = (struct vulkan_input){.memory = memory, .count = count};
    input->entries = memory_array(memory, (uint64_t)count + 1, sizeof *input->entries);
    input->owned = memory_array(memory, (uint64_t)count + 1, sizeof *input->owned);
    if (!input->entries || !input->owned) {
        input->count = 0;
        vulkan_input_destroy(input);
        return NULL;
    }
    memset(input->entries, 0, count * sizeof *input->entries);
    memset(input->owned, 0, count * sizeof *input->owned);
    return input;
}

enum bvhd_status vulkan_input_create_in(struct memory *memory, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                        uint32_t count, const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                        const struct reference *references, uint32_t reference_count,
                                        const struct build_options *options, struct vulkan_input **ret_input,
                                        struct bvhd_error *ret_errors)
{
    struct input_call call = {infos, count, ranges, references, reference_count, options, memory, NULL, NULL};
    struct vulkan_input *input = make_empty(memory, count);
    bool ready = input && sort_handles(&call);
    if (ready)
        convert_entries(&call, input, ret_errors);
    memory_free(memory, call.known);
    memory_free(memory, call.destinations);
    if (ready)
        *ret_input = input;
    else
        vulkan_input_destroy(input);
    return ready ? BVHD_OK : BVHD_NO_MEMORY;
}

enum bvhd_status vulkan_input_create(const VkAccelerationStructureBuildGeometryInfoKHR *infos, uint32_t count,
                                     const VkAccelerationStructureBuildRangeInfoKHR *const *ranges,
                                     const struct reference *references, uint32_t reference_count,
                                     const struct build_options *options, struct vulkan_input **ret_input,
                                     struct bvhd_error *ret_errors)
{
    static struct memory unlimited = {.limit = UINT64_MAX, .fail_after = -1};
    return vulkan_input_create_in(&unlimited, infos, count, ranges, references, reference_count, options, ret_input,
                                  ret_errors);
}

const struct build_input *vulkan_input_entries(const struct vulkan_input *input)
{
    return input->entries;
}

bool vulkan_input_own_records(struct vulkan_input *input, uint32_t entry)
{
    struct entry_memory *owned = &input->owned[entry];
    if (owned->records)
        return true;
    struct geometry *geometry = owned->geometries;
    uint64_t size = (uint64_t)geometry->range.primitive_count * RECORD_SIZE;
    owned->records = memory_alloc(input->memory, size);
    if (!owned->records)
        return false;
    memcpy(owned->records, geometry->instances.records.data + geometry->range.primitive_offset, size);
    geometry->range.primitive_offset = 0;
    geometry->instances.records = (struct bytes){owned->records, size};
    return true;
}

void vulkan_input_set_source_key(struct vulkan_input *input, uint32_t entry, const struct key *key)
{
    input->entries[entry].source_key = *key;
}

void vulkan_input_complete_reference(struct vulkan_input *input, uint32_t entry, uint32_t slot,
                                     const struct reference *reference)
{
    input->owned[entry].references[slot] = *reference;
}

void vulkan_input_destroy(struct vulkan_input *input)
{
    if (!input)
        return;
    struct memory *memory = input->memory;
    for (uint32_t i = 0; i < input->count; i++)
        free_owned(&input->owned[i], memory);
    memory_free(memory, input->owned);
    memory_free(memory, input->entries);
    memory_free(memory, input);
}

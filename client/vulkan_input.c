/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input.h"

#include "client/vulkan_input_micromap.h"
#include "proto/base/place.h"
#include "proto/base/request_limits.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vulkan_name.h"

/*
 * pNext structs that Vulkan allows but bvhd does not support. The types are numbers, because installed headers are
 * often older than these extensions.
 */
static const struct {
    uint32_t type;
    const char *name;
} foreign_structs[] = {
    {1000396009, "an opacity micromap"}, {1000397002, "a displacement micromap"},
    {1000478001, "dense geometry"},      {1000623002, "micromap data"},
    {1000623003, "an opacity micromap"}, {0x40000003, "a baked opacity micromap"},
};

static enum bvhd_status refuse_struct(const struct input_entry *entry, enum bvhd_vuid vuid, struct place where,
                                      VkStructureType type)
{
    for (size_t i = 0; i < sizeof foreign_structs / sizeof foreign_structs[0]; i++)
        if ((uint32_t)type == foreign_structs[i].type)
            return bvhd_error_set(entry->error, BVHD_UNSUPPORTED, where.text, "%s is not supported",
                                  foreign_structs[i].name);
    return bvhd_error_rule(entry->error, vuid, where.text, "a struct whose sType is %s does not belong here",
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)type).text);
}

static enum bvhd_status check_chain(const struct input_entry *entry, enum bvhd_vuid vuid, struct place where,
                                    const void *chain)
{
    return chain ? refuse_struct(entry, vuid, where, ((const VkBaseInStructure *)chain)->sType) : BVHD_OK;
}

static enum bvhd_status refuse_second(const struct input_entry *entry, enum bvhd_vuid vuid, struct place where,
                                      VkStructureType type)
{
    return bvhd_error_rule(entry->error, vuid, where.text, "%s is there twice",
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)type).text);
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

/* Returns how the data of a kind is found in chains; NULL if it is not there, or while micromaps are refused. */
static const struct vulkan_input_kind *chained_at(enum kind_number number)
{
    const struct vulkan_input_kind *kind = vulkan_input_kind_at(number);
    const bool is_refused = number >= KIND_OF_RAYS && !validate_micromaps;
    return kind && kind->is_chained && !is_refused ? kind : NULL;
}

/* Returns the kind whose struct is in chains with this sType; KIND_COUNT if there is none. */
static enum kind_number chained_kind(VkStructureType type)
{
    enum kind_number number = 0;
    while (number < KIND_COUNT && !(chained_at(number) && chained_at(number)->head == type))
        number++;
    return number;
}

/*
 * Checks the chain of geometry `index`, and finds the structs of kinds in it. Those of other kinds than the geometry's
 * are legal and mean nothing. The walk ends, because no struct may be there twice.
 */
static enum bvhd_status read_chain(const struct input_entry *entry, uint32_t index, const void *chain,
                                   const void *ret_data[KIND_COUNT])
{
    for (const VkBaseInStructure *link = chain; link; link = link->pNext) {
        const enum kind_number number = chained_kind(link->sType);
        struct place where = place("infos[%u].geometries[%u].pNext", entry->index, index);
        if (number == KIND_COUNT)
            return refuse_struct(entry, BVHD_VUID_Geometry_pNext_pNext, where, link->sType);
        if (ret_data[number])
            return refuse_second(entry, BVHD_VUID_Geometry_sType_unique, where, link->sType);
        ret_data[number] = link;
    }
    return BVHD_OK;
}

/*
 * Returns which of the structs that the chain of a kind's data may have this sType is of, as a bit; 0 for one that does
 * not belong there.
 */
static unsigned extension_bit(const struct vulkan_input_kind *kind, VkStructureType type)
{
    const VkStructureType types[] = {kind->end, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_EXT,
                                     VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_KHR};
    const unsigned first = kind->end ? 0 : 1;
    const unsigned count = kind->has_micromaps && validate_micromaps ? sizeof types / sizeof *types : 1;
    for (unsigned i = first; i < count; i++)
        if (type == types[i])
            return 1u << i;
    return 0;
}

/*
 * Checks the chain of the data of geometry `index`, in which each struct may be once. The walk ends, because a struct
 * that comes again is refused.
 */
static enum bvhd_status check_data_chain(const struct input_entry *entry, uint32_t index, const struct kind *kind,
                                         const VkBaseInStructure *head)
{
    const struct vulkan_input_kind *input_kind = vulkan_input_kind_at(kind->number);
    const struct place where = place("infos[%u].geometries[%u].%s.pNext", entry->index, index, kind->member);
    unsigned seen = 0;
    for (const VkBaseInStructure *link = head->pNext; link; link = link->pNext) {
        const unsigned bit = extension_bit(input_kind, link->sType);
        if (bit == 0)
            return refuse_struct(entry, input_kind->chain_rule, where, link->sType);
        if (seen & bit)
            return refuse_second(entry, input_kind->unique_rule, where, link->sType);
        seen |= bit;
    }
    return BVHD_OK;
}

/* Checks sType and pNext of the data of geometry `index`. */
static enum bvhd_status check_data_head(const struct input_entry *entry, uint32_t index, const struct kind *kind,
                                        const VkBaseInStructure *head)
{
    const struct vulkan_input_kind *input_kind = vulkan_input_kind_at(kind->number);
    enum bvhd_status status = check_structure_type(
        entry, input_kind->type_rule, place("infos[%u].geometries[%u].%s.sType", entry->index, index, kind->member),
        head->sType, input_kind->head);
    return status == BVHD_OK ? check_data_chain(entry, index, kind, head) : status;
}

static enum bvhd_status refuse_missing(const struct input_entry *entry, uint32_t index, const struct kind *kind)
{
    const struct vulkan_input_kind *input_kind = vulkan_input_kind_at(kind->number);
    return bvhd_error_rule(entry->error, input_kind->type_rule,
                           place("infos[%u].geometries[%u].pNext", entry->index, index).text,
                           "geometryType is %s, but no struct in the chain has the sType %s",
                           vulkan_name(VULKAN_GEOMETRY_TYPE, kind->type).text,
                           vulkan_name(VULKAN_STRUCTURE_TYPE, (uint32_t)input_kind->head).text);
}

/*
 * Returns the kind of a geometry whose type is Vulkan's of `kind`, which does not move. Instances move in a top level
 * that does, and others if the chain of their data, which has been checked, says where they are at t = 1.
 */
static const struct kind *find_moving(const struct input_entry *entry, const struct kind *kind, const void *data)
{
    const VkStructureType end = vulkan_input_kind_at(kind->number)->end;
    const bool has_end = end && vulkan_input_find(data, end);
    const bool moves = kind->is_top ? (entry->info->flags & BUILD_MOTION) != 0 : has_end;
    return moves ? kind_find_vulkan(kind->vulkan_type, true) : kind;
}

/*
 * Finds how a micromap is described: by its states, or by the texture that decides them. Kinds that are refused are
 * left to validate_input.
 */
static enum bvhd_status choose_micromap(const struct input_entry *entry, uint32_t index,
                                        const void *const chained[KIND_COUNT], const struct kind **kind)
{
    if (!validate_micromaps)
        *kind = NULL;
    else if (chained[KIND_BAKED_MICROMAP] && chained[KIND_MICROMAP])
        return bvhd_error_set(entry->error, BVHD_INVALID,
                              place("infos[%u].geometries[%u].pNext", entry->index, index).text,
                              "a micromap has its states or is baked, not both");
    else if (chained[KIND_BAKED_MICROMAP])
        *kind = kind_find(GEOMETRY_BAKED_MICROMAP);
    return BVHD_OK;
}

/*
 * Checks the geometry's head, and finds its kind and the struct with its data. Both are NULL if the type is one that
 * validate_input refuses.
 */
static enum bvhd_status find_data(const struct input_entry *entry, uint32_t index,
                                  const VkAccelerationStructureGeometryKHR *source, const struct kind **ret_kind,
                                  const void **ret_data)
{
    const struct kind *kind = kind_find_vulkan((uint32_t)source->geometryType, false);
    const void *chained[KIND_COUNT] = {NULL};
    enum bvhd_status status = check_structure_type(
        entry, BVHD_VUID_Geometry_sType_sType, place("infos[%u].geometries[%u].sType", entry->index, index),
        source->sType, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR);
    if (status == BVHD_OK)
        status = read_chain(entry, index, source->pNext, chained);
    if (status == BVHD_OK && kind && kind->is_micromap)
        status = choose_micromap(entry, index, chained, &kind);
    if (status != BVHD_OK || !kind || !vulkan_input_kind_at(kind->number))
        return status;
    const bool is_chained = vulkan_input_kind_at(kind->number)->is_chained;
    const void *data = is_chained ? chained[kind->number] : &source->geometry;
    if (!data)
        return refuse_missing(entry, index, kind);
    if (!is_chained)
        status = check_data_head(entry, index, kind, data);
    if (status != BVHD_OK)
        return status;
    *ret_kind = kind->is_micromap ? kind : find_moving(entry, kind, data);
    *ret_data = data;
    return BVHD_OK;
}

/* Refuses the numbers of bvhd's own types, which a description may have and a program may not. */
static enum bvhd_status refuse_own_type(const struct input_entry *entry, uint32_t index, uint32_t type)
{
    return bvhd_error_rule(entry->error, BVHD_VUID_Geometry_geometryType_parameter,
                           place("infos[%u].geometries[%u].geometryType", entry->index, index).text,
                           "geometryType is %u, which is no VkGeometryTypeKHR", type);
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

/* Micromaps say themselves how many triangles they have. */
static bool has_no_ranges(const VkAccelerationStructureBuildGeometryInfoKHR *info)
{
    return (uint32_t)info->type == STRUCTURE_MICROMAP;
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
    if (has_no_ranges(info))
        return BVHD_OK;
    bool is_array = entry->call->ranges != NULL;
    if (is_array && entry->call->ranges[entry->index])
        return BVHD_OK;
    struct place ranges = place("ranges[%u]", entry->index);
    return bvhd_error_rule(entry->error, is_array ? BVHD_VUID_11702 : BVHD_VUID_Build_ppBuildRangeInfos_parameter,
                           ranges.text, "%s is NULL, but geometryCount is %u", is_array ? ranges.text : "ranges",
                           info->geometryCount);
}

static enum bvhd_status convert_geometry(const struct input_entry *entry, uint32_t index, struct geometry *geometry)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = entry->info;
    const VkAccelerationStructureGeometryKHR *source =
        info->pGeometries ? &info->pGeometries[index] : info->ppGeometries[index];
    static const VkAccelerationStructureBuildRangeInfoKHR none;
    const VkAccelerationStructureBuildRangeInfoKHR *range =
        has_no_ranges(info) ? &none : &entry->call->ranges[entry->index][index];
    if (!source)
        return bvhd_error_rule(entry->error, BVHD_VUID_BuildGeometryInfo_ppGeometries_parameter,
                               place("infos[%u].ppGeometries[%u]", entry->index, index).text,
                               "ppGeometries[%u] is NULL, but geometryCount is %u", index, info->geometryCount);
    const struct kind *kind = NULL;
    const void *data = NULL;
    enum bvhd_status status = find_data(entry, index, source, &kind, &data);
    const struct kind *own = kind_find((uint32_t)source->geometryType);
    if (status == BVHD_OK && !kind && own && own->vulkan_type != own->type)
        status = refuse_own_type(entry, index, (uint32_t)source->geometryType);
    if (status != BVHD_OK)
        return status;
    *geometry = (struct geometry){
        .type = kind ? kind->type : (uint32_t)source->geometryType,
        .flags = source->flags,
        .range = {range->primitiveCount, range->primitiveOffset, range->firstVertex, range->transformOffset},
    };
    return kind ? vulkan_input_kind_at(kind->number)->convert(entry, data, geometry) : BVHD_OK;
}

static enum bvhd_status convert_geometries(const struct input_entry *entry, struct build_input *description)
{
    uint32_t count = entry->info->geometryCount;
    if (count == 0)
        return BVHD_OK;
    struct geometry *geometries = memory_array(entry->call->memory, count, sizeof *geometries);
    if (!geometries)
        return vulkan_input_no_memory(entry);
    entry->owned->geometries = geometries;
    description->geometries = geometries;
    description->geometry_count = count;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < count; i++)
        status = convert_geometry(entry, i, &geometries[i]);
    return status == BVHD_OK ? vulkan_input_select_micromaps(entry) : status;
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
    if (status != BVHD_OK)
        return status;
    description.references = entry->owned->references;
    description.reference_count = entry->owned->reference_count;
    *ret_description = description;
    return BVHD_OK;
}

static void free_owned(struct entry_memory *owned, struct memory *memory)
{
    memory_free(memory, owned->geometries);
    memory_free(memory, owned->references);
    memory_free(memory, owned->records);
    for (uint32_t i = 0; i < owned->usages_count; i++)
        memory_free(memory, owned->usages[i]);
    memory_free(memory, owned->usages);
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

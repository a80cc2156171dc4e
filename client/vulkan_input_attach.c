/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_micromap.h"
#include "proto/base/place.h"

_Static_assert(sizeof(VkAccelerationStructureTrianglesOpacityMicromapEXT) == 72 &&
                   sizeof(VkAccelerationStructureTrianglesOpacityMicromapKHR) == 56,
               "Vulkan's structs");

static struct place place_of(const struct input_entry *entry, const struct geometry *geometry, const char *field)
{
    return place("infos[%u].geometries[%u].triangles.micromap.%s", entry->index,
                 (uint32_t)(geometry - entry->owned->geometries), field);
}

/* Returns 0 for a type that indices of micromaps cannot have: nothing is read then, and validate_input reports it. */
static uint64_t index_size(uint32_t type)
{
    switch (type) {
    case INDEX_UINT8:
        return 1;
    case INDEX_UINT16:
        return 2;
    case INDEX_UINT32:
        return 4;
    default:
        return 0;
    }
}

/* Finds the indices, one for each primitive of the geometry; none with INDEX_NONE. */
static struct bytes find_indices(const struct triangle_micromap *micromap, const void *address,
                                 const struct geometry_range *range)
{
    const uint64_t size = index_size(micromap->index_type);
    if (size == 0 || !vulkan_input_is_countable(range))
        return (struct bytes){size > 0 ? address : NULL, 0};
    return vulkan_input_bytes(address, vulkan_input_extent(0, micromap->stride, range->primitive_count, size));
}

/* Both extensions have these rules, under different numbers. */
struct rules {
    enum bvhd_vuid missing, needless;
};

static const struct rules ext_rules = {BVHD_VUID_11821, BVHD_VUID_10892};
static const struct rules khr_rules = {BVHD_VUID_11572, BVHD_VUID_11571};

static enum bvhd_status check_indices(const struct input_entry *entry, const struct geometry *geometry,
                                      const struct rules *rules, VkIndexType type, const void *address)
{
    const bool has_indices = type != VK_INDEX_TYPE_NONE_KHR;
    if (has_indices == (address != NULL))
        return BVHD_OK;
    return bvhd_error_rule(entry->error, has_indices ? rules->missing : rules->needless,
                           place_of(entry, geometry, "indexBuffer").text,
                           has_indices ? "indexBuffer is NULL, but indexType is not NONE"
                                       : "indexBuffer is not NULL, but indexType is NONE");
}

static enum bvhd_status attach_ext(const struct input_entry *entry,
                                   const VkAccelerationStructureTrianglesOpacityMicromapEXT *from,
                                   struct geometry *geometry)
{
    const struct usage_source usages = {
        .count = from->usageCountsCount,
        .array = from->pUsageCounts,
        .pointers = (const void *const *)from->ppUsageCounts,
        .member = "triangles.micromap",
        .both_rule = BVHD_VUID_07335,
        .pointer_rule = BVHD_VUID_OpacityMicromapEXT_ppUsageCounts_parameter,
    };
    struct triangle_micromap micromap = {
        .is_given = 1,
        .index_type = (uint32_t)from->indexType,
        .stride = from->indexStride,
        .base_triangle = from->baseTriangle,
        .has_usages = 1,
        .micromap = (uint64_t)from->micromap,
    };
    const void *address = from->indexBuffer.hostAddress;
    enum bvhd_status status = check_indices(entry, geometry, &ext_rules, from->indexType, address);
    if (status == BVHD_OK)
        status = vulkan_input_copy_usages(entry, geometry, &usages, &micromap.usages);
    micromap.indices = find_indices(&micromap, address, &geometry->range);
    geometry->triangles.micromap = micromap;
    return status;
}

/* A host build takes no micromap in this form, but special indices. */
static enum bvhd_status attach_khr(const struct input_entry *entry,
                                   const VkAccelerationStructureTrianglesOpacityMicromapKHR *from,
                                   struct geometry *geometry)
{
    if (from->micromap)
        return bvhd_error_rule(entry->error, BVHD_VUID_11705, place_of(entry, geometry, "micromap").text,
                               "a host build has micromaps in the struct of VK_EXT_opacity_micromap only");
    struct triangle_micromap micromap = {
        .is_given = 1,
        .index_type = (uint32_t)from->indexType,
        .stride = from->indexStride,
        .base_triangle = from->baseTriangle,
    };
    const void *address = (const void *)(uintptr_t)from->indexBuffer;
    enum bvhd_status status = check_indices(entry, geometry, &khr_rules, from->indexType, address);
    micromap.indices = find_indices(&micromap, address, &geometry->range);
    geometry->triangles.micromap = micromap;
    return status;
}

enum bvhd_status vulkan_input_attach(const struct input_entry *entry,
                                     const VkAccelerationStructureGeometryTrianglesDataKHR *triangles,
                                     struct geometry *geometry)
{
    const VkBaseInStructure *ext =
        vulkan_input_find(triangles, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_EXT);
    const VkBaseInStructure *khr =
        vulkan_input_find(triangles, VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_KHR);
    if (ext && khr)
        return bvhd_error_set(entry->error, BVHD_INVALID,
                              place("infos[%u].geometries[%u].triangles.pNext", entry->index,
                                    (uint32_t)(geometry - entry->owned->geometries))
                                  .text,
                              "triangles have the opacity micromap of one extension, not of both");
    if (ext)
        return attach_ext(entry, (const VkAccelerationStructureTrianglesOpacityMicromapEXT *)ext, geometry);
    if (khr)
        return attach_khr(entry, (const VkAccelerationStructureTrianglesOpacityMicromapKHR *)khr, geometry);
    return BVHD_OK;
}

/* Returns the number among the call's references of the micromap that a geometry names; HANDLE_NONE for none. */
static uint32_t find_micromap(const struct input_call *call, const struct geometry *geometry)
{
    const struct kind *kind = kind_find(geometry->type);
    const bool is_triangles = kind && kind->vulkan_type == GEOMETRY_TRIANGLES;
    const uint64_t handle = is_triangles ? geometry->triangles.micromap.micromap : 0;
    const uint32_t at = handle ? handle_find(call->known, call->reference_count, handle) : HANDLE_NONE;
    return at != HANDLE_NONE ? call->known[at].number : HANDLE_NONE;
}

static enum bvhd_status mark_micromaps(const struct input_entry *entry, unsigned char *marks)
{
    const struct input_call *call = entry->call;
    for (uint32_t i = 0; i < entry->info->geometryCount; i++) {
        const struct geometry *geometry = &entry->owned->geometries[i];
        const uint32_t number = find_micromap(call, geometry);
        if (number == HANDLE_NONE)
            continue;
        if (!call->references[number].has_key)
            return bvhd_error_set(entry->error, BVHD_INVALID, place_of(entry, geometry, "micromap").text,
                                  "the reference with this handle has no key, by which a micromap is found");
        marks[number] = 1;
    }
    return BVHD_OK;
}

/* All that matters of a reference to a micromap. */
static struct reference micromap_reference(const struct reference *given)
{
    return (struct reference){
        .kind = REFERENCE_MICROMAP, .handle = given->handle, .has_key = true, .key = given->key, .bounds = box_empty()};
}

/* Returns whether any geometry of the entry names a reference as its micromap: most entries do not. */
static bool names_micromaps(const struct input_entry *entry)
{
    bool names = false;
    for (uint32_t i = 0; !names && i < entry->info->geometryCount; i++)
        names = find_micromap(entry->call, &entry->owned->geometries[i]) != HANDLE_NONE;
    return names;
}

enum bvhd_status vulkan_input_select_micromaps(const struct input_entry *entry)
{
    const struct input_call *call = entry->call;
    if (entry->info->type != VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR || !names_micromaps(entry))
        return BVHD_OK;
    unsigned char *marks = memory_alloc(call->memory, (uint64_t)call->reference_count + 1);
    if (!marks)
        return vulkan_input_no_memory(entry);
    memset(marks, 0, (size_t)call->reference_count + 1);
    enum bvhd_status status = mark_micromaps(entry, marks);
    if (status == BVHD_OK)
        status = vulkan_input_copy_marked(entry, marks);
    memory_free(call->memory, marks);
    for (uint32_t i = 0; status == BVHD_OK && i < entry->owned->reference_count; i++)
        entry->owned->references[i] = micromap_reference(&entry->owned->references[i]);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_kind.h"

#include "proto/base/place.h"
#include "proto/base/request_limits.h"

const struct vulkan_input_kind *vulkan_input_kind_at(enum kind_number number)
{
    static const struct vulkan_input_kind *const kinds[KIND_COUNT] = {
        [KIND_TRIANGLES] = &vulkan_input_triangles,
        [KIND_AABBS] = &vulkan_input_aabbs,
        [KIND_INSTANCES] = &vulkan_input_instances,
        [KIND_SPHERES] = &vulkan_input_spheres,
        [KIND_SWEPT_SPHERES] = &vulkan_input_swept_spheres,
        [KIND_MOVING_TRIANGLES] = &vulkan_input_moving_triangles,
        [KIND_MOVING_INSTANCES] = &vulkan_input_moving_instances,
        [KIND_MICROMAP] = &vulkan_input_micromap,
        [KIND_BAKED_MICROMAP] = &vulkan_input_baked_micromap,
    };
    return kinds[number];
}

uint64_t vulkan_input_index_extent(uint64_t offset, uint64_t stride, uint64_t count, uint64_t size)
{
    uint64_t bytes;
    if (count == 0 || !bytes_mul(stride, count - 1, &bytes) || !bytes_add(bytes, offset, &bytes) ||
        !bytes_add(bytes, size, &bytes))
        return 0;
    return bytes;
}

uint64_t vulkan_input_extent(uint64_t offset, uint64_t stride, uint64_t count, uint64_t size)
{
    return stride <= UINT32_MAX ? vulkan_input_index_extent(offset, stride, count, size) : 0;
}

bool vulkan_input_is_countable(const struct geometry_range *range)
{
    return range->primitive_count <= LIMIT_MAX_PRIMITIVES;
}

struct bytes vulkan_input_bytes(const void *address, uint64_t size)
{
    return (struct bytes){address, address ? size : 0};
}

const VkBaseInStructure *vulkan_input_find(const void *head, VkStructureType type)
{
    const VkBaseInStructure *link = ((const VkBaseInStructure *)head)->pNext;
    while (link && link->sType != type)
        link = link->pNext;
    return link;
}

enum bvhd_status vulkan_input_copy_marked(const struct input_entry *entry, const unsigned char *marks)
{
    const struct input_call *call = entry->call;
    uint32_t count = 0;
    for (uint32_t i = 0; i < call->reference_count; i++)
        count += marks[i];
    if (count == 0)
        return BVHD_OK;
    struct reference *references = memory_array(call->memory, count, sizeof *references);
    if (!references)
        return vulkan_input_no_memory(entry);
    entry->owned->references = references;
    entry->owned->reference_count = count;
    for (uint32_t i = 0; i < call->reference_count; i++)
        if (marks[i])
            *references++ = call->references[i];
    return BVHD_OK;
}

enum bvhd_status vulkan_input_no_memory(const struct input_entry *entry)
{
    return bvhd_error_no_memory(entry->error, place("infos[%u]", entry->index).text, "no memory for the description");
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_micromap.h"
#include "proto/base/place.h"

_Static_assert(sizeof(VkMicromapUsageKHR) == sizeof(struct micromap_usage), "usage counts are copied as they are");

static struct place place_of(const struct input_entry *entry, uint32_t index, const struct usage_source *source,
                             const char *field)
{
    return place("infos[%u].geometries[%u].%s.%s", entry->index, index, source->member, field);
}

/* Checks that the usage counts are given once. */
static enum bvhd_status check_forms(const struct input_entry *entry, uint32_t index, const struct usage_source *source)
{
    const struct place where = place_of(entry, index, source, "pUsageCounts");
    if (source->array && source->pointers)
        return bvhd_error_rule(entry->error, source->both_rule, where.text,
                               "pUsageCounts and ppUsageCounts are both set");
    if (source->count > 0 && !source->array && !source->pointers)
        return bvhd_error_set(entry->error, BVHD_INVALID, where.text,
                              "pUsageCounts and ppUsageCounts are both NULL, but usageCountsCount is %u",
                              source->count);
    return BVHD_OK;
}

/* Makes room for `count` usage counts of a geometry; NULL without memory. */
static unsigned char *make_room(const struct input_entry *entry, uint32_t index, uint32_t count)
{
    struct entry_memory *owned = entry->owned;
    if (!owned->usages) {
        const uint32_t geometries = entry->info->geometryCount;
        owned->usages = memory_array(entry->call->memory, geometries, sizeof *owned->usages);
        if (!owned->usages)
            return NULL;
        memset(owned->usages, 0, geometries * sizeof *owned->usages);
        owned->usages_count = geometries;
    }
    owned->usages[index] = memory_array(entry->call->memory, count, sizeof(struct micromap_usage));
    return owned->usages[index];
}

static enum bvhd_status gather(const struct input_entry *entry, uint32_t index, const struct usage_source *source,
                               unsigned char *ret_usages)
{
    const size_t size = sizeof(struct micromap_usage);
    for (uint32_t i = 0; i < source->count; i++) {
        if (!source->pointers[i])
            return bvhd_error_rule(entry->error, source->pointer_rule,
                                   place_of(entry, index, source, place("ppUsageCounts[%u]", i).text).text,
                                   "ppUsageCounts[%u] is NULL, but usageCountsCount is %u", i, source->count);
        memcpy(ret_usages + i * size, source->pointers[i], size);
    }
    return BVHD_OK;
}

enum bvhd_status vulkan_input_copy_usages(const struct input_entry *entry, const struct geometry *geometry,
                                          const struct usage_source *source, struct bytes *ret_usages)
{
    const uint32_t index = (uint32_t)(geometry - entry->owned->geometries);
    enum bvhd_status status = check_forms(entry, index, source);
    if (status != BVHD_OK || source->count == 0)
        return status;
    unsigned char *usages = make_room(entry, index, source->count);
    if (!usages)
        return vulkan_input_no_memory(entry);
    const uint64_t size = (uint64_t)source->count * sizeof(struct micromap_usage);
    if (source->array)
        memcpy(usages, source->array, size);
    else
        status = gather(entry, index, source, usages);
    *ret_usages = (struct bytes){usages, size};
    return status;
}

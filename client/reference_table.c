/* SPDX-License-Identifier: Apache-2.0 */
#include "client/reference_table.h"

#include <inttypes.h>

#include "client/reference.h"
#include "proto/base/place.h"

static uint64_t destination_of(const VkAccelerationStructureBuildGeometryInfoKHR *info)
{
    return (uint64_t)info->dstAccelerationStructure;
}

/* Returns whether instances of other infos may name what this info builds. */
static bool is_nameable(const VkAccelerationStructureBuildGeometryInfoKHR *info)
{
    return info->type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR && destination_of(info) != 0;
}

static enum bvhd_status invalid(uint32_t number, const char *field, const char *text, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INVALID, place("build.references[%u].%s", number, field).text, "%s", text);
}

static bool is_finite(const float *numbers, int count)
{
    for (int i = 0; i < count; i++)
        if (!__builtin_isfinite(numbers[i]))
            return false;
    return true;
}

static enum bvhd_status check_reference(const struct bvhd_reference *reference, uint32_t number,
                                        struct bvhd_error *error)
{
    struct slabs slabs;
    memcpy(&slabs, reference->slabs, sizeof slabs);
    if (reference->handle == 0)
        return invalid(number, "handle", "the handle is 0, which names nothing", error);
    if (!is_finite(reference->bounds, 6))
        return invalid(number, "bounds", "a number of the bounds is not finite", error);
    if (!slabs_are_valid(&slabs))
        return invalid(number, "slabs", "a number of the slabs is not finite, or a minimum is over its maximum", error);
    if (!reference_is_bounded(reference) && !reference->has_key)
        return invalid(number, "bounds", "the bounds are all 0, and there is no key by which they could be found",
                       error);
    return BVHD_OK;
}

/* Equal handles are adjacent, those of the build's own references first: the sort is stable. */
static enum bvhd_status check_handles(const struct reference_table *table, struct bvhd_error *error)
{
    const struct handle_entry *handles = table->handles;
    for (uint32_t i = 1; i < table->count; i++) {
        uint32_t first = handles[i - 1].number, second = handles[i].number;
        if (handles[i].handle != handles[i - 1].handle || first >= table->given)
            continue;
        if (second < table->given)
            return bvhd_error_set(error, BVHD_INVALID, place("build.references[%u].handle", second).text,
                                  "0x%" PRIx64 " is the handle of references[%u], too", handles[i].handle, first);
        return bvhd_error_set(error, BVHD_INVALID, place("build.references[%u].handle", first).text,
                              "0x%" PRIx64 " is the dstAccelerationStructure of infos[%u], too", handles[i].handle,
                              table->infos[second - table->given]);
    }
    return BVHD_OK;
}

/* Every info's own destination counts here, that of a top level too: the handle of a reference must be none of them. */
static enum bvhd_status check_destinations(const struct reference_table *table, struct bvhd_error *error)
{
    for (uint32_t i = 0; i < table->build->info_count; i++) {
        const VkAccelerationStructureBuildGeometryInfoKHR *info = &table->build->infos[i];
        uint32_t at = handle_find(table->handles, table->count, destination_of(info));
        if (!is_nameable(info) && at != HANDLE_NONE && table->handles[at].number < table->given)
            return bvhd_error_set(
                error, BVHD_INVALID, place("build.references[%u].handle", table->handles[at].number).text,
                "0x%" PRIx64 " is the dstAccelerationStructure of infos[%u], too", destination_of(info), i);
    }
    return BVHD_OK;
}

static void fill(struct reference_table *table)
{
    const struct bvhd_build *build = table->build;
    table->given = build->reference_count;
    for (uint32_t i = 0; i < build->reference_count; i++)
        table->references[i] = reference_convert(&build->references[i]);
    uint32_t count = table->given;
    for (uint32_t i = 0; i < build->info_count; i++) {
        if (!is_nameable(&build->infos[i]))
            continue;
        table->infos[count - table->given] = i;
        table->references[count++] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = destination_of(&build->infos[i])};
    }
    table->count = count;
    for (uint32_t i = 0; i < count; i++)
        table->handles[i] = (struct handle_entry){table->references[i].handle, i};
    handle_sort(table->handles, table->handles + count, count);
}

static uint64_t count_nameable(const struct bvhd_build *build)
{
    uint64_t count = 0;
    for (uint32_t i = 0; i < build->info_count; i++)
        count += is_nameable(&build->infos[i]);
    return count;
}

enum bvhd_status reference_table_make(const struct bvhd_build *build, struct memory *memory,
                                      struct reference_table *ret_table, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < build->reference_count; i++)
        status = check_reference(&build->references[i], i, error);
    if (status != BVHD_OK)
        return status;
    uint64_t nameable = count_nameable(build), count = build->reference_count + nameable;
    struct reference_table table = {.build = build};
    table.references = memory_array(memory, count + 1, sizeof *table.references);
    table.handles = memory_array(memory, count + 1, 2 * sizeof *table.handles);
    table.infos = memory_array(memory, nameable + 1, sizeof *table.infos);
    if (table.references && table.handles && table.infos && count < UINT32_MAX) {
        fill(&table);
        status = check_handles(&table, error);
        if (status == BVHD_OK)
            status = check_destinations(&table, error);
    } else {
        status = bvhd_error_no_memory(error, "batch", "no memory for it");
    }
    if (status == BVHD_OK)
        *ret_table = table;
    else
        reference_table_finish(&table, memory);
    return status;
}

void reference_table_finish(struct reference_table *table, struct memory *memory)
{
    memory_free(memory, table->references);
    memory_free(memory, table->handles);
    memory_free(memory, table->infos);
    *table = (struct reference_table){0};
}

uint32_t reference_table_find(const struct reference_table *table, uint64_t handle)
{
    return table->handles[handle_find(table->handles, table->count, handle)].number;
}

bool reference_table_lacks_bounds(const struct reference_table *table, uint32_t number)
{
    return number < table->given && !reference_is_bounded(&table->build->references[number]);
}

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

static bool is_update_in_place(const VkAccelerationStructureBuildGeometryInfoKHR *info)
{
    return info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR &&
           info->srcAccelerationStructure == info->dstAccelerationStructure;
}

static void sort_handles(struct reference_table *table)
{
    for (uint32_t i = 0; i < table->count; i++)
        table->handles[i] = (struct handle_entry){table->references[i].handle, i};
    handle_sort(table->handles, table->handles + table->count, table->count);
}

/* Takes the references of the build. Equal handles are adjacent after the sort. */
static enum bvhd_status take_given(struct reference_table *table, struct bvhd_error *error)
{
    const struct handle_entry *handles = table->handles;
    table->given = table->count = table->build->reference_count;
    for (uint32_t i = 0; i < table->given; i++) {
        table->references[i] = reference_convert(&table->build->references[i]);
        table->infos[i] = REFERENCE_GIVEN;
    }
    sort_handles(table);
    for (uint32_t i = 1; i < table->given; i++)
        if (handles[i].handle == handles[i - 1].handle)
            return bvhd_error_set(error, BVHD_INVALID, place("build.references[%u].handle", handles[i].number).text,
                                  "0x%" PRIx64 " is the handle of references[%u], too", handles[i].handle,
                                  handles[i - 1].number);
    return BVHD_OK;
}

/*
 * Takes what an info builds, instead of the reference that it updates in place or behind all others. A reference over
 * which an info builds is not found any more: an info that names it breaks a rule between infos.
 */
static void take_built(struct reference_table *table, uint32_t info)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *built = &table->build->infos[info];
    uint32_t at = handle_find(table->handles, table->given, destination_of(built)), number = table->count;
    if (at != HANDLE_NONE) {
        number = table->handles[at].number;
        if (!is_update_in_place(built)) {
            table->references[number].handle = 0;
            return;
        }
    }
    if (!is_nameable(built))
        return;
    table->references[number] = (struct reference){.kind = REFERENCE_BLAS, .handle = destination_of(built)};
    table->infos[number] = info;
    table->count += at == HANDLE_NONE;
}

static enum bvhd_status fill(struct reference_table *table, struct bvhd_error *error)
{
    enum bvhd_status status = take_given(table, error);
    for (uint32_t i = 0; status == BVHD_OK && i < table->build->info_count; i++)
        take_built(table, i);
    if (status == BVHD_OK)
        sort_handles(table);
    return status;
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
    table.infos = memory_array(memory, count + 1, sizeof *table.infos);
    if (table.references && table.handles && table.infos && count < UINT32_MAX) {
        status = fill(&table, error);
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
    return table->infos[number] == REFERENCE_GIVEN && !reference_is_bounded(&table->build->references[number]);
}

const struct bvhd_key *reference_table_key(const struct reference_table *table, uint64_t handle)
{
    uint32_t at = handle_find(table->handles, table->count, handle);
    if (at == HANDLE_NONE || table->handles[at].number >= table->given)
        return NULL;
    const struct bvhd_reference *reference = &table->build->references[table->handles[at].number];
    return reference->has_key ? &reference->key : NULL;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include <bvhd/bvhd_vulkan.h>

#include "client/argument.h"
#include "proto/base/handle_table.h"
#include "client/library.h"
#include "proto/base/status.h"

struct naming {
    const struct bvhd_reference *references;
    uint32_t reference_count;
    struct handle_entry *entries; /* references sorted by handle; the second half is scratch */
    uint32_t *row_of; /* the row of each reference */
    uint32_t row_count;
    struct bvhd_error *error;
};

/* Numbers the rows in the order in which instances first name references. */
static enum bvhd_status name_rows(struct naming *naming, const VkAccelerationStructureInstanceKHR *instances,
                                  uint32_t count)
{
    for (uint32_t i = 0; i < naming->reference_count; i++) {
        naming->entries[i] = (struct handle_entry){naming->references[i].handle, i};
        naming->row_of[i] = UINT32_MAX;
    }
    handle_sort(naming->entries, naming->entries + naming->reference_count, naming->reference_count);
    for (uint32_t i = 0; i < count; i++) {
        uint64_t handle = instances[i].accelerationStructureReference;
        if (handle == 0)
            continue;
        uint32_t at = handle_find(naming->entries, naming->reference_count, handle);
        if (at == HANDLE_NONE) {
            char where[48];
            snprintf(where, sizeof where, "instances[%" PRIu32 "]", i);
            return bvhd_error_set(naming->error, BVHD_INVALID, where,
                                  "names 0x%" PRIx64 ", which is not among the references", handle);
        }
        uint32_t reference = naming->entries[at].number;
        if (naming->row_of[reference] == UINT32_MAX)
            naming->row_of[reference] = naming->row_count++;
    }
    return BVHD_OK;
}

enum bvhd_status bvhd_vulkan_rows(const struct bvhd_reference *references, uint32_t reference_count,
                                  const VkAccelerationStructureInstanceKHR *instances, uint32_t instance_count,
                                  uint32_t *ret_rows, uint32_t *ret_row_count, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {ret_row_count, "ret_row_count"});
    if (status == BVHD_OK && reference_count > 0)
        status = ARGUMENTS_CHECK(ret_error, {references, "references"}, {ret_rows, "ret_rows"});
    if (status == BVHD_OK && instance_count > 0)
        status = ARGUMENTS_CHECK(ret_error, {instances, "instances"});
    if (status != BVHD_OK)
        return status;
    struct naming naming = {.references = references, .reference_count = reference_count, .error = ret_error};
    uint64_t room = reference_count > 0 ? reference_count : 1;
    naming.entries = memory_array(&library_memory, 2 * room, sizeof *naming.entries);
    naming.row_of = memory_array(&library_memory, room, sizeof *naming.row_of);
    status = naming.entries && naming.row_of
                 ? name_rows(&naming, instances, instance_count)
                 : bvhd_error_no_memory(ret_error, "references", "%" PRIu32 " references", reference_count);
    if (status == BVHD_OK) {
        if (reference_count > 0) /* otherwise there may be no array */
            memcpy(ret_rows, naming.row_of, reference_count * sizeof *ret_rows);
        *ret_row_count = naming.row_count;
    }
    memory_free(&library_memory, naming.row_of);
    memory_free(&library_memory, naming.entries);
    return status;
}

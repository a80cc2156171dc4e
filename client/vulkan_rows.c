/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include <bvhd/bvhd_vulkan.h>

#include "box.h"
#include "handle_table.h"
#include "library.h"
#include "status.h"

/* What rows are compared by, and the reference that it comes from. */
struct content {
    struct bvhd_key key; /* zeros without one */
    struct box bounds;
    uint32_t reference, row; /* row: in the order of first use, before equal ones are merged */
};

_Static_assert(sizeof(struct bvhd_key) % 4 == 0, "no gaps between what is compared");
enum { COMPARED = sizeof(struct bvhd_key) + sizeof(struct box) };

static struct content content_of(const struct bvhd_reference *references, uint32_t reference, uint32_t row)
{
    struct content content = {.reference = reference, .row = row};
    if (references[reference].has_key)
        content.key = references[reference].key;
    memcpy(&content.bounds, references[reference].bounds, sizeof content.bounds);
    if (box_is_empty(&content.bounds))
        content.bounds = box_empty();
    return content;
}

static int by_content(const void *a, const void *b)
{
    const struct content *x = a, *y = b;
    int order = memcmp(x, y, COMPARED);
    return order ? order : x->row < y->row ? -1 : x->row > y->row;
}

static int by_row(const void *a, const void *b)
{
    const struct content *x = a, *y = b;
    return x->row < y->row ? -1 : x->row > y->row;
}

struct naming {
    const struct bvhd_reference *references;
    uint32_t reference_count;
    struct handle_entry *entries; /* references by handle; as much room again */
    struct content *rows;
    uint32_t *row_of; /* reference to row */
    uint32_t row_count;
    struct bvhd_error *error;
};

/* Rows in the order in which instances name references. */
static enum bvhd_status name_rows(struct naming *naming, const VkAccelerationStructureInstanceKHR *instances, uint32_t count)
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
            return bvhd_error_set(naming->error, BVHD_INVALID, where, "names 0x%" PRIx64 ", which is not among the references", handle);
        }
        uint32_t reference = naming->entries[at].number;
        if (naming->row_of[reference] != UINT32_MAX)
            continue;
        naming->row_of[reference] = naming->row_count;
        naming->rows[naming->row_count] = content_of(naming->references, reference, naming->row_count);
        naming->row_count++;
    }
    return BVHD_OK;
}

/* One row for equal ones, where the first of them was. */
static void merge_rows(struct naming *naming)
{
    struct content *rows = naming->rows;
    uint32_t merged = 0;
    qsort(rows, naming->row_count, sizeof *rows, by_content);
    for (uint32_t i = 1; i < naming->row_count; i++)
        if (memcmp(&rows[i], &rows[i - 1], COMPARED) == 0)
            rows[i].row = rows[i - 1].row;
    qsort(rows, naming->row_count, sizeof *rows, by_row);
    for (uint32_t i = 0; i < naming->row_count; i++) {
        if (i > 0 && rows[i].row != rows[i - 1].row)
            merged++;
        naming->row_of[rows[i].reference] = merged;
    }
    naming->row_count = naming->row_count > 0 ? merged + 1 : 0;
}

enum bvhd_status bvhd_vulkan_rows(const struct bvhd_reference *references, uint32_t reference_count,
                                  const VkAccelerationStructureInstanceKHR *instances, uint32_t instance_count, uint32_t *ret_rows,
                                  uint32_t *ret_row_count, struct bvhd_error *ret_error)
{
    struct naming naming = {.references = references, .reference_count = reference_count, .error = ret_error};
    uint64_t room = reference_count > 0 ? reference_count : 1;
    naming.entries = memory_array(&library_memory, 2 * room, sizeof *naming.entries);
    naming.rows = memory_array(&library_memory, room, sizeof *naming.rows);
    naming.row_of = memory_array(&library_memory, room, sizeof *naming.row_of);
    enum bvhd_status status = naming.entries && naming.rows && naming.row_of
                                  ? name_rows(&naming, instances, instance_count)
                                  : bvhd_error_set(ret_error, BVHD_NO_MEMORY, "references", "%" PRIu32 " references", reference_count);
    if (status == BVHD_OK) {
        merge_rows(&naming);
        memcpy(ret_rows, naming.row_of, reference_count * sizeof *ret_rows);
        *ret_row_count = naming.row_count;
    }
    memory_free(&library_memory, naming.row_of);
    memory_free(&library_memory, naming.rows);
    memory_free(&library_memory, naming.entries);
    return status;
}

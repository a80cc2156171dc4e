/* SPDX-License-Identifier: Apache-2.0 */
/* update_aabbs.c - updates of AABBs. */
#include "builder/update/update_kind.h"

static uint64_t active(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++)
        found |= (uint64_t)!update_any_nan(geometry->boxes + (size_t)6 * (first + i), 6) << i;
    return found;
}

static bool write(const struct refit_records *records, uint32_t first, unsigned count)
{
    const struct portable_aabb *source = (const struct portable_aabb *)records->source->records + first;
    uint32_t ids[REFIT_RECORDS_MAX];
    for (unsigned i = 0; i < count; i++)
        ids[i] = source[i].id & PORTABLE_ID_MASK;
    return update_write(records, first, ids, count);
}

static inline struct vec4_box box_of(const struct refit_records *records, uint32_t record)
{
    const void *written = records->written.records;
    const struct portable_aabb *aabb = (const struct portable_aabb *)written + record;
    return (struct vec4_box){vec4_load3(aabb->min), vec4_load3(aabb->max)};
}

static void boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                  struct refit_node ret_leaves[8])
{
    update_boxes(records, first, counts, ret_leaves, box_of);
}

const struct update_kind update_aabbs = {
    .version = 1,
    .row_is_sound = update_row_is_plain,
    .active = active,
    .write = write,
    .boxes = boxes,
};

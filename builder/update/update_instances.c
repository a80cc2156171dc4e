/* SPDX-License-Identifier: Apache-2.0 */
/* update_instances.c - updates of instances. */
#include "builder/input/primitive.h"
#include "builder/update/update_kind.h"

enum { INSTANCE_SIZE = 64, INSTANCE_REFERENCE = 56 };

static bool is_active(const unsigned char *record)
{
    float transform[12];
    memcpy(transform, record, sizeof transform);
    return bytes_get64(record + INSTANCE_REFERENCE) != 0 && !update_any_nan(transform, 12);
}

static uint64_t active(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++)
        found |= (uint64_t)is_active(geometry->instances + (size_t)INSTANCE_SIZE * (first + i)) << i;
    return found;
}

static bool write(const struct refit_records *records, uint32_t first, unsigned count)
{
    const struct portable_instance *source = (const struct portable_instance *)records->source->records + first;
    uint32_t ids[REFIT_RECORDS_MAX];
    for (unsigned i = 0; i < count; i++)
        ids[i] = source[i].instance;
    return update_write(records, first, ids, count);
}

static inline struct vec4_box box_of(const struct refit_records *records, uint32_t record)
{
    const void *written = records->written.records;
    const struct canonical *canonical = records->written.canonical;
    const uint32_t instance = ((const struct portable_instance *)written)[record].instance;
    const struct box box = primitive_box(canonical, canonical->geometries, instance);
    return vec4_box_from(&box);
}

static void boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                  struct refit_node ret_leaves[8])
{
    update_boxes(records, first, counts, ret_leaves, box_of);
}

const struct update_kind update_instances = {
    .version = 1,
    .row_is_sound = update_row_is_plain,
    .active = active,
    .write = write,
    .boxes = boxes,
};

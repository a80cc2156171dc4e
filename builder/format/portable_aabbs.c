/* SPDX-License-Identifier: Apache-2.0 */
/* portable_aabbs.c - the records of AABBs. */
#include "builder/format/portable_records.h"

static void write_aabb(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    const float *box = geometry->boxes + (uint64_t)6 * (primitive - geometry->first_primitive);
    struct portable_aabb aabb = {.id = portable_records_id(geometry, primitive)};
    memcpy(aabb.min, box, sizeof aabb.min);
    memcpy(aabb.max, box + 3, sizeof aabb.max);
    memcpy(record, &aabb, sizeof aabb);
}

static void write_aabbs(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                        unsigned char *record)
{
    const struct canonical_geometry *geometry = writer->canonical->geometries;
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_aabb)) {
        geometry = portable_records_geometry(writer, geometry, refs[i]);
        write_aabb(geometry, refs[i], record);
    }
}

static bool is_sound(const struct portable_header *header, const struct portable_aabb *aabb)
{
    bool ordered = aabb->min[0] <= aabb->max[0] && aabb->min[1] <= aabb->max[1] && aabb->min[2] <= aabb->max[2];
    return portable_records_id_is_sound(header, aabb->id, PORTABLE_ID_OPAQUE) && ordered && aabb->reserved == 0;
}

static uint32_t find_unsound(const struct portable_view *view)
{
    const struct portable_aabb *aabbs = view->records;
    uint32_t i = 0;
    while (i < view->header->record_count && is_sound(view->header, &aabbs[i]))
        i++;
    return i;
}

const struct record_kind record_aabbs = {
    .version = 1,
    .type = GEOMETRY_AABBS,
    .size = sizeof(struct portable_aabb),
    .node_size = sizeof(struct portable_node),
    .first_leaf = 1,
    .cost = 1,
    .write = write_aabbs,
    .find_unsound = find_unsound,
};

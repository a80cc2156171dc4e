/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/update_kind.h"
#include "proto/base/kind.h"

const struct update_kind *update_kind_of(uint32_t type)
{
    static const struct update_kind *const kinds[KIND_COUNT] = {
        [KIND_TRIANGLES] = &update_triangles,
        [KIND_AABBS] = &update_aabbs,
        [KIND_INSTANCES] = &update_instances,
        [KIND_SPHERES] = &update_spheres,
        [KIND_SWEPT_SPHERES] = &update_swept_spheres,
        [KIND_MOVING_TRIANGLES] = &update_moving_triangles,
        [KIND_MOVING_INSTANCES] = &update_moving_instances,
    };
    const struct kind *kind = kind_find(type);
    return kind ? kinds[kind->number] : NULL;
}

bool update_row_is_plain(const struct record_geometry *row)
{
    static const struct record_geometry none;
    return memcmp(&row->vertex_count, &none.vertex_count,
                  sizeof *row - offsetof(struct record_geometry, vertex_count)) == 0;
}

bool update_write(const struct refit_records *records, uint32_t first, const uint32_t *primitives, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        if (primitives[i] >= records->source->header->primitive_count ||
            !record_is_active(records->record, primitives[i]))
            return false;
    portable_records_write(&records->written, first, primitives, count);
    return true;
}

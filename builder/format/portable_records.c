/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_records.h"

uint32_t portable_records_triangle_flags(const struct portable_header *header)
{
    return PORTABLE_ID_OPAQUE | (header->micromap_index_count > 0 ? PORTABLE_ID_MICROMAP : 0);
}

bool portable_records_micromap_is_sound(const struct portable_view *view, uint32_t id)
{
    if (!(id & PORTABLE_ID_MICROMAP))
        return true;
    const uint32_t primitive = id & PORTABLE_ID_MASK, index = view->micromap_indices[primitive];
    const uint32_t micromap = view->geometries[portable_geometry_of(view, primitive)].micromap;
    if (index >= MICROMAP_FULLY_UNKNOWN_OPAQUE)
        return micromap != 0;
    return micromap != 0 && micromap != PORTABLE_NO_MICROMAP && index < view->micromaps[micromap - 1].triangle_count;
}

void portable_records_mark_range(const struct record_kind *kind, const struct canonical *canonical, uint32_t first,
                                 uint32_t count, uint8_t *used)
{
    while (count > 0) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, first)];
        uint32_t begin = first - geometry->first_primitive, left = geometry->primitive_count - begin,
                 here = count < left ? count : left;
        kind->mark_range(geometry, begin, here, used);
        first += here;
        count -= here;
    }
}

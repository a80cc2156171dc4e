/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_records.h"

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

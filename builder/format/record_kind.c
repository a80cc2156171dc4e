/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/record_kind.h"

const struct record_kind *const record_kinds[PORTABLE_CONTENTS] = {
    [PORTABLE_INDEXED_TRIANGLES] = &record_indexed_triangles,
    [PORTABLE_TRIANGLES] = &record_triangles,
    [PORTABLE_AABBS] = &record_aabbs,
    [PORTABLE_INSTANCES] = &record_instances,
    [PORTABLE_SPHERES] = &record_spheres,
    [PORTABLE_SWEPT_SPHERES] = &record_swept_spheres,
    [PORTABLE_MOVING_TRIANGLES] = &record_moving_triangles,
    [PORTABLE_MOVING_INSTANCES] = &record_moving_instances,
};

/* Several contents may hold one type of geometry: the content that needs no flag comes first. */
enum portable_content record_content_for(uint32_t structure_type, uint32_t geometry_type, uint32_t layout_flags)
{
    const bool is_static_top = structure_type == STRUCTURE_TOP && geometry_type != GEOMETRY_MOVING_INSTANCES;
    const uint32_t type = is_static_top ? GEOMETRY_INSTANCES : geometry_type;
    enum portable_content found = PORTABLE_INDEXED_TRIANGLES;
    for (uint32_t content = 0; content < PORTABLE_CONTENTS; content++)
        if (record_kinds[content]->type == type && !(record_kinds[content]->layout_flag & ~layout_flags))
            found = (enum portable_content)content;
    return found;
}

enum portable_content record_content_of(const struct canonical *canonical, uint32_t layout_flags)
{
    return record_content_for(canonical->type, canonical_kind(canonical), layout_flags);
}

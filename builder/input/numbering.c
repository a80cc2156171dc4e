/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/numbering.h"

#include "proto/base/prefix.h"

static uint32_t first_of(const struct canonical_geometry *geometry, enum form_section section)
{
    return section == FORM_PRIMITIVES ? geometry->first_primitive : geometry->first_vertex;
}

static uint32_t count_of(const struct canonical_geometry *geometry, enum form_section section)
{
    return section == FORM_PRIMITIVES ? geometry->primitive_count : geometry->vertex_count;
}

/* Returns the last geometry whose items start at or before `item`. */
static uint32_t geometry_of(const struct canonical *view, enum form_section section, size_t item)
{
    const struct canonical_geometry *geometries = view->geometries;
    const uint32_t *firsts = section == FORM_PRIMITIVES ? &geometries[0].first_primitive : &geometries[0].first_vertex;
    return prefix_find(firsts, sizeof geometries[0], view->geometry_count, item);
}

void numbering_for_each(const struct canonical *view, enum form_section section, size_t begin, size_t end,
                        numbering_function take, void *context)
{
    for (uint32_t i = geometry_of(view, section, begin); begin < end; i++) {
        const struct canonical_geometry *geometry = &view->geometries[i];
        size_t first = begin - first_of(geometry, section), left = count_of(geometry, section) - first;
        size_t count = left < end - begin ? left : end - begin;
        if (count > 0)
            take(context, i, (uint32_t)first, (uint32_t)count);
        begin += count;
    }
}

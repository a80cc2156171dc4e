/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/canonical.h"

#include <assert.h>

#include "proto/base/kind.h"
#include "proto/base/prefix.h"

struct canonical_instance canonical_instance(const struct canonical_geometry *geometry, uint32_t index)
{
    assert(index < geometry->primitive_count);
    const unsigned char *record = geometry->instances + (uint64_t)64 * index;
    uint32_t custom_and_mask = bytes_get32(record + 48), sbt_and_flags = bytes_get32(record + 52);
    struct canonical_instance instance = {
        .custom_index = custom_and_mask & 0xffffff,
        .mask = custom_and_mask >> 24,
        .sbt_offset = sbt_and_flags & 0xffffff,
        .flags = sbt_and_flags >> 24,
        .reference = bytes_get64(record + 56),
    };
    memcpy(instance.transform, record, sizeof instance.transform);
    return instance;
}

uint32_t canonical_geometry_of(const struct canonical *canonical, uint32_t primitive)
{
    assert(primitive < canonical->primitive_count);
    return prefix_find(&canonical->geometries[0].first_primitive, sizeof canonical->geometries[0],
                       canonical->geometry_count, primitive);
}

uint32_t canonical_kind(const struct canonical *canonical)
{
    for (uint32_t i = 0; i < canonical->geometry_count; i++)
        if (kind_find(canonical->geometries[i].type)->moves)
            return canonical->geometries[i].type;
    if (canonical->geometry_count > 0)
        return canonical->geometries[0].type;
    return canonical->type == STRUCTURE_TOP ? GEOMETRY_INSTANCES : GEOMETRY_TRIANGLES;
}

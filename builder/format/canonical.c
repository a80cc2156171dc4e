/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/canonical.h"

#include <assert.h>

#include "proto/base/kind.h"
#include "proto/base/prefix.h"

static const unsigned char *record_of(const struct canonical_geometry *geometry, uint32_t index)
{
    assert(index < geometry->primitive_count);
    const uint32_t size = geometry->type == GEOMETRY_MOVING_INSTANCES ? MOTION_RECORD_STRIDE : 64;
    return geometry->instances + (uint64_t)size * index;
}

struct canonical_instance canonical_instance(const struct canonical_geometry *geometry, uint32_t index)
{
    const unsigned char *record = record_of(geometry, index);
    const unsigned char *fields = record + canonical_record_fields(geometry->type, record);
    uint32_t custom_and_mask = bytes_get32(fields), sbt_and_flags = bytes_get32(fields + 4);
    struct canonical_instance instance = {
        .custom_index = custom_and_mask & 0xffffff,
        .mask = custom_and_mask >> 24,
        .sbt_offset = sbt_and_flags & 0xffffff,
        .flags = sbt_and_flags >> 24,
        .reference = bytes_get64(fields + 8),
    };
    const bool moves = geometry->type == GEOMETRY_MOVING_INSTANCES;
    if (!moves || bytes_get32(record) != MOTION_SRT)
        memcpy(instance.transform, record + (moves ? MOTION_RECORD_DATA : 0), sizeof instance.transform);
    return instance;
}

struct canonical_motion canonical_motion(const struct canonical_geometry *geometry, uint32_t index)
{
    const unsigned char *record = record_of(geometry, index);
    const bool moves = geometry->type == GEOMETRY_MOVING_INSTANCES;
    struct canonical_motion motion = {.type = moves ? bytes_get32(record) : MOTION_STATIC};
    const unsigned char *start = record + (moves ? MOTION_RECORD_DATA : 0);
    const size_t size = (motion.type == MOTION_SRT ? 16 : 12) * sizeof *motion.start;
    memcpy(motion.start, start, size);
    memcpy(motion.end, motion.type == MOTION_STATIC ? start : start + size, size);
    return motion;
}

bool canonical_has_micromaps(const struct canonical *canonical)
{
    for (uint32_t i = 0; i < canonical->geometry_count; i++)
        if (canonical->geometries[i].has_micromaps)
            return true;
    return false;
}

bool canonical_moves(const struct canonical *canonical)
{
    return kind_find(canonical_kind(canonical))->moves;
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

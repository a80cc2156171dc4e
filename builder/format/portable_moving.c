/* SPDX-License-Identifier: Apache-2.0 */
/* portable_moving.c - the records of motion triangles and of motion instances. */
#include "builder/format/portable_records.h"

static void write_nothing(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                          unsigned char *record)
{
    (void)writer, (void)refs, (void)count, (void)record;
}

static uint32_t find_unsound(const struct portable_view *view)
{
    (void)view;
    return 0;
}

static uint64_t vertices_most(const struct geometry *geometry)
{
    return 3 * (uint64_t)geometry->range.primitive_count;
}

const struct record_kind record_moving_triangles = {
    .version = 2,
    .type = GEOMETRY_MOVING_TRIANGLES,
    .size = sizeof(struct portable_indexed_triangle),
    .vertex_size = sizeof(struct portable_moving_vertex),
    .first_leaf = 1,
    .cost = 1,
    .vertices_most = vertices_most,
    .write = write_nothing,
    .find_unsound = find_unsound,
};

const struct record_kind record_moving_instances = {
    .version = 2,
    .type = GEOMETRY_MOVING_INSTANCES,
    .size = sizeof(struct portable_moving_instance),
    .first_leaf = 1,
    .cost = 1,
    .write = write_nothing,
    .find_unsound = find_unsound,
};

/* SPDX-License-Identifier: Apache-2.0 */
/* portable_round.c - the records of spheres and of linear swept spheres. */
#include "builder/format/portable_records.h"

static void write_round(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
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
    return 2 * (uint64_t)geometry->range.primitive_count;
}

const struct record_kind record_spheres = {
    .type = GEOMETRY_SPHERES,
    .size = sizeof(struct portable_round),
    .vertex_size = 4 * sizeof(float),
    .first_leaf = 1,
    .cost = 1,
    .vertices_most = vertices_most,
    .write = write_round,
    .find_unsound = find_unsound,
};

const struct record_kind record_swept_spheres = {
    .type = GEOMETRY_SWEPT_SPHERES,
    .size = sizeof(struct portable_round),
    .vertex_size = 4 * sizeof(float),
    .first_leaf = 1,
    .cost = 1,
    .vertices_most = vertices_most,
    .write = write_round,
    .find_unsound = find_unsound,
};

/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/row_kind.h"

#include <stddef.h>

#include "proto/base/kind.h"

static void triangles_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    row->vertex_format = geometry->triangles.vertex_format;
    row->max_vertex = geometry->triangles.max_vertex;
    row->index_type = geometry->triangles.index_type;
    row->stride = geometry->triangles.vertex_stride;
}

static void triangles_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    geometry->triangles.vertex_format = row->vertex_format;
    geometry->triangles.max_vertex = row->max_vertex;
    geometry->triangles.index_type = row->index_type;
    geometry->triangles.vertex_stride = row->stride;
}

static void aabbs_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    row->stride = geometry->aabbs.stride;
}

static void aabbs_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    geometry->aabbs.stride = row->stride;
}

/* For kinds without fields of their own. */
static void nothing_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    (void)geometry, (void)row;
}

static void nothing_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    (void)row, (void)geometry;
}

#define AT(member) offsetof(struct geometry, member)

static const struct row_kind kinds[KIND_COUNT] = {
    [KIND_TRIANGLES] = {{[ROW_DATA] = AT(triangles.vertices),
                         [ROW_INDICES] = AT(triangles.indices),
                         [ROW_TRANSFORM] = AT(triangles.transform)},
                        triangles_to_row,
                        triangles_from_row},
    [KIND_AABBS] = {{[ROW_DATA] = AT(aabbs.boxes)}, aabbs_to_row, aabbs_from_row},
    [KIND_INSTANCES] = {{[ROW_DATA] = AT(instances.records)}, nothing_to_row, nothing_from_row},
};

const struct row_kind *row_kind_find(uint32_t type)
{
    static const struct row_kind nothing = {.to_row = nothing_to_row, .from_row = nothing_from_row};
    const struct kind *kind = kind_find(type);
    return kind ? &kinds[kind->number] : &nothing;
}

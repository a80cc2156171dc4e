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

static void make_round_row(const struct geometry_spheres *spheres, struct geometry_row *row)
{
    row->vertex_format = spheres->vertex_format;
    row->radius_format = spheres->radius_format;
    row->index_type = spheres->index_type;
    row->stride = spheres->vertex_stride;
    row->radius_stride = spheres->radius_stride;
    row->index_stride = spheres->index_stride;
}

static void read_round_row(const struct geometry_row *row, struct geometry_spheres *spheres)
{
    spheres->vertex_format = row->vertex_format;
    spheres->radius_format = row->radius_format;
    spheres->index_type = row->index_type;
    spheres->vertex_stride = row->stride;
    spheres->radius_stride = row->radius_stride;
    spheres->index_stride = row->index_stride;
}

static void spheres_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    make_round_row(&geometry->spheres, row);
}

static void spheres_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    read_round_row(row, &geometry->spheres);
}

static void swept_spheres_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    make_round_row(&geometry->swept_spheres.ends, row);
    row->indexing_mode = geometry->swept_spheres.indexing_mode;
    row->end_caps_mode = geometry->swept_spheres.end_caps_mode;
}

static void swept_spheres_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    read_round_row(row, &geometry->swept_spheres.ends);
    geometry->swept_spheres.indexing_mode = row->indexing_mode;
    geometry->swept_spheres.end_caps_mode = row->end_caps_mode;
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
    [KIND_TRIANGLES] = {ROWS_GEOMETRY_LEAST,
                        {[ROW_DATA] = AT(triangles.vertices),
                         [ROW_INDICES] = AT(triangles.indices),
                         [ROW_TRANSFORM] = AT(triangles.transform)},
                        triangles_to_row,
                        triangles_from_row},
    [KIND_AABBS] = {ROWS_GEOMETRY_LEAST, {[ROW_DATA] = AT(aabbs.boxes)}, aabbs_to_row, aabbs_from_row},
    [KIND_INSTANCES] = {ROWS_GEOMETRY_LEAST, {[ROW_DATA] = AT(instances.records)}, nothing_to_row, nothing_from_row},
    [KIND_SPHERES] =
        {ROWS_GEOMETRY_SIZE,
         {[ROW_DATA] = AT(spheres.vertices), [ROW_INDICES] = AT(spheres.indices), [ROW_RADII] = AT(spheres.radii)},
         spheres_to_row,
         spheres_from_row},
    [KIND_SWEPT_SPHERES] = {ROWS_GEOMETRY_SIZE,
                            {[ROW_DATA] = AT(swept_spheres.ends.vertices),
                             [ROW_INDICES] = AT(swept_spheres.ends.indices),
                             [ROW_RADII] = AT(swept_spheres.ends.radii)},
                            swept_spheres_to_row,
                            swept_spheres_from_row},
    [KIND_MOVING_TRIANGLES] = {ROWS_GEOMETRY_SIZE,
                               {[ROW_DATA] = AT(triangles.vertices),
                                [ROW_INDICES] = AT(triangles.indices),
                                [ROW_TRANSFORM] = AT(triangles.transform),
                                [ROW_END_POSITIONS] = AT(triangles.end_vertices)},
                               triangles_to_row,
                               triangles_from_row},
    [KIND_MOVING_INSTANCES] = {ROWS_GEOMETRY_LEAST,
                               {[ROW_DATA] = AT(instances.records)},
                               nothing_to_row,
                               nothing_from_row},
    [KIND_MICROMAP] = {ROWS_GEOMETRY_LEAST, .to_row = nothing_to_row, .from_row = nothing_from_row},
    [KIND_BAKED_MICROMAP] = {ROWS_GEOMETRY_LEAST, .to_row = nothing_to_row, .from_row = nothing_from_row},
};

const struct row_kind *row_kind_find(uint32_t type)
{
    static const struct row_kind nothing = {
        .size = ROWS_GEOMETRY_LEAST, .to_row = nothing_to_row, .from_row = nothing_from_row};
    const struct kind *kind = kind_find(type);
    return kind ? &kinds[kind->number] : &nothing;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/row_kind.h"

#include <stddef.h>

#include "proto/base/kind.h"

static void micromap_of_triangles_to_row(const struct triangle_micromap *micromap, struct geometry_row *row)
{
    row->has_micromap = micromap->is_given;
    row->has_usages = micromap->has_usages;
    row->micromap_index_type = micromap->index_type;
    row->base_triangle = micromap->base_triangle;
    row->micromap = micromap->micromap;
    row->micromap_stride = micromap->stride;
}

static void micromap_of_triangles_from_row(const struct geometry_row *row, struct triangle_micromap *micromap)
{
    micromap->is_given = row->has_micromap;
    micromap->has_usages = row->has_usages;
    micromap->index_type = row->micromap_index_type;
    micromap->base_triangle = row->base_triangle;
    micromap->micromap = row->micromap;
    micromap->stride = row->micromap_stride;
}

static void triangles_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    row->vertex_format = geometry->triangles.vertex_format;
    row->max_vertex = geometry->triangles.max_vertex;
    row->index_type = geometry->triangles.index_type;
    row->stride = geometry->triangles.vertex_stride;
    micromap_of_triangles_to_row(&geometry->triangles.micromap, row);
}

static void triangles_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    geometry->triangles.vertex_format = row->vertex_format;
    geometry->triangles.max_vertex = row->max_vertex;
    geometry->triangles.index_type = row->index_type;
    geometry->triangles.vertex_stride = row->stride;
    micromap_of_triangles_from_row(row, &geometry->triangles.micromap);
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

static void micromap_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    row->stride = geometry->micromap.stride;
}

static void micromap_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    geometry->micromap.stride = row->stride;
}

static void bake_to_row(const struct geometry *geometry, struct geometry_row *row)
{
    const struct geometry_bake *bake = &geometry->bake;
    row->stride = bake->row_stride;
    row->index_type = bake->index_type;
    row->alpha_width = bake->width;
    row->alpha_height = bake->height;
    row->wrap_u = bake->wrap_u;
    row->wrap_v = bake->wrap_v;
    row->is_nearest = bake->is_nearest;
    row->bake_mode = bake->mode;
    row->micromap_format = bake->format;
    row->micromap_level = bake->level;
    row->alpha_cutoff = bake->cutoff;
    row->vertex_count = bake->vertex_count;
    row->coordinate_stride = bake->coordinate_stride;
}

static void bake_from_row(const struct geometry_row *row, struct geometry *geometry)
{
    struct geometry_bake *bake = &geometry->bake;
    bake->row_stride = row->stride;
    bake->index_type = row->index_type;
    bake->width = row->alpha_width;
    bake->height = row->alpha_height;
    bake->wrap_u = row->wrap_u;
    bake->wrap_v = row->wrap_v;
    bake->is_nearest = row->is_nearest;
    bake->mode = row->bake_mode;
    bake->format = row->micromap_format;
    bake->level = row->micromap_level;
    bake->cutoff = row->alpha_cutoff;
    bake->vertex_count = row->vertex_count;
    bake->coordinate_stride = row->coordinate_stride;
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
    [KIND_TRIANGLES] = {.size = ROWS_GEOMETRY_LEAST,
                        .can_have_micromap = true,
                        .arrays = {[ROW_DATA] = AT(triangles.vertices),
                                   [ROW_INDICES] = AT(triangles.indices),
                                   [ROW_TRANSFORM] = AT(triangles.transform),
                                   [ROW_USAGES] = AT(triangles.micromap.usages),
                                   [ROW_MICROMAP_INDICES] = AT(triangles.micromap.indices)},
                        .to_row = triangles_to_row,
                        .from_row = triangles_from_row},
    [KIND_AABBS] = {.size = ROWS_GEOMETRY_LEAST,
                    .arrays = {[ROW_DATA] = AT(aabbs.boxes)},
                    .to_row = aabbs_to_row,
                    .from_row = aabbs_from_row},
    [KIND_INSTANCES] = {.size = ROWS_GEOMETRY_LEAST,
                        .arrays = {[ROW_DATA] = AT(instances.records)},
                        .to_row = nothing_to_row,
                        .from_row = nothing_from_row},
    [KIND_SPHERES] =
        {.size = ROWS_GEOMETRY_ROUND,
         .arrays =
             {[ROW_DATA] = AT(spheres.vertices), [ROW_INDICES] = AT(spheres.indices), [ROW_RADII] = AT(spheres.radii)},
         .to_row = spheres_to_row,
         .from_row = spheres_from_row},
    [KIND_SWEPT_SPHERES] = {.size = ROWS_GEOMETRY_ROUND,
                            .arrays = {[ROW_DATA] = AT(swept_spheres.ends.vertices),
                                       [ROW_INDICES] = AT(swept_spheres.ends.indices),
                                       [ROW_RADII] = AT(swept_spheres.ends.radii)},
                            .to_row = swept_spheres_to_row,
                            .from_row = swept_spheres_from_row},
    [KIND_MOVING_TRIANGLES] = {.size = ROWS_GEOMETRY_ROUND,
                               .can_have_micromap = true,
                               .arrays = {[ROW_DATA] = AT(triangles.vertices),
                                          [ROW_INDICES] = AT(triangles.indices),
                                          [ROW_TRANSFORM] = AT(triangles.transform),
                                          [ROW_END_POSITIONS] = AT(triangles.end_vertices),
                                          [ROW_USAGES] = AT(triangles.micromap.usages),
                                          [ROW_MICROMAP_INDICES] = AT(triangles.micromap.indices)},
                               .to_row = triangles_to_row,
                               .from_row = triangles_from_row},
    [KIND_MOVING_INSTANCES] = {.size = ROWS_GEOMETRY_LEAST,
                               .arrays = {[ROW_DATA] = AT(instances.records)},
                               .to_row = nothing_to_row,
                               .from_row = nothing_from_row},
    [KIND_MICROMAP] = {.size = ROWS_GEOMETRY_MICROMAP,
                       .arrays = {[ROW_DATA] = AT(micromap.states),
                                  [ROW_USAGES] = AT(micromap.usages),
                                  [ROW_MICROMAP_TRIANGLES] = AT(micromap.triangles)},
                       .to_row = micromap_to_row,
                       .from_row = micromap_from_row},
    [KIND_BAKED_MICROMAP] =
        {.size = ROWS_GEOMETRY_SIZE,
         .arrays =
             {[ROW_DATA] = AT(bake.alpha), [ROW_INDICES] = AT(bake.indices), [ROW_COORDINATES] = AT(bake.coordinates)},
         .to_row = bake_to_row,
         .from_row = bake_from_row},
};

const struct row_kind *row_kind_find(uint32_t type)
{
    static const struct row_kind nothing = {
        .size = ROWS_GEOMETRY_LEAST, .to_row = nothing_to_row, .from_row = nothing_from_row};
    const struct kind *kind = kind_find(type);
    return kind ? &kinds[kind->number] : &nothing;
}

uint32_t row_kind_size(const struct geometry *geometry)
{
    const struct row_kind *kind = row_kind_find(geometry->type);
    return kind->can_have_micromap && geometry->triangles.micromap.is_given ? ROWS_GEOMETRY_ATTACHED : kind->size;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/surface.h"

#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/picture/round_surface.h"

#define NO_ROW UINT32_MAX

static uint32_t *make_rows(struct memory *memory, uint64_t count)
{
    uint32_t *rows = memory_array(memory, count + 1, sizeof *rows);
    if (rows)
        memset(rows, 0xff, count * sizeof *rows); /* NO_ROW */
    return rows;
}

static uint32_t primitive_of(const struct structure *bottom, uint32_t row)
{
    float corners[3][3];
    uint32_t primitive;
    if (structure_round_count(bottom))
        return structure_round(bottom, row).primitive;
    structure_triangle(bottom, row, 0, corners, &primitive);
    return primitive;
}

/* All rows of a primitive that was split are alike, so that any of them will do. */
static uint32_t *find_primitives(const struct structure *bottom, struct memory *memory)
{
    uint32_t *rows = make_rows(memory, bottom->primitive_count);
    uint32_t count = structure_triangle_count(bottom) + structure_round_count(bottom); /* one of them is 0 */
    for (uint32_t row = 0; row < count && rows; row++) {
        uint32_t primitive = primitive_of(bottom, row);
        if (primitive < bottom->primitive_count)
            rows[primitive] = row;
    }
    return rows;
}

struct bottom_data {
    const unsigned char *data;
    uint32_t bottom;
};

static int compare_places(const void *a, const void *b)
{
    const struct bottom_data *x = a, *y = b;
    return x->data != y->data ? (x->data > y->data) - (x->data < y->data)
                              : (x->bottom > y->bottom) - (x->bottom < y->bottom);
}

/* Makes one table for each distinct bottom level, which several rows may name. */
static bool fill_bottoms(struct surfaces *surfaces, struct bottom_data *places)
{
    const struct structures *structures = surfaces->structures;
    uint32_t count = structures->bottom_count;
    for (uint32_t i = 0; i < count; i++)
        places[i] = (struct bottom_data){structures->files[i].structure.blob.data, i};
    qsort(places, count, sizeof *places, compare_places);
    for (uint32_t i = 0; i < count; i++) {
        bool is_same = i > 0 && places[i].data == places[i - 1].data;
        uint32_t **rows = &surfaces->primitive_rows[places[i].bottom];
        surfaces->owners[places[i].bottom] = is_same ? surfaces->owners[places[i - 1].bottom] : places[i].bottom;
        if (is_same || !places[i].data)
            continue;
        *rows = find_primitives(&structures->files[places[i].bottom].structure, surfaces->memory);
        if (!*rows)
            return false;
    }
    return true;
}

static bool find_bottoms(struct surfaces *surfaces)
{
    struct memory *memory = surfaces->memory;
    uint64_t count = (uint64_t)surfaces->structures->bottom_count + 1;
    struct bottom_data *places = memory_array(memory, count, sizeof *places);
    surfaces->primitive_rows = memory_array(memory, count, sizeof *surfaces->primitive_rows);
    surfaces->owners = memory_array(memory, count, sizeof *surfaces->owners);
    if (surfaces->primitive_rows)
        memset(surfaces->primitive_rows, 0, count * sizeof *surfaces->primitive_rows);
    bool ok = places && surfaces->primitive_rows && surfaces->owners && fill_bottoms(surfaces, places);
    memory_free(memory, places);
    return ok;
}

static bool find_instances(struct surfaces *surfaces)
{
    const struct structure *top = structures_top(surfaces->structures);
    uint32_t rows = top ? structure_instance_count(top) : 0;
    for (uint32_t row = 0; row < rows; row++) {
        uint32_t instance = structure_instance(top, row).instance;
        surfaces->instance_count = instance >= surfaces->instance_count ? instance + 1 : surfaces->instance_count;
    }
    surfaces->instance_rows = make_rows(surfaces->memory, surfaces->instance_count);
    for (uint32_t row = 0; row < rows && surfaces->instance_rows; row++)
        surfaces->instance_rows[structure_instance(top, row).instance] = row;
    return surfaces->instance_rows != NULL;
}

enum bvhd_status surfaces_init(struct surfaces *surfaces, const struct structures *structures, struct memory *memory,
                               struct bvhd_error *error)
{
    *surfaces = (struct surfaces){.structures = structures, .memory = memory};
    if (find_instances(surfaces) && find_bottoms(surfaces))
        return BVHD_OK;
    surfaces_finish(surfaces);
    return bvhd_error_no_memory(error, "trace", "no memory to find primitives");
}

void surfaces_finish(struct surfaces *surfaces)
{
    if (!surfaces || !surfaces->memory)
        return;
    for (uint32_t i = 0; surfaces->primitive_rows && i < surfaces->structures->bottom_count; i++)
        memory_free(surfaces->memory, surfaces->primitive_rows[i]);
    memory_free(surfaces->memory, surfaces->primitive_rows);
    memory_free(surfaces->memory, surfaces->owners);
    memory_free(surfaces->memory, surfaces->instance_rows);
    *surfaces = (struct surfaces){0};
}

static const struct structure_geometry *find_geometry(const struct structure *bottom, uint32_t geometry)
{
    const struct structure_geometry *rows = bottom->geometries;
    uint32_t low = 0, high = bottom->geometry_count;
    if (geometry < high && rows[geometry].geometry == geometry)
        return &rows[geometry]; /* nearly always, when no geometry before it is left out */
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (rows[middle].geometry == geometry)
            return &rows[middle];
        if (rows[middle].geometry < geometry)
            low = middle + 1;
        else
            high = middle;
    }
    return NULL;
}

/* Finds the row of the primitive that was hit. Returns false if there is none. */
static bool find_row(const struct surfaces *surfaces, uint32_t bottom, const struct tracer_hit *hit, uint32_t *ret_row)
{
    const struct structure *structure = &surfaces->structures->files[bottom].structure;
    const uint32_t *rows = surfaces->primitive_rows[surfaces->owners[bottom]];
    const struct structure_geometry *geometry = find_geometry(structure, hit->geometry);
    if (!rows || !geometry || hit->primitive >= geometry->primitive_count)
        return false;
    *ret_row = rows[geometry->first_primitive + hit->primitive];
    return *ret_row != NO_ROW;
}

static struct vector position_of(const struct ray *ray, const struct tracer_hit *hit)
{
    return vector_mad(vector_from_floats(ray->origin), vector_from_floats(ray->direction), (double)hit->t);
}

static void find_triangle(const struct structure *bottom, uint32_t row, float time, const float *transform,
                          struct vector ret_corners[3])
{
    float corners[3][3];
    uint32_t primitive;
    structure_triangle(bottom, row, time, corners, &primitive);
    for (int i = 0; i < 3; i++) {
        struct vector corner = vector_from_floats(corners[i]);
        ret_corners[i] = transform ? vector_transform(transform, corner) : corner;
    }
}

/* Finds a triangle in the tangent plane, as large as the primitive is thick. */
static void find_tangent(const struct structure_round *round, const float *transform, struct vector position, double u,
                         struct vector ret_corners[3])
{
    struct vector normal = round_surface_normal(round, transform, position, u), a, b;
    double size = fmax((double)round->ends[0][3], (double)round->ends[1][3]);
    vector_basis(normal, &a, &b);
    ret_corners[0] = position;
    ret_corners[1] = vector_mad(position, a, size);
    ret_corners[2] = vector_mad(position, b, size);
}

/* Finds the instance of a hit, of a triangle or an AABB. */
static bool find_instance(const struct surfaces *surfaces, const struct tracer_hit *hit,
                          struct structure_instance *ret_instance)
{
    const struct structure *top = structures_top(surfaces->structures);
    if (!top) {
        ret_instance->bottom = 0;
        return true;
    }
    if (hit->instance >= surfaces->instance_count || surfaces->instance_rows[hit->instance] == NO_ROW)
        return false;
    *ret_instance = structure_instance(top, surfaces->instance_rows[hit->instance]);
    return ret_instance->bottom < surfaces->structures->bottom_count;
}

bool surfaces_find(const struct surfaces *surfaces, const struct ray *ray, const struct tracer_hit *hit,
                   struct surface *ret_surface)
{
    struct structure_instance instance = {0};
    uint32_t row;
    if (hit->flags & TRACER_AABB || !find_instance(surfaces, hit, &instance) ||
        !find_row(surfaces, instance.bottom, hit, &row))
        return false;
    *ret_surface = (struct surface){.bottom = instance.bottom};
    const struct structure *bottom = &surfaces->structures->files[instance.bottom].structure;
    const float *transform = structures_top(surfaces->structures) ? ret_surface->object_to_world : NULL;
    if (transform)
        structure_instance_matrix(&instance, ray->time, ret_surface->object_to_world);
    if (structure_round_count(bottom)) {
        struct structure_round round = structure_round(bottom, row);
        find_tangent(&round, transform, position_of(ray, hit), fmin(fmax((double)hit->u, 0), 1), ret_surface->corners);
    } else {
        find_triangle(bottom, row, ray->time, transform, ret_surface->corners);
    }
    if (transform)
        ret_surface->shift = vector_transform(transform, vector_make(0, 0, 0));
    return true;
}

struct vector surface_normal(const struct surface *surface)
{
    return vector_normal(surface->corners);
}

/* Finds the bottom level of a hit of an AABB. */
static bool find_box(const struct surfaces *surfaces, const struct tracer_hit *hit, uint32_t *ret_bottom)
{
    struct structure_instance instance = {0};
    if (!find_instance(surfaces, hit, &instance))
        return false;
    *ret_bottom = instance.bottom;
    return true;
}

bool surfaces_meet(const struct surfaces *surfaces, const struct ray *ray, const struct tracer_hit *hit,
                   struct stage_hit *ret_hit)
{
    if (!isfinite(hit->t))
        return false;
    struct surface surface = {0};
    struct vector direction = vector_from_floats(ray->direction), normal = vector_scale(direction, -1);
    bool is_found = surfaces_find(surfaces, ray, hit, &surface);
    if (is_found)
        normal = surface_normal(&surface);
    else if (!(hit->flags & TRACER_AABB) || !find_box(surfaces, hit, &surface.bottom))
        return false;
    bool is_back = vector_dot(normal, direction) > 0;
    if (is_back)
        normal = vector_scale(normal, -1);
    *ret_hit = (struct stage_hit){.position = position_of(ray, hit),
                                  .normal = normal,
                                  .distance = (double)hit->t,
                                  .is_back = is_back,
                                  .instance = structures_top(surfaces->structures) ? hit->instance : 0,
                                  .handle = surface.bottom,
                                  .geometry = hit->geometry,
                                  .primitive = hit->primitive,
                                  .u = fmin(fmax((double)hit->u, 0), 1),
                                  .v = fmin(fmax((double)hit->v, 0), 1),
                                  .corners = {surface.corners[0], surface.corners[1], surface.corners[2]},
                                  .is_box = !is_found};
    memcpy(ret_hit->object_to_world, surface.object_to_world, sizeof ret_hit->object_to_world);
    return true;
}

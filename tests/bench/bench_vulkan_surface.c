/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bench_vulkan_surface.h"

#include <math.h>
#include <string.h>

#include "tests/support/random.h"
#include "client/bvhctl/picture/stage.h"
#include "client/bvhctl/picture/vector.h"

struct place {
    const struct bench_mesh *mesh;
    const float *to_world; /* NULL: the mesh is in world space */
    uint64_t first; /* number of its first triangle among all */
};

struct surface {
    struct place *places;
    uint32_t place_count;
    uint64_t triangle_count; /* over all places */
    double *areas; /* areas[i] is the summed area, doubled, of triangles 0 .. i */
    struct memory *memory;
};

static struct vector corner_of(const struct place *place, uint32_t vertex)
{
    struct vector at = vector_from_floats(place->mesh->positions + 3 * (size_t)vertex);
    return place->to_world ? vector_transform(place->to_world, at) : at;
}

static void corners_of(const struct place *place, uint64_t triangle, struct vector ret_corners[3])
{
    const uint32_t *indices = place->mesh->indices + 3 * (size_t)(triangle - place->first);
    for (int k = 0; k < 3; k++)
        ret_corners[k] = corner_of(place, indices[k]);
}

/* A normal whose length is twice the triangle's area. */
static struct vector normal_of(const struct vector corners[3])
{
    return vector_cross(vector_sub(corners[1], corners[0]), vector_sub(corners[2], corners[0]));
}

static void add_place(struct surface *surface, const struct bench_mesh *mesh, const float *to_world)
{
    surface->places[surface->place_count++] = (struct place){mesh, to_world, surface->triangle_count};
    surface->triangle_count += mesh->triangle_count;
}

/*
 * Finds the places by position in the request, so that they do not depend on the tree. The rows of a top level refer to
 * bottom levels by `handle`.
 */
static void find_places(struct surface *surface, const struct bench_scene *scene, const struct portable_instance **rows)
{
    if (!scene->given.has_top) {
        add_place(surface, &scene->meshes[0], NULL);
        return;
    }
    const struct portable_view *top = bench_scene_top(scene);
    const struct portable_instance *records = top->records;
    memset(rows, 0, top->header->primitive_count * sizeof *rows);
    for (uint32_t i = 0; i < top->header->record_count; i++)
        rows[records[i].instance] = &records[i];
    for (uint32_t i = 0; i < top->header->primitive_count; i++)
        if (rows[i])
            add_place(surface, &scene->meshes[rows[i]->handle], rows[i]->object_to_world);
}

static void sum_areas(struct surface *surface)
{
    double sum = 0;
    for (uint32_t i = 0; i < surface->place_count; i++) {
        const struct place *place = &surface->places[i];
        for (uint64_t k = place->first; k < place->first + place->mesh->triangle_count; k++) {
            struct vector corners[3];
            corners_of(place, k, corners);
            double area = vector_length(normal_of(corners));
            surface->areas[k] = sum += isfinite(area) ? area : 0;
        }
    }
}

static enum bvhd_status surface_init(struct surface *surface, const struct bench_scene *scene, struct bvhd_error *error)
{
    uint64_t places = scene->given.has_top ? bench_scene_top(scene)->header->primitive_count : 1;
    *surface = (struct surface){.memory = scene->memory};
    const struct portable_instance **rows = memory_array(scene->memory, places + 1, sizeof *rows);
    surface->places = memory_array(scene->memory, places + 1, sizeof *surface->places);
    if (rows && surface->places) {
        find_places(surface, scene, rows);
        surface->areas = memory_array(scene->memory, surface->triangle_count + 1, sizeof *surface->areas);
    }
    memory_free(scene->memory, rows);
    if (!surface->areas) {
        memory_free(scene->memory, surface->places);
        return bvhd_error_no_memory(error, "rays", "no memory for the places of triangles");
    }
    sum_areas(surface);
    return BVHD_OK;
}

static void surface_finish(struct surface *surface)
{
    memory_free(surface->memory, surface->areas);
    memory_free(surface->memory, surface->places);
}

/* The first triangle whose summed area exceeds `area`. */
static uint64_t triangle_at(const struct surface *surface, double area)
{
    uint64_t low = 0, high = surface->triangle_count - 1;
    while (low < high) {
        uint64_t middle = (low + high) / 2;
        if (surface->areas[middle] > area)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

static uint64_t draw_triangle(const struct surface *surface, bool is_by_area, struct random *random)
{
    uint64_t count = surface->triangle_count;
    return is_by_area ? triangle_at(surface, random_between(random, 0, surface->areas[count - 1]))
                      : random_next(random) % count;
}

static const struct place *place_of(const struct surface *surface, uint64_t triangle)
{
    uint32_t low = 0, high = surface->place_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (surface->places[middle].first <= triangle)
            low = middle;
        else
            high = middle;
    }
    return &surface->places[low];
}

static struct vector random_in_sphere(struct random *random)
{
    double point[3];
    do
        random_point(random, point);
    while (point[0] * point[0] + point[1] * point[1] + point[2] * point[2] > 1);
    return (struct vector){point[0], point[1], point[2]};
}

/* Returns false when the triangle has no area, or when the random direction has length 0 and another one is needed. */
static bool make_ray(const struct surface *surface, uint64_t triangle, float tmin, struct random *random,
                     struct ray *ret_ray)
{
    struct vector corners[3];
    corners_of(place_of(surface, triangle), triangle, corners);
    double a = random_between(random, 0, 1), b = random_between(random, 0, 1), side = random_next(random) & 1 ? 1 : -1;
    struct vector normal = normal_of(corners), away = random_in_sphere(random), at = corners[0];
    double area = vector_length(normal), length = vector_length(away);
    if (!(area > 0) || !isfinite(area) || !(length > 0))
        return false;
    bool is_beyond = a + b > 1; /* beyond the edge opposite to corner 0 */
    at = vector_mad(at, vector_sub(corners[1], corners[0]), is_beyond ? 1 - a : a);
    at = vector_mad(at, vector_sub(corners[2], corners[0]), is_beyond ? 1 - b : b);
    *ret_ray = stage_ray(at, vector_add(vector_scale(normal, side / area), vector_scale(away, 0.999 / length)), 0);
    ret_ray->tmin = tmin;
    return true;
}

enum bvhd_status bench_surface_rays(const struct bench_scene *scene, float tmin, uint32_t count, struct ray *rays,
                                    uint32_t *ret_count, struct bvhd_error *error)
{
    struct surface surface;
    struct random random = {3};
    enum bvhd_status status = surface_init(&surface, scene, error);
    if (status != BVHD_OK)
        return status;
    double area = surface.triangle_count ? surface.areas[surface.triangle_count - 1] : 0;
    uint32_t made = 0;
    while (area > 0 && made < count) {
        bool is_by_area =
            /* One random bit for each ray, so that triangles without area do not change the halves. */
            random_next(&random) & 1;
        while (!make_ray(&surface, draw_triangle(&surface, is_by_area, &random), tmin, &random, &rays[made]))
            continue;
        made++;
    }
    *ret_count = made;
    surface_finish(&surface);
    return BVHD_OK;
}

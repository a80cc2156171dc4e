/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/ray_sets.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "tests/bench/bvhd_bench/surface.h"

enum { TILE = 8 };

/* tmin of rays that start on a surface, as a fraction of the scene's size. */
static const double TMIN = 1e-5;

struct view {
    double centre[3], eye[3], light[3];
    double radius, size;
};

const char *ray_kind_name(enum ray_kind kind)
{
    static const char *const names[RAY_KINDS] = {"primary", "diffuse", "shadow"};
    return names[kind];
}

static struct ray make_ray(const double origin[3], const double direction[3], float tmin, float tmax)
{
    struct ray ray = {.tmin = tmin, .tmax = tmax, .cull_mask = 0xff};
    double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)origin[axis];
        ray.direction[axis] = (float)(direction[axis] / length);
    }
    return ray;
}

static const double forward[3] = {-0.6, -0.5, -0.6244998}, right[3] = {0.7211103, 0, -0.6928203},
                    up[3] = {-0.3464102, 0.8660254, -0.3605551};

/* The camera is outside of the scene and 40 degrees wide; the light is above it and aside. */
static struct view view_of(const float bounds[6])
{
    struct view view = {.radius = 0};
    for (int axis = 0; axis < 3; axis++) {
        double extent = (double)bounds[3 + axis] - bounds[axis];
        view.centre[axis] = 0.5 * ((double)bounds[axis] + bounds[3 + axis]);
        view.radius += 0.25 * extent * extent;
        view.size = fmax(view.size, extent);
    }
    view.radius = sqrt(view.radius);
    for (int axis = 0; axis < 3; axis++) {
        view.eye[axis] = view.centre[axis] - 1.6 * view.radius * forward[axis];
        view.light[axis] = view.centre[axis] + view.radius * (2.5 * up[axis] + 1.5 * right[axis]);
    }
    return view;
}

static uint32_t make_primary(const struct view *view, uint32_t size, struct ray *ret_rays)
{
    uint32_t count = 0;
    for (uint32_t tile = 0; tile < size / TILE * (size / TILE); tile++)
        for (uint32_t pixel = 0; pixel < TILE * TILE; pixel++) {
            double x = (tile % (size / TILE) * TILE + pixel % TILE + 0.5) / size * 2 - 1, direction[3];
            double y = (tile / (size / TILE) * TILE + pixel / TILE + 0.5) / size * 2 - 1;
            for (int axis = 0; axis < 3; axis++)
                direction[axis] = forward[axis] + 0.45 * (x * right[axis] - y * up[axis]);
            ret_rays[count++] = make_ray(view->eye, direction, 0, FLT_MAX);
        }
    return count;
}

static void random_on_sphere(struct random *random, double ret_point[3])
{
    double square;
    do {
        random_point(random, ret_point);
        square = ret_point[0] * ret_point[0] + ret_point[1] * ret_point[1] + ret_point[2] * ret_point[2];
    } while (square > 1 || square < 1e-6);
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] /= sqrt(square);
}

/* Adds the shadow ray from the hit of a primary ray. */
static void add_shadow(const struct view *view, const struct ray *ray, const struct ray_hit *hit, struct ray_sets *sets)
{
    double point[3], shadow[3], length = 0;
    for (int axis = 0; axis < 3; axis++) {
        point[axis] = ray->origin[axis] + (double)hit->t * ray->direction[axis];
        shadow[axis] = view->light[axis] - point[axis];
        length += shadow[axis] * shadow[axis];
    }
    struct ray to_light = make_ray(point, shadow, (float)(TMIN * view->size), (float)sqrt(length));
    to_light.flags = RAY_TERMINATE_ON_FIRST_HIT;
    sets->rays[RAYS_SHADOW][sets->counts[RAYS_SHADOW]++] = to_light;
}

static void make_shadow(const struct subject *subject, const struct view *view, struct ray_sets *sets)
{
    for (uint32_t i = 0; i < sets->counts[RAYS_PRIMARY]; i++) {
        const struct ray *ray = &sets->rays[RAYS_PRIMARY][i];
        struct ray_hit hit;
        if (subject_trace(subject, ray, &hit, NULL))
            add_shadow(view, ray, &hit, sets);
    }
}

static bool toss(struct random *random)
{
    return random_between(random, 0, 1) < 0.5;
}

static uint32_t make_diffuse(const struct ply *mesh, double size, uint32_t count, struct ray *ret_rays)
{
    struct surface surface = surface_of(mesh);
    struct random random = {7};
    uint32_t made = 0;
    while (made < count && surface.count > 0) {
        struct surface_point from =
            toss(&random) ? surface_draw(&surface, &random) : surface_draw_triangle(&surface, &random);
        double side = toss(&random) ? 1 : -1, normal[3], direction[3];
        surface_normal(mesh, from.triangle, normal);
        random_on_sphere(&random, direction);
        for (int axis = 0; axis < 3; axis++)
            direction[axis] += side * normal[axis];
        ret_rays[made++] = make_ray(from.position, direction, (float)(TMIN * size), FLT_MAX);
    }
    surface_finish(&surface);
    return made;
}

struct ray_sets ray_sets_make(const struct subject *subject, const struct ply *mesh, uint32_t size)
{
    struct ray_sets sets = {{0}, {NULL}};
    struct view view = view_of(subject->portable.header->bounds);
    for (enum ray_kind kind = 0; kind < RAY_KINDS; kind++)
        sets.rays[kind] = tree_need((size_t)size * size, sizeof *sets.rays[kind]);
    sets.counts[RAYS_PRIMARY] = make_primary(&view, size, sets.rays[RAYS_PRIMARY]);
    sets.counts[RAYS_DIFFUSE] = make_diffuse(mesh, view.size, size * size, sets.rays[RAYS_DIFFUSE]);
    make_shadow(subject, &view, &sets);
    return sets;
}

void ray_sets_finish(struct ray_sets *sets)
{
    for (enum ray_kind kind = 0; kind < RAY_KINDS; kind++)
        free(sets->rays[kind]);
}

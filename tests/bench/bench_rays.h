/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_rays.h - what benchmarks of rays through bvhd_cpu.h have in common: the rays of a picture and from their hits,
 * and subjects that take turns. An unexpected failure ends the program.
 */
#ifndef BVHD_BENCH_RAYS_H
#define BVHD_BENCH_RAYS_H

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <bvhd/bvhd_cpu.h>

#include "tests/support/random.h"

enum { BENCH_TILE = 8, BENCH_TURNS_MAX = 1000 };

/* The kinds of rays: of a picture, and from their hits in any direction, and to a light, which end at any hit. */
enum bench_kind { BENCH_PRIMARY, BENCH_DIFFUSE, BENCH_SHADOW, BENCH_KINDS };

static const char *const bench_kind_names[BENCH_KINDS] = {"primary", "diffuse", "shadow"};

/* Rays of one kind, and room for their hits. */
struct bench_rays {
    struct bvhd_cpu_ray *rays;
    struct bvhd_cpu_hit *hits;
    uint32_t count;
};

static inline void bench_fail(const char *what)
{
    fprintf(stderr, "%s: %s\n", program_invocation_short_name, what);
    exit(1);
}

/* Returns zeros, for free(). */
static inline void *bench_need(uint64_t size)
{
    void *block = calloc(size ? size : 1, 1);
    if (!block)
        bench_fail("no memory");
    return block;
}

static inline uint32_t bench_read_number(const char *text, uint32_t least, uint32_t most)
{
    const unsigned long number = strtoul(text, NULL, 10);
    return number < least ? least : number > most ? most : (uint32_t)number;
}

/* ---- Times ---- */

static inline double bench_now(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static inline int bench_compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sorts the values. */
static inline double bench_median(double *values, uint32_t count)
{
    qsort(values, count, sizeof *values, bench_compare);
    return values[count / 2];
}

/* What subjects do in turns, and on which clock that is measured. */
struct bench_turns {
    uint32_t turns;
    unsigned subjects;
    clockid_t clock;
    void (*run)(void *context, unsigned subject);
    void *context;
};

/* Fills times[subject][turn]. Each turn begins with another subject. */
static inline void bench_take_turns(const struct bench_turns *all, double (*times)[BENCH_TURNS_MAX])
{
    for (uint32_t turn = 0; turn < all->turns; turn++)
        for (unsigned i = 0; i < all->subjects; i++) {
            const unsigned which = (i + turn) % all->subjects;
            const double start = bench_now(all->clock);
            all->run(all->context, which);
            times[which][turn] = bench_now(all->clock) - start;
        }
}

/* Returns the median of how many times as long the one took as the other within a turn. */
static inline double bench_ratio(const double *one, const double *other, uint32_t turns)
{
    static double ratios[BENCH_TURNS_MAX];
    for (uint32_t turn = 0; turn < turns; turn++)
        ratios[turn] = one[turn] / other[turn];
    return bench_median(ratios, turns);
}

/* ---- Structures ---- */

/* Traces the rays in one call, and returns how many have hit. `counters` may be NULL. */
static inline uint32_t bench_trace(const struct bvhd_cpu_scene *scene, const struct bench_rays *rays,
                                   struct bvhd_cpu_counters *counters)
{
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays->rays,
                                         .ray_size = sizeof *rays->rays,
                                         .hits = rays->hits,
                                         .hit_size = sizeof *rays->hits,
                                         .ray_count = rays->count,
                                         .counters = counters};
    struct bvhd_error error;
    uint32_t hits = 0;
    if (bvhd_cpu_scene_trace(scene, &trace, &error) != BVHD_OK)
        bench_fail(error.text);
    for (uint32_t i = 0; i < rays->count; i++)
        hits += rays->hits[i].blob != BVHD_CPU_NO_BLOB;
    return hits;
}

static inline struct bvhd_cpu_scene *bench_open(const struct bvhd_cpu_blob *blobs, uint32_t count)
{
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blobs, .blob_count = count};
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error;
    if (bvhd_cpu_scene_create(&options, &scene, &error) != BVHD_OK)
        bench_fail(error.text);
    return scene;
}

/* ---- Rays ---- */

static inline struct bvhd_cpu_ray bench_ray(const double origin[3], const double direction[3], double tmin)
{
    struct bvhd_cpu_ray ray = {.tmin = (float)tmin, .tmax = FLT_MAX, .mask = 0xff};
    const double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)origin[axis];
        ray.direction[axis] = (float)(direction[axis] / length);
    }
    return ray;
}

static inline struct bench_rays bench_rays_make(uint32_t count)
{
    return (struct bench_rays){bench_need((uint64_t)count * sizeof(struct bvhd_cpu_ray)),
                               bench_need((uint64_t)count * sizeof(struct bvhd_cpu_hit)), count};
}

static inline void bench_rays_free(struct bench_rays *rays)
{
    free(rays->rays);
    free(rays->hits);
}

/*
 * Makes the rays of a picture of size * size pixels, which the rays have room for; `size` is a multiple of BENCH_TILE.
 * The camera looks at the middle from outside; rays of a tile of pixels follow one another. Returns the radius of the
 * scene.
 */
static inline double bench_make_primary(const float bounds[6], uint32_t size, struct bench_rays *rays,
                                        double ret_light[3])
{
    static const double forward[3] = {-0.6, -0.5, -0.6244998}, right[3] = {0.7211103, 0, -0.6928203},
                        up[3] = {-0.3464102, 0.8660254, -0.3605551};
    double eye[3], radius = 0;
    for (int axis = 0; axis < 3; axis++)
        radius += pow(((double)bounds[3 + axis] - bounds[axis]) / 2, 2);
    radius = sqrt(radius);
    for (int axis = 0; axis < 3; axis++) {
        const double centre = ((double)bounds[axis] + bounds[3 + axis]) / 2;
        eye[axis] = centre - 1.6 * radius * forward[axis];
        ret_light[axis] = centre + radius * (2.5 * up[axis] + 1.5 * right[axis]);
    }
    for (uint32_t i = 0; i < rays->count; i++) {
        const uint32_t tile = i / (BENCH_TILE * BENCH_TILE), pixel = i % (BENCH_TILE * BENCH_TILE),
                       row = size / BENCH_TILE;
        const double x = (tile % row * BENCH_TILE + pixel % BENCH_TILE + 0.5) / size * 2 - 1,
                     y = (tile / row * BENCH_TILE + pixel / BENCH_TILE + 0.5) / size * 2 - 1;
        double direction[3];
        for (int axis = 0; axis < 3; axis++)
            direction[axis] = forward[axis] + 0.45 * (x * right[axis] - y * up[axis]);
        rays->rays[i] = bench_ray(eye, direction, 0);
    }
    return radius;
}

/* The surface that rays have hit. */
struct bench_surface {
    /* Finds its side at a point from which a ray has hit it; false if it has none. */
    bool (*normal)(const void *context, const struct bvhd_cpu_ray *ray, const struct bvhd_cpu_hit *hit,
                   const double point[3], double ret_normal[3]);
    const void *context;
    double offset; /* by which other rays begin outside of it */
    double tmin; /* of these rays */
};

/* Makes a diffuse ray from each hit, and a shadow ray where the surface is turned to the light. */
static inline void bench_make_secondary(const struct bench_surface *surface, const struct bench_rays *primary,
                                        const double light[3], struct bench_rays *diffuse, struct bench_rays *shadow)
{
    struct random random = {1};
    diffuse->count = shadow->count = 0;
    for (uint32_t i = 0; i < primary->count; i++) {
        const struct bvhd_cpu_ray *ray = &primary->rays[i];
        const struct bvhd_cpu_hit *hit = &primary->hits[i];
        double point[3], normal[3], on_sphere[3], length, direction[3], to_light[3], facing = 0;
        if (hit->blob == BVHD_CPU_NO_BLOB)
            continue;
        for (int axis = 0; axis < 3; axis++)
            point[axis] = ray->origin[axis] + (double)hit->t * ray->direction[axis];
        if (!surface->normal(surface->context, ray, hit, point, normal))
            continue;
        do {
            random_point(&random, on_sphere);
            length = sqrt(on_sphere[0] * on_sphere[0] + on_sphere[1] * on_sphere[1] + on_sphere[2] * on_sphere[2]);
        } while (length > 1);
        for (int axis = 0; axis < 3; axis++) {
            point[axis] += surface->offset * normal[axis];
            direction[axis] = normal[axis] + on_sphere[axis] / length;
            to_light[axis] = light[axis] - point[axis];
            facing += to_light[axis] * normal[axis];
        }
        diffuse->rays[diffuse->count++] = bench_ray(point, direction, surface->tmin);
        if (facing <= 0)
            continue;
        struct bvhd_cpu_ray *to = &shadow->rays[shadow->count++];
        *to = bench_ray(point, to_light, surface->tmin);
        to->flags = BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT;
        to->tmax = (float)sqrt(to_light[0] * to_light[0] + to_light[1] * to_light[1] + to_light[2] * to_light[2]);
    }
}

#endif

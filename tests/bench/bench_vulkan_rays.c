/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bench_vulkan_rays.h"

#include <float.h>
#include <math.h>

#include "tests/bench/bench_vulkan_surface.h"
#include "client/bvhctl/picture/camera.h"
#include "tests/support/random.h"

enum { TILE_WIDTH = 8, TILE_HEIGHT = 4, CHUNK = 4096 };

const char *const bench_rays_names[RAYS_KINDS] = {"primary", "diffuse", "surface", "random"};

struct making {
    struct bench_rays *rays;
    const struct stage *stage;
    struct camera camera;
    uint32_t side; /* width of the picture in pixels */
    struct stage_hit *hits; /* of the primary rays; distance 0: a miss */
    uint32_t hit_count; /* set by close_ranks */
};

static void task_primary(void *context, size_t index)
{
    struct making *making = context;
    size_t begin, end;
    uint32_t side = making->side, columns = side / TILE_WIDTH;
    parallel_chunk(index, CHUNK, making->rays->count[RAYS_PRIMARY], &begin, &end);
    for (size_t i = begin; i < end; i++) {
        uint32_t tile = (uint32_t)i / (TILE_WIDTH * TILE_HEIGHT), pixel = (uint32_t)i % (TILE_WIDTH * TILE_HEIGHT);
        double x = (tile % columns) * TILE_WIDTH + pixel % TILE_WIDTH + 0.5,
               y = (tile / columns) * TILE_HEIGHT + pixel / TILE_WIDTH + 0.5;
        making->rays->rays[RAYS_PRIMARY][i] =
            stage_ray(making->camera.origin, camera_direction(&making->camera, x / side, y / side), 0);
    }
}

/* A direction, uniform over the unit sphere. */
static struct vector random_direction(struct random *random)
{
    double point[3], length;
    do {
        random_point(random, point);
        length = sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2]);
    } while (length > 1 || length < 1e-3);
    return (struct vector){point[0] / length, point[1] / length, point[2] / length};
}

static void task_look(void *context, size_t index)
{
    struct making *making = context;
    size_t begin, end;
    parallel_chunk(index, CHUNK, making->rays->count[RAYS_PRIMARY], &begin, &end);
    for (size_t i = begin; i < end; i++) {
        const struct ray *ray = &making->rays->rays[RAYS_PRIMARY][i];
        struct vector origin = {ray->origin[0], ray->origin[1], ray->origin[2]};
        struct vector direction = {ray->direction[0], ray->direction[1], ray->direction[2]};
        if (!stage_look(making->stage, origin, direction, 0, &making->hits[i]))
            making->hits[i].distance = 0;
    }
}

/* Compacts the hits to the front, in the order of their rays. */
static void close_ranks(struct making *making)
{
    for (uint32_t i = 0; i < making->rays->count[RAYS_PRIMARY]; i++)
        if (making->hits[i].distance > 0)
            making->hits[making->hit_count++] = making->hits[i];
}

/* Makes as many rays as there are primary ones; after the last hit it starts with the first again. */
static void task_diffuse(void *context, size_t index)
{
    struct making *making = context;
    struct random random = {index * 977 + 1};
    size_t begin, end;
    parallel_chunk(index, CHUNK, making->rays->count[RAYS_DIFFUSE], &begin, &end);
    for (size_t i = begin; i < end; i++) {
        const struct stage_hit *hit = &making->hits[i % making->hit_count];
        struct vector away = random_direction(&random);
        struct ray *ray = &making->rays->rays[RAYS_DIFFUSE][i];
        *ray = stage_ray(hit->position,
                         (struct vector){hit->normal.x + 0.999 * away.x, hit->normal.y + 0.999 * away.y,
                                         hit->normal.z + 0.999 * away.z},
                         0);
        ray->tmin = (float)(1e-5 * making->stage->size);
    }
}

static void make_random(struct making *making)
{
    struct random random = {2};
    const struct stage *stage = making->stage;
    for (uint32_t i = 0; i < making->rays->count[RAYS_RANDOM]; i++) {
        struct vector local = {random_between(&random, stage->low.x, stage->high.x),
                               random_between(&random, stage->low.y, stage->high.y),
                               random_between(&random, stage->low.z, stage->high.z)};
        making->rays->rays[RAYS_RANDOM][i] = stage_ray(stage_to_world(stage, local), random_direction(&random), 0);
    }
}

/* Allocates the rays of all wanted kinds. Diffuse rays need the primary ones, too. */
static enum bvhd_status allocate(struct making *making, const struct bench_rays_options *options, struct memory *memory,
                                 struct bvhd_error *error)
{
    uint32_t count = making->side * making->side;
    bool is_complete = true;
    for (int kind = 0; kind < RAYS_KINDS; kind++) {
        if (!options->kinds[kind] && !(kind == RAYS_PRIMARY && options->kinds[RAYS_DIFFUSE]))
            continue;
        making->rays->count[kind] = count;
        making->rays->rays[kind] = memory_array(memory, count, sizeof *making->rays->rays[kind]);
        is_complete = is_complete && making->rays->rays[kind];
    }
    if (options->kinds[RAYS_DIFFUSE]) {
        making->hits = memory_array(memory, count, sizeof *making->hits);
        is_complete = is_complete && making->hits;
    }
    return is_complete ? BVHD_OK : bvhd_error_no_memory(error, "rays", "no memory for %u rays", count);
}

static size_t chunks_of(const struct making *making, enum bench_rays_kind kind)
{
    return parallel_chunks(CHUNK, making->rays->count[kind]);
}

static enum bvhd_status make_primary(struct making *making, const struct parallel *parallel, struct memory *memory,
                                     struct bvhd_error *error)
{
    uint64_t looks;
    enum bvhd_status status = camera_choose(making->stage, &(struct camera_options){.aspect = 1}, parallel, memory,
                                            &making->camera, &looks, error);
    if (status == BVHD_OK)
        parallel_for(parallel, chunks_of(making, RAYS_PRIMARY), task_primary, making);
    return status;
}

static void make_diffuse(struct making *making, const struct parallel *parallel)
{
    parallel_for(parallel, chunks_of(making, RAYS_PRIMARY), task_look, making);
    close_ranks(making);
    if (!making->hit_count)
        making->rays->count[RAYS_DIFFUSE] = 0;
    parallel_for(parallel, chunks_of(making, RAYS_DIFFUSE), task_diffuse, making);
}

static enum bvhd_status make(struct making *making, const struct bench_scene *scene,
                             const struct bench_rays_options *options, const struct parallel *parallel,
                             struct memory *memory, struct bvhd_error *error)
{
    struct bench_rays *rays = making->rays;
    enum bvhd_status status = allocate(making, options, memory, error);
    if (status == BVHD_OK && rays->count[RAYS_PRIMARY])
        status = make_primary(making, parallel, memory, error);
    if (status != BVHD_OK)
        return status;
    if (rays->count[RAYS_DIFFUSE])
        make_diffuse(making, parallel);
    make_random(making);
    if (rays->count[RAYS_SURFACE])
        status = bench_surface_rays(scene, (float)(1e-5 * making->stage->size), rays->count[RAYS_SURFACE],
                                    rays->rays[RAYS_SURFACE], &rays->count[RAYS_SURFACE], error);
    return status;
}

enum bvhd_status bench_rays_make(const struct bench_scene *scene, const struct bench_rays_options *options,
                                 const struct parallel *parallel, struct memory *memory, struct bench_rays *ret_rays,
                                 struct bvhd_error *error)
{
    struct stage stage;
    struct bench_rays rays = {.memory = memory};
    struct making making = {.rays = &rays, .stage = &stage};
    enum bvhd_status status = stage_init(&stage, &scene->given, 'a', (struct stage_times){0, 1}, memory, error);
    if (status != BVHD_OK)
        return status;
    making.side = (uint32_t)sqrt((double)options->count + 0.5) / TILE_WIDTH * TILE_WIDTH;
    making.side = making.side < TILE_WIDTH ? TILE_WIDTH : making.side;
    status = make(&making, scene, options, parallel, memory, error);
    memory_free(memory, making.hits);
    stage_finish(&stage);
    if (status != BVHD_OK)
        bench_rays_finish(&rays);
    else
        *ret_rays = rays;
    return status;
}

void bench_rays_finish(struct bench_rays *rays)
{
    for (int kind = 0; kind < RAYS_KINDS; kind++)
        memory_free(rays->memory, rays->rays[kind]);
    *rays = (struct bench_rays){0};
}

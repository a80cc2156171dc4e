/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/stage.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/round_surface.h"
#include "client/bvhctl/picture/stage_bulk.h"
#include "client/bvhctl/picture/stage_samples.h"

struct ray stage_ray(struct vector origin, struct vector direction, float time)
{
    return (struct ray){.origin = {(float)origin.x, (float)origin.y, (float)origin.z},
                        .direction = {(float)direction.x, (float)direction.y, (float)direction.z},
                        .tmin = 0,
                        .tmax = FLT_MAX,
                        .cull_mask = 0xff,
                        .time = time};
}

float stage_time(const struct stage *stage, double fraction)
{
    const double first = (double)stage->times.first, last = (double)stage->times.last;
    return (float)fmin(first + (last - first) * fraction, last);
}

static int compare_instances(const void *a, const void *b)
{
    uint32_t x = ((const struct structure_instance *)a)->instance, y = ((const struct structure_instance *)b)->instance;
    return (x > y) - (x < y);
}

/* Returns the instance at position `instance` of the request, which must be in the top level. */
static const struct structure_instance *stage_instance(const struct stage *stage, uint32_t instance)
{
    const struct structure_instance wanted = {.instance = instance};
    return bsearch(&wanted, stage->instances, stage->instance_count, sizeof wanted, compare_instances);
}

static struct vector world_normal(const struct stage *stage, const struct ray_hit *hit, struct vector position,
                                  float time)
{
    float corners[3][3], matrix[12];
    struct vector p[3];
    bool has_top = stage->structures->has_top;
    const struct structure *bottom = &stage->structures->files[hit->handle].structure;
    if (has_top)
        structure_instance_matrix(stage_instance(stage, hit->instance), time, matrix);
    if (structure_round_count(bottom)) {
        struct structure_round round = structure_round(bottom, hit->record);
        return round_surface_normal(&round, has_top ? matrix : NULL, position, (double)hit->u);
    }
    structures_corners(stage->structures, hit, time, corners);
    for (int i = 0; i < 3; i++) {
        p[i] = vector_from_floats(corners[i]);
        if (has_top)
            p[i] = vector_transform(matrix, p[i]);
    }
    return vector_normal(p);
}

bool stage_look(const struct stage *stage, struct vector origin, struct vector direction, float time,
                struct stage_hit *ret_hit)
{
    struct ray ray = stage_ray(origin, direction, time);
    struct ray_hit hit;
    if (!structures_trace(stage->structures, &ray, &hit))
        return false;
    struct vector position =
        vector_mad(vector_from_floats(ray.origin), vector_from_floats(ray.direction), (double)hit.t);
    struct vector normal = hit.is_aabb ? vector_scale(direction, -1) : world_normal(stage, &hit, position, time);
    bool is_back = vector_dot(normal, direction) > 0;
    if (is_back)
        normal = vector_scale(normal, -1);
    *ret_hit = (struct stage_hit){.position = position,
                                  .normal = normal,
                                  .distance = (double)hit.t,
                                  .is_back = is_back,
                                  .instance = stage->structures->has_top ? hit.instance : 0,
                                  .handle = hit.handle,
                                  .geometry = hit.geometry};
    return true;
}

double stage_clearance(const struct stage *stage, struct vector origin, struct vector direction, float time)
{
    struct ray ray = stage_ray(origin, direction, time);
    struct ray_hit hit;
    return structures_trace(stage->structures, &ray, &hit) ? (double)hit.t : INFINITY;
}

double stage_cost(const struct stage *stage)
{
    enum { RAYS = 128 };
    struct ray rays[RAYS];
    float distances[RAYS];
    struct bvhd_cpu_counters counters = {.struct_size = sizeof counters};
    uint64_t state = 0xc057;
    for (int i = 0; i < RAYS; i++) {
        const struct stage_sample *from = &stage->samples[rays_random(&state) % stage->sample_count];
        struct vector to = stage->samples[rays_random(&state) % stage->sample_count].at;
        struct vector forward = vector_unit(vector_sub(to, from->at));
        rays[i] = stage_ray(vector_mad(from->at, forward, -stage->size), forward, from->time);
    }
    const struct bvhd_cpu_trace trace = {
        .struct_size = sizeof trace,
        .rays = rays,
        .ray_size = sizeof *rays,
        .hits = distances,
        .hit_size = sizeof *distances,
        .ray_count = RAYS,
        .counters = &counters,
    };
    bvhd_cpu_scene_trace(stage->structures->scene, &trace, NULL);
    return (double)counters.triangles / RAYS;
}

struct vector stage_leave(const struct stage *stage, const struct stage_hit *hit)
{
    const struct vector *p = &hit->position;
    double magnitude = fmax(fmax(fabs(p->x), fabs(p->y)), fmax(fabs(p->z), hit->distance));
    return vector_mad(*p, hit->normal, 4 * FLT_EPSILON * magnitude + 1e-6 * stage->size);
}

struct vector stage_to_local(const struct stage *stage, struct vector point)
{
    return vector_make(vector_dot(point, stage->east), vector_dot(point, stage->north), vector_dot(point, stage->up));
}

struct vector stage_to_world(const struct stage *stage, struct vector local)
{
    return vector_mad(vector_mad(vector_scale(stage->east, local.x), stage->north, local.y), stage->up, local.z);
}

static uint64_t count_primitives(const struct structure *bottom)
{
    return (uint64_t)structure_triangle_count(bottom) + structure_round_count(bottom);
}

static enum bvhd_status find_instances(struct stage *stage, struct bvhd_error *error)
{
    const struct structure_file *files = stage->structures->files;
    const struct structure *top = structures_top(stage->structures);
    if (!top) {
        stage->primitive_count = count_primitives(&files[0].structure);
        return BVHD_OK;
    }
    stage->instance_count = structure_instance_count(top);
    stage->instances = memory_array(stage->memory, (uint64_t)stage->instance_count + 1, sizeof *stage->instances);
    if (!stage->instances)
        return bvhd_error_no_memory(error, "trace", "no memory for the instances");
    for (uint32_t i = 0; i < stage->instance_count; i++) {
        stage->instances[i] = structure_instance(top, i);
        stage->primitive_count += count_primitives(&files[stage->instances[i].bottom].structure);
    }
    qsort(stage->instances, stage->instance_count, sizeof *stage->instances, compare_instances);
    return BVHD_OK;
}

static enum bvhd_status find_bulk(struct stage *stage, char up, struct bvhd_error *error)
{
    stage->samples = memory_array(stage->memory, STAGE_SAMPLES, sizeof *stage->samples);
    if (!stage->samples)
        return bvhd_error_no_memory(error, "trace", "no memory for samples of the scene");
    stage_samples_take(stage);
    if (stage->even_count == 0)
        return bvhd_error_set(error, BVHD_INVALID, "trace", "the scene has no visible primitive");
    if (!stage_bulk_find(stage, up))
        return bvhd_error_no_memory(error, "trace", "no memory for samples of the scene");
    return BVHD_OK;
}

static bool has_motion(const struct structures *structures)
{
    for (uint32_t i = 0; i < structures->file_count; i++)
        if (structures->files[i].structure.moves)
            return true;
    return false;
}

enum bvhd_status stage_init(struct stage *stage, const struct structures *structures, char up, struct stage_times times,
                            struct memory *memory, struct bvhd_error *error)
{
    *stage = (struct stage){.structures = structures, .times = times, .memory = memory};
    stage->is_blurred = times.first < times.last && has_motion(structures);
    enum bvhd_status status = find_instances(stage, error);
    if (status == BVHD_OK)
        status = find_bulk(stage, up, error);
    if (status != BVHD_OK)
        stage_finish(stage);
    return status;
}

void stage_finish(struct stage *stage)
{
    if (!stage || !stage->memory)
        return;
    memory_free(stage->memory, stage->instances);
    memory_free(stage->memory, stage->samples);
    *stage = (struct stage){0};
}

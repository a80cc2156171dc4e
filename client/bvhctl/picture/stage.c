/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/stage.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/oracle/rays.h"

/* The number of samples in a thousand that the extent of the scene ignores at each end of each axis. */
enum { OUTLIERS = 4 };

enum { MANY_INSTANCES = 16 };

enum {
    TOUR_STRIDE = 8, /* triangles that are visited for each one that a sample is taken from */
    FEW_TRIANGLES = 4096, /* of fewer triangles, each one gives a sample */
    FEWEST_SAMPLES = 256, /* that are needed to find an extent; of fewer triangles, each one gives several */
};

/* The factor by which the whole scene may be larger than the bulk before the rest counts as outliers. */
static const double clear_of_box = 1.6;

struct ray stage_ray(struct vector origin, struct vector direction)
{
    return (struct ray){.origin = {(float)origin.x, (float)origin.y, (float)origin.z},
                        .direction = {(float)direction.x, (float)direction.y, (float)direction.z},
                        .tmin = 0,
                        .tmax = FLT_MAX,
                        .cull_mask = 0xff};
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

static struct vector world_normal(const struct stage *stage, const struct ray_hit *hit)
{
    float corners[3][3];
    struct vector p[3];
    structures_corners(stage->structures, hit, corners);
    for (int i = 0; i < 3; i++) {
        p[i] = vector_from_floats(corners[i]);
        if (stage->structures->has_top)
            p[i] = vector_transform(stage_instance(stage, hit->instance)->object_to_world, p[i]);
    }
    return vector_normal(p);
}

bool stage_look(const struct stage *stage, struct vector origin, struct vector direction, struct stage_hit *ret_hit)
{
    struct ray ray = stage_ray(origin, direction);
    struct ray_hit hit;
    if (!structures_trace(stage->structures, &ray, NULL, &hit))
        return false;
    struct vector normal = hit.is_aabb ? vector_scale(direction, -1) : world_normal(stage, &hit);
    if (vector_dot(normal, direction) > 0)
        normal = vector_scale(normal, -1);
    *ret_hit = (struct stage_hit){
        .position = vector_mad(vector_from_floats(ray.origin), vector_from_floats(ray.direction), (double)hit.t),
        .normal = normal,
        .distance = (double)hit.t,
        .instance = stage->structures->has_top ? hit.instance : 0,
        .handle = hit.handle,
        .geometry = hit.geometry};
    return true;
}

double stage_clearance(const struct stage *stage, struct vector origin, struct vector direction)
{
    struct ray ray = stage_ray(origin, direction);
    struct ray_hit hit;
    return structures_trace(stage->structures, &ray, NULL, &hit) ? (double)hit.t : INFINITY;
}

double stage_cost(const struct stage *stage)
{
    enum { RAYS = 128 };
    struct traverse_counters counters = {0};
    uint64_t state = 0xc057;
    for (int i = 0; i < RAYS; i++) {
        struct vector from = stage->samples[rays_random(&state) % stage->sample_count];
        struct vector to = stage->samples[rays_random(&state) % stage->sample_count];
        struct vector forward = vector_unit(vector_sub(to, from));
        struct ray ray = stage_ray(vector_mad(from, forward, -stage->size), forward);
        struct ray_hit hit;
        structures_trace_counted(stage->structures, &ray, NULL, &hit, &counters);
    }
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

static enum bvhd_status find_instances(struct stage *stage, struct bvhd_error *error)
{
    const struct structure_file *files = stage->structures->files;
    const struct structure *top = structures_top(stage->structures);
    if (!top) {
        stage->triangle_count = structure_triangle_count(&files[0].structure);
        return BVHD_OK;
    }
    stage->instance_count = structure_instance_count(top);
    stage->instances = memory_array(stage->memory, (uint64_t)stage->instance_count + 1, sizeof *stage->instances);
    if (!stage->instances)
        return bvhd_error_no_memory(error, "trace", "no memory for the instances");
    for (uint32_t i = 0; i < stage->instance_count; i++) {
        stage->instances[i] = structure_instance(top, i);
        stage->triangle_count += structure_triangle_count(&files[stage->instances[i].bottom].structure);
    }
    qsort(stage->instances, stage->instance_count, sizeof *stage->instances, compare_instances);
    return BVHD_OK;
}

static struct vector random_point(const struct vector corners[3], uint64_t *state)
{
    double u = rays_uniform(state), v = rays_uniform(state);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    return vector_mad(vector_mad(vector_scale(corners[0], 1 - u - v), corners[1], u), corners[2], v);
}

/* A pass over the triangles of all instances, of which it visits some, in order. */
struct tour {
    struct stage *stage;
    uint64_t state; /* of random numbers */
    /* samples by area: the area so far, its distance between samples (0: it is only added up), and that of the next */
    double area, area_step, area_next;
    uint64_t seen, stride, repeats; /* samples by number: `repeats` from one of each `stride` triangles that are seen */
    /*
     * states of random numbers, for the triangles that are visited and for those that are picked. Regular steps could
     * find the same triangles in every instance, because instances repeat
     */
    uint64_t place, pick;
    uint64_t picked; /* which of the next `stride` triangles gives samples */
};

static void add_sample(struct tour *tour, const struct vector corners[3])
{
    struct stage *stage = tour->stage;
    struct vector point = random_point(corners, &tour->state);
    if (stage->sample_count < STAGE_SAMPLES && isfinite(point.x) && isfinite(point.y) && isfinite(point.z))
        stage->samples[stage->sample_count++] = point;
}

static void visit_triangle(struct tour *tour, const struct structure *bottom, const float *transform, uint32_t row)
{
    float exact[3][3];
    struct vector corners[3];
    uint32_t primitive;
    structure_triangle(bottom, row, exact, &primitive);
    for (int i = 0; i < 3; i++) {
        corners[i] = vector_from_floats(exact[i]);
        corners[i] = transform ? vector_transform(transform, corners[i]) : corners[i];
    }
    if (tour->seen % tour->stride == 0)
        tour->picked = rays_random(&tour->pick) % tour->stride;
    bool is_chosen = tour->seen++ % tour->stride == tour->picked && tour->area_step == 0;
    for (uint64_t i = 0; i < tour->repeats && is_chosen; i++)
        add_sample(tour, corners);
    struct vector normal = vector_cross(vector_sub(corners[1], corners[0]), vector_sub(corners[2], corners[0]));
    double area = vector_length(normal);
    tour->area += isfinite(area) ? area : 0;
    for (; tour->area_step > 0 && tour->area_next < tour->area && isfinite(area); tour->area_next += tour->area_step)
        add_sample(tour, corners);
}

static void take_tour(struct tour *tour)
{
    const struct stage *stage = tour->stage;
    const struct structure_file *files = stage->structures->files;
    uint32_t source_count = stage->structures->has_top ? stage->instance_count : 1;
    double step = fmax(1, (double)stage->triangle_count / (STAGE_EVEN_SAMPLES * TOUR_STRIDE));
    double next = 0, at = rays_uniform(&tour->place) * step, base = 0;
    for (uint32_t i = 0; i < source_count; i++) {
        const struct structure_instance *instance = stage->structures->has_top ? &stage->instances[i] : NULL;
        const struct structure *bottom = &files[instance ? instance->bottom : 0].structure;
        double count = structure_triangle_count(bottom);
        for (; at < base + count; at = next + rays_uniform(&tour->place) * step) {
            visit_triangle(tour, bottom, instance ? instance->object_to_world : NULL, (uint32_t)(at - base));
            next += step;
        }
        base += count;
    }
}

/* Takes samples by number, which show where most triangles are, and then by area, which show what is most visible. */
static void sample_triangles(struct stage *stage)
{
    uint64_t count = stage->triangle_count;
    struct tour by_number = {
        .stage = stage, .state = 0x5eed, .stride = count < FEW_TRIANGLES ? 1 : TOUR_STRIDE, .repeats = 1};
    if (count > 0 && count < FEWEST_SAMPLES)
        by_number.repeats = (FEWEST_SAMPLES + count - 1) / count;
    take_tour(&by_number);
    stage->even_count = stage->sample_count;
    struct tour by_area = {.stage = stage, .state = 0xa4ea, .stride = 1};
    by_area.area_step = by_number.area / (STAGE_SAMPLES - STAGE_EVEN_SAMPLES);
    if (by_area.area_step > 0)
        take_tour(&by_area);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void set_component(struct vector *vector, int axis, double value)
{
    *(axis == 0 ? &vector->x : axis == 1 ? &vector->y : &vector->z) = value;
}

/*
 * Measures the extent of nearly all samples along each axis, or that of everything if it is not much larger. `axes` are
 * those of the world, in any order. `sorted` has room for all samples.
 */
static void measure(const struct stage *stage, const int axes[3], double *sorted, struct vector *ret_low,
                    struct vector *ret_high)
{
    const struct structure *top = structures_top(stage->structures);
    float bounds[6];
    structure_bounds(top ? top : &stage->structures->files[0].structure, bounds);
    uint32_t count = stage->even_count, cut = count * OUTLIERS / 1000;
    for (int i = 0; i < 3; i++) {
        for (uint32_t k = 0; k < count; k++)
            sorted[k] = vector_component(stage->samples[k], axes[i]);
        qsort(sorted, count, sizeof *sorted, compare_doubles);
        double low = sorted[cut], high = sorted[count - 1 - cut];
        double least = (double)bounds[axes[i]], most = (double)bounds[3 + axes[i]];
        bool all = most - least <= clear_of_box * (high - low);
        set_component(ret_low, i, all ? least : low);
        set_component(ret_high, i, all ? most : high);
    }
}

/* Returns the extent of the positions of the instances. */
static struct vector spread_of_instances(const struct stage *stage)
{
    struct vector low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (uint32_t i = 0; i < stage->instance_count; i++)
        for (int axis = 0; axis < 3; axis++) {
            double at = (double)stage->instances[i].object_to_world[4 * axis + 3];
            set_component(&low, axis, fmin(vector_component(low, axis), at));
            set_component(&high, axis, fmax(vector_component(high, axis), at));
        }
    return vector_sub(high, low);
}

/*
 * Guesses the axis that points up. Most models that were made for pictures have y up. Those that are thin along z, such
 * as maps, terrain and plans, have z up, and so have scenes of many instances in one plane perpendicular to z.
 */
static char guess_up(const struct stage *stage, double *sorted)
{
    struct vector low = {0}, high = {0};
    measure(stage, (const int[3]){0, 1, 2}, sorted, &low, &high);
    struct vector extent = stage->instance_count >= MANY_INSTANCES ? spread_of_instances(stage) : vector_sub(high, low);
    return extent.z < 0.5 * fmin(extent.x, extent.y) ? 'z' : 'y';
}

static void orient(struct stage *stage, char up, double *sorted)
{
    static const struct vector units[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    int axis = up == 'x' ? 0 : up == 'y' ? 1 : 2;
    const int axes[3] = {(axis + 1) % 3, (axis + 2) % 3, axis};
    stage->east = units[axes[0]];
    stage->north = units[axes[1]];
    stage->up = units[axes[2]];
    measure(stage, axes, sorted, &stage->low, &stage->high);
}

static enum bvhd_status find_bulk(struct stage *stage, char up, struct bvhd_error *error)
{
    double *sorted = memory_array(stage->memory, STAGE_SAMPLES, sizeof *sorted);
    stage->samples = memory_array(stage->memory, STAGE_SAMPLES, sizeof *stage->samples);
    enum bvhd_status status = BVHD_OK;
    if (!sorted || !stage->samples)
        status = bvhd_error_no_memory(error, "trace", "no memory for samples of the scene");
    else
        sample_triangles(stage);
    if (status == BVHD_OK && stage->even_count == 0)
        status = bvhd_error_set(error, BVHD_INVALID, "trace", "the scene has no visible triangle");
    if (status == BVHD_OK) {
        orient(stage, up == 'a' ? guess_up(stage, sorted) : up, sorted);
        stage->size = fmax(vector_length(vector_sub(stage->high, stage->low)), 1e-44);
        stage->floor = stage->low.z - 1e-4 * stage->size;
    }
    memory_free(stage->memory, sorted);
    return status;
}

enum bvhd_status stage_init(struct stage *stage, const struct structures *structures, char up, struct memory *memory,
                            struct bvhd_error *error)
{
    *stage = (struct stage){.structures = structures, .memory = memory};
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

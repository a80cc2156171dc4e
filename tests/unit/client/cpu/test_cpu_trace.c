/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_cpu_trace.c - tests that rays through bvhd_cpu.h have the answers of the internal function, whatever the shape
 * of the arrays, that candidates are told all about themselves, and that wrong calls are refused.
 */
#include "tests/support/client/cpu/cpu_bed.h"

#include <pthread.h>

#include "client/cpu/cpu_scene.h"

enum { RAYS = 1500 };

static struct cpu_bed beds[2]; /* portable, native */
static struct bvhd_cpu_scene *scenes[2];
static struct bvhd_cpu_ray rays[RAYS];

static int open_beds(void **state)
{
    struct random random = {3};
    (void)state;
    for (int i = 0; i < 2; i++) {
        cpu_bed_init(&beds[i], i);
        scenes[i] = cpu_bed_open(beds[i].blobs, CPU_BED_BLOBS);
    }
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i] = cpu_bed_ray(&random, i);
    return 0;
}

static int close_beds(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++)
        bvhd_cpu_scene_destroy(scenes[i]);
    for (int i = 0; i < 2; i++)
        cpu_bed_finish(&beds[i]);
    return 0;
}

static void assert_miss(const struct bvhd_cpu_hit *hit)
{
    static const struct bvhd_cpu_hit miss = {.t = INFINITY, .instance = BVHD_CPU_NO_INSTANCE, .blob = BVHD_CPU_NO_BLOB};
    assert_memory_equal(hit, &miss, sizeof miss);
}

static void assert_hit(const struct bvhd_cpu_hit *hit, const struct ray_hit *expected)
{
    assert_true(hit->t == expected->t && hit->u == expected->u && hit->v == expected->v);
    assert_int_equal(hit->instance, expected->instance);
    assert_int_equal(hit->custom_index, expected->custom_index);
    assert_int_equal(hit->geometry, expected->geometry);
    assert_int_equal(hit->primitive, expected->primitive);
    assert_int_equal(hit->flags, (expected->front_face ? BVHD_CPU_HIT_FRONT_FACE : 0) |
                                     (expected->is_aabb ? BVHD_CPU_HIT_AABB : 0));
    assert_int_equal(hit->sbt_offset, expected->sbt_offset);
    assert_int_equal(hit->blob, expected->handle);
    assert_int_equal(hit->record, expected->record);
}

/* All rays in one call and one ray in each call give the hits of the internal function. */
static void hits_are_those_of_the_internal_function(void **state)
{
    static struct bvhd_cpu_hit hits[RAYS];
    (void)state;
    for (int i = 0; i < 2; i++) {
        int found = 0, boxes = 0, fronts = 0;
        struct bvhd_cpu_trace trace = cpu_bed_trace(rays, hits, RAYS);
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        for (uint32_t k = 0; k < RAYS; k++) {
            struct ray_hit expected;
            struct bvhd_cpu_hit one;
            bool is_hit = cpu_bed_expect(&beds[i], &rays[k], NULL, &expected);
            const struct bvhd_cpu_trace single = cpu_bed_trace(&rays[k], &one, 1);
            assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &single, NULL), BVHD_OK);
            assert_memory_equal(&one, &hits[k], sizeof one);
            if (is_hit)
                assert_hit(&hits[k], &expected);
            else
                assert_miss(&hits[k]);
            found += is_hit;
            boxes += is_hit && expected.is_aabb;
            fronts += is_hit && expected.front_face;
        }
        assert_true(found > RAYS / 4 && found < RAYS && boxes > 20 && boxes < found && fronts > 20);
    }
}

/* Arrays of other structs, parts of hits, unaligned ones, rays without a time, and the opposite order of visits. */
static void arrays_have_any_shape(void **state)
{
    enum { HIT_PLACE = sizeof(struct bvhd_cpu_hit) + 3 };
    struct own {
        char name[4];
        struct bvhd_cpu_ray ray;
        double weight;
    };
    static struct own own[RAYS];
    static struct bvhd_cpu_hit hits[RAYS];
    static float distances[RAYS];
    static unsigned char loose[RAYS * HIT_PLACE + 1];
    (void)state;
    for (int i = 0; i < RAYS; i++)
        own[i].ray = rays[i];
    struct bvhd_cpu_trace trace = cpu_bed_trace(rays, hits, RAYS);
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &trace, NULL), BVHD_OK);

    trace.rays = &own[0].ray;
    trace.ray_stride = sizeof own[0];
    trace.hits = distances;
    trace.hit_size = sizeof *distances;
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &trace, NULL), BVHD_OK);
    for (int i = 0; i < RAYS; i++) {
        assert_true(distances[i] == hits[i].t);
        own[i].ray.time = NAN;
    }

    trace.ray_size = 40;
    trace.hits = loose + 1;
    trace.hit_size = sizeof *hits;
    trace.hit_stride = HIT_PLACE;
    trace.flags = BVHD_CPU_TRACE_FLIP_ORDER;
    memset(loose, 0xee, sizeof loose);
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &trace, NULL), BVHD_OK);
    for (int i = 0; i < RAYS; i++) {
        assert_memory_equal(loose + 1 + i * HIT_PLACE, &hits[i], sizeof *hits);
        assert_int_equal(loose[1 + i * HIT_PLACE + (int)sizeof *hits], 0xee);
    }
}

static void any_hit_is_found_where_there_is_one(void **state)
{
    static struct bvhd_cpu_hit closest[RAYS], any[RAYS], own[RAYS];
    static struct bvhd_cpu_ray ending[RAYS];
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bvhd_cpu_trace trace = cpu_bed_trace(rays, closest, RAYS);
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        trace.hits = any;
        trace.flags = BVHD_CPU_TRACE_ANY_HIT;
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        trace.flags = 0;
        trace.rays = ending;
        trace.hits = own;
        int farther = 0;
        for (int k = 0; k < RAYS; k++) {
            ending[k] = rays[k];
            ending[k].flags |= BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT;
        }
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        assert_memory_equal(own, any, sizeof any);
        for (int k = 0; k < RAYS; k++) {
            assert_int_equal(any[k].blob == BVHD_CPU_NO_BLOB, closest[k].blob == BVHD_CPU_NO_BLOB);
            assert_true(any[k].t >= closest[k].t);
            farther += any[k].t > closest[k].t;
        }
        assert_true(farther > 0);
    }
}

/* ---- candidates ---- */

static uint32_t verdict_on(uint32_t instance, uint32_t geometry, uint32_t primitive)
{
    struct random random = {((uint64_t)(instance + 1) * 8191 + geometry) * 8191 + primitive};
    return (uint32_t)(random_next(&random) >> 20) & 3;
}

struct asked {
    const struct cpu_bed *bed;
    const struct bvhd_cpu_ray *rays;
    uint32_t count, boxes, opaque, ends[4];
};

static enum candidate_verdict decide_inside(void *context, const struct ray *ray, const struct candidate_space *space,
                                            struct ray_hit *hit)
{
    struct asked *asked = context;
    (void)ray;
    (void)space;
    asked->count++;
    if (hit->is_aabb)
        hit->t += 0.01f;
    return (enum candidate_verdict)verdict_on(hit->instance, hit->geometry, hit->primitive);
}

static void assert_near(double a, double b)
{
    assert_true(fabs(a - b) <= 1e-4 * (1 + fabs(a) + fabs(b)));
}

/* The ray and the matrices are those of the instance, and inverse to each other. */
static void check_space(const struct bvhd_cpu_candidate *candidate, const struct test_instance *instance)
{
    const float *m = candidate->object_to_world, *inverse = candidate->world_to_object;
    const struct bvhd_cpu_ray *ray = candidate->ray;
    assert_memory_equal(m, instance->transform, sizeof instance->transform);
    for (int row = 0; row < 3; row++) {
        double origin = m[4 * row + 3], direction = 0, back = inverse[4 * row + 3];
        for (int k = 0; k < 3; k++) {
            origin += (double)m[4 * row + k] * candidate->object_origin[k];
            direction += (double)m[4 * row + k] * candidate->object_direction[k];
            back += (double)inverse[4 * row + k] * ray->origin[k];
        }
        assert_near(origin, ray->origin[row]);
        assert_near(direction, ray->direction[row]);
        assert_near(back, candidate->object_origin[row]);
    }
}

static uint32_t decide_outside(void *context, struct bvhd_cpu_candidate *candidate)
{
    struct asked *asked = context;
    struct bvhd_cpu_hit *hit = candidate->hit;
    const struct test_instance *instance = &asked->bed->instances[hit->instance];
    assert_ptr_equal(candidate->ray, &asked->rays[candidate->ray_index]);
    assert_int_equal(hit->custom_index, instance->custom_index);
    assert_int_equal(hit->sbt_offset, instance->sbt_offset);
    assert_int_equal(hit->blob, instance->bottom);
    assert_int_equal(!!(hit->flags & BVHD_CPU_HIT_AABB), instance->bottom == 1);
    assert_true(hit->t <= candidate->tmax * (1 + FLT_EPSILON) && hit->u >= 0 && hit->v >= 0 &&
                hit->u + hit->v <= 1.001f);
    check_space(candidate, instance);
    asked->count++;
    asked->opaque += candidate->is_opaque;
    if (hit->flags & BVHD_CPU_HIT_AABB) {
        hit->t += 0.01f;
        asked->boxes++;
    } else {
        assert_int_equal(candidate->is_opaque, 0);
    }
    uint32_t verdict = verdict_on(hit->instance, hit->geometry, hit->primitive);
    asked->ends[verdict]++;
    return verdict | 0xf0; /* other bits mean nothing */
}

static void candidates_are_asked_about(void **state)
{
    static struct bvhd_cpu_hit hits[RAYS];
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct asked inside = {0}, outside = {.bed = &beds[i], .rays = rays};
        const struct traverse_options options = {.candidate = decide_inside, .context = &inside};
        struct bvhd_cpu_trace trace = cpu_bed_trace(rays, hits, RAYS);
        trace.candidate = decide_outside;
        trace.context = &outside;
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        for (int k = 0; k < RAYS; k++) {
            struct ray_hit expected;
            if (cpu_bed_expect(&beds[i], &rays[k], &options, &expected))
                assert_hit(&hits[k], &expected);
            else
                assert_miss(&hits[k]);
        }
        assert_int_equal(inside.count, outside.count);
        assert_true(outside.boxes > 100 && outside.count > outside.boxes + 100 && outside.opaque > 10);
        for (int verdict = 0; verdict < 4; verdict++)
            assert_true(outside.ends[verdict] > 20);
    }
}

static uint32_t answer(void *context, struct bvhd_cpu_candidate *candidate)
{
    (void)candidate;
    return *(const uint32_t *)context;
}

static uint32_t never(void *context, struct bvhd_cpu_candidate *candidate)
{
    (void)context;
    (void)candidate;
    fail_msg("opaque triangles are no candidates");
    return BVHD_CPU_IGNORE;
}

/* A ray that ends without a confirmation keeps what was confirmed before: here nothing, since all is candidates. */
static void verdicts_end_rays(void **state)
{
    uint32_t verdict = BVHD_CPU_TERMINATE;
    struct bvhd_cpu_ray ray = {.tmax = 10, .mask = 0xff, .flags = BVHD_CPU_RAY_NO_OPAQUE};
    struct bvhd_cpu_hit hit, closest;
    (void)state;
    const float *triangle = beds[0].corners[0][0];
    for (int axis = 0; axis < 3; axis++) {
        float centre = (triangle[axis] + triangle[3 + axis] + triangle[6 + axis]) / 3;
        ray.origin[axis] = centre * 5;
        ray.direction[axis] = -centre * 4;
    }
    struct bvhd_cpu_scene *alone = cpu_bed_open(beds[0].blobs, 1);
    struct bvhd_cpu_trace trace = cpu_bed_trace(&ray, &hit, 1);
    trace.candidate = answer;
    trace.context = &verdict;
    assert_int_equal(bvhd_cpu_scene_trace(alone, &trace, NULL), BVHD_OK);
    assert_miss(&hit);
    verdict = BVHD_CPU_IGNORE;
    assert_int_equal(bvhd_cpu_scene_trace(alone, &trace, NULL), BVHD_OK);
    assert_miss(&hit);
    verdict = BVHD_CPU_CONFIRM;
    trace.hits = &closest;
    assert_int_equal(bvhd_cpu_scene_trace(alone, &trace, NULL), BVHD_OK);
    assert_true(closest.t > 0 && closest.t <= 1.0001f && closest.instance == BVHD_CPU_NO_INSTANCE && closest.blob == 0);
    verdict = BVHD_CPU_CONFIRM | BVHD_CPU_TERMINATE;
    trace.hits = &hit;
    assert_int_equal(bvhd_cpu_scene_trace(alone, &trace, NULL), BVHD_OK);
    assert_true(hit.blob == 0 && hit.t >= closest.t);
    ray.flags = BVHD_CPU_RAY_OPAQUE;
    trace.candidate = never;
    assert_int_equal(bvhd_cpu_scene_trace(alone, &trace, NULL), BVHD_OK);
    assert_memory_equal(&hit, &closest, sizeof hit);
    bvhd_cpu_scene_destroy(alone);
}

/* ---- what belongs to hits ---- */

static void hits_lead_to_corners_and_transforms(void **state)
{
    static struct bvhd_cpu_hit hits[RAYS];
    (void)state;
    for (int i = 0; i < 2; i++) {
        int triangles = 0;
        const struct bvhd_cpu_trace trace = cpu_bed_trace(rays, hits, RAYS);
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        for (int k = 0; k < RAYS; k++) {
            float corners[3][3] = {{7}}, matrix[12] = {7};
            struct bvhd_error error = {0};
            if (hits[k].blob == BVHD_CPU_NO_BLOB) {
                assert_int_equal(bvhd_cpu_scene_object_to_world(scenes[i], &hits[k], matrix, &error), BVHD_INVALID);
                assert_string_equal(error.where, "hit.blob");
                assert_true(matrix[0] == 7);
                continue;
            }
            assert_int_equal(bvhd_cpu_scene_object_to_world(scenes[i], &hits[k], matrix, NULL), BVHD_OK);
            assert_memory_equal(matrix, beds[i].instances[hits[k].instance].transform, sizeof matrix);
            bool is_box = hits[k].flags & BVHD_CPU_HIT_AABB;
            assert_int_equal(bvhd_cpu_scene_corners(scenes[i], &hits[k], corners, &error),
                             is_box ? BVHD_INVALID : BVHD_OK);
            if (is_box) {
                assert_true(corners[0][0] == 7);
                continue;
            }
            uint32_t primitive = hits[k].primitive + (hits[k].geometry ? CPU_BED_TRIANGLES / 2 : 0);
            assert_memory_equal(corners, beds[i].corners[primitive], sizeof corners);
            triangles++;
        }
        assert_true(triangles > 100);
        struct bvhd_cpu_hit made = {.blob = 0, .record = 1u << 30};
        float corners[3][3], matrix[12];
        assert_int_equal(bvhd_cpu_scene_corners(scenes[i], &made, corners, NULL), BVHD_INVALID);
        made = (struct bvhd_cpu_hit){.blob = 2};
        assert_int_equal(bvhd_cpu_scene_corners(scenes[i], &made, corners, NULL), BVHD_INVALID);
        made = (struct bvhd_cpu_hit){.blob = 1};
        assert_int_equal(bvhd_cpu_scene_corners(scenes[i], &made, corners, NULL), BVHD_INVALID);
        made = (struct bvhd_cpu_hit){.instance_record = CPU_BED_INSTANCES};
        assert_int_equal(bvhd_cpu_scene_object_to_world(scenes[i], &made, matrix, NULL), BVHD_INVALID);
        assert_int_equal(bvhd_cpu_scene_corners(scenes[i], NULL, corners, NULL), BVHD_INVALID);
        assert_int_equal(bvhd_cpu_scene_object_to_world(NULL, &made, matrix, NULL), BVHD_INVALID);
    }
}

static void one_level_has_no_transform(void **state)
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct bvhd_cpu_hit hit = {.blob = 0}, other = {.blob = 0, .instance_record = 1};
        struct bvhd_cpu_scene *alone = cpu_bed_open(beds[i].blobs, 1);
        float matrix[12];
        assert_int_equal(bvhd_cpu_scene_object_to_world(alone, &hit, matrix, NULL), BVHD_OK);
        assert_memory_equal(matrix, identity, sizeof identity);
        assert_int_equal(bvhd_cpu_scene_object_to_world(alone, &other, matrix, NULL), BVHD_INVALID);
        bvhd_cpu_scene_destroy(alone);
    }
}

/* ---- wrong calls ---- */

static void refuse(const struct bvhd_cpu_trace *trace, const char *where)
{
    struct bvhd_error error = {0};
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], trace, &error), BVHD_INVALID);
    assert_int_equal(error.status, BVHD_INVALID);
    assert_string_equal(error.where, where);
    assert_true(error.text[0]);
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], trace, NULL), BVHD_INVALID);
}

static void wrong_calls_are_refused(void **state)
{
    struct bvhd_cpu_hit hit = {.t = 5};
    struct bvhd_cpu_counters counters = {.struct_size = sizeof counters - 1};
    struct bvhd_error error = {0};
    (void)state;
    const struct bvhd_cpu_trace right = cpu_bed_trace(rays, &hit, 1);
    struct bvhd_cpu_trace wrong;
#define REFUSE(member, value, where)                                                                                   \
    do {                                                                                                               \
        wrong = right;                                                                                                 \
        wrong.member = value;                                                                                          \
        refuse(&wrong, where);                                                                                         \
    } while (0)
    REFUSE(struct_size, sizeof right - 1, "trace.struct_size");
    REFUSE(rays, NULL, "trace.rays");
    REFUSE(hits, NULL, "trace.hits");
    REFUSE(ray_size, 0, "trace.ray_size");
    REFUSE(ray_size, 44, "trace.ray_size");
    REFUSE(ray_size, sizeof *rays + 4, "trace.ray_size");
    REFUSE(ray_stride, sizeof *rays - 1, "trace.ray_stride");
    REFUSE(hit_size, 0, "trace.hit_size");
    REFUSE(hit_size, 6, "trace.hit_size");
    REFUSE(hit_size, sizeof hit + 4, "trace.hit_size");
    REFUSE(hit_stride, sizeof hit - 1, "trace.hit_stride");
    REFUSE(flags, 0x4, "trace.flags");
    REFUSE(reserved, 1, "trace.reserved");
    REFUSE(counters, &counters, "trace.counters.struct_size");
    assert_true(hit.t == 5);
    assert_int_equal(bvhd_cpu_scene_trace(NULL, &right, &error), BVHD_INVALID);
    assert_string_equal(error.where, "scene");
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], NULL, &error), BVHD_INVALID);
    assert_string_equal(error.where, "trace");
    struct bvhd_cpu_trace none = cpu_bed_trace(NULL, NULL, 0);
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &none, NULL), BVHD_OK);
}

/* The hits before a wrong ray are written, and the others are not. */
static void wrong_rays_are_refused(void **state)
{
    enum { COUNT = 5, WRONG = 3 };
    static const uint32_t exclusive[] = {
        BVHD_CPU_RAY_OPAQUE | BVHD_CPU_RAY_NO_OPAQUE,
        BVHD_CPU_RAY_OPAQUE | BVHD_CPU_RAY_CULL_OPAQUE,
        BVHD_CPU_RAY_CULL_OPAQUE | BVHD_CPU_RAY_CULL_NO_OPAQUE,
        BVHD_CPU_RAY_CULL_BACK_FACING | BVHD_CPU_RAY_CULL_FRONT_FACING,
        BVHD_CPU_RAY_CULL_BACK_FACING | BVHD_CPU_RAY_SKIP_TRIANGLES,
        BVHD_CPU_RAY_SKIP_TRIANGLES | BVHD_CPU_RAY_SKIP_AABBS,
        0x8,
        0x400,
        0x80000000,
    };
    static const float times[] = {-0.001f, 1.001f, NAN, INFINITY};
    (void)state;
    for (size_t i = 0; i < sizeof exclusive / sizeof *exclusive + sizeof times / sizeof *times + 1; i++) {
        const size_t flag_count = sizeof exclusive / sizeof *exclusive;
        struct bvhd_cpu_ray some[COUNT];
        struct bvhd_cpu_hit hits[COUNT];
        memcpy(some, rays, sizeof some);
        memset(hits, 0xee, sizeof hits);
        const struct bvhd_cpu_hit before = hits[0];
        const char *where = "rays[3].flags";
        if (i < flag_count) {
            some[WRONG].flags = exclusive[i];
        } else if (i < flag_count + sizeof times / sizeof *times) {
            some[WRONG].time = times[i - flag_count];
            where = "rays[3].time";
        } else {
            some[WRONG].reserved = 1;
            where = "rays[3].reserved";
        }
        const struct bvhd_cpu_trace trace = cpu_bed_trace(some, hits, COUNT);
        struct bvhd_error error = {0};
        assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &trace, &error), BVHD_INVALID);
        assert_string_equal(error.where, where);
        for (int k = 0; k < COUNT; k++)
            assert_int_equal(memcmp(&hits[k], &before, sizeof before) != 0, k < WRONG);
    }
}

/* Rays that can hit nothing are right. */
static void empty_rays_hit_nothing(void **state)
{
    struct bvhd_cpu_ray empty[5];
    struct bvhd_cpu_hit hits[5];
    (void)state;
    for (int i = 0; i < 5; i++)
        empty[i] = (struct bvhd_cpu_ray){.direction = {1, 1, 1}, .tmax = INFINITY, .mask = 0xff};
    empty[0].direction[1] = NAN;
    memset(empty[1].direction, 0, sizeof empty[1].direction);
    empty[2].origin[0] = INFINITY;
    empty[3].tmax = -1;
    empty[4].mask = 0xff00;
    const struct bvhd_cpu_trace trace = cpu_bed_trace(empty, hits, 5);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(bvhd_cpu_scene_trace(scenes[i], &trace, NULL), BVHD_OK);
        for (int k = 0; k < 5; k++)
            assert_miss(&hits[k]);
    }
}

/* ---- work and threads ---- */

static void work_is_counted(void **state)
{
    static struct bvhd_cpu_hit hits[RAYS];
    struct bvhd_cpu_counters counters = {.struct_size = sizeof counters, .nodes = 1, .triangles = 2, .instances = 3};
    struct traverse_counters expected = {1, 2, 3};
    (void)state;
    for (int i = 0; i < RAYS; i++) {
        struct bvhd_cpu_trace single = cpu_bed_trace(&rays[i], &hits[i], 1);
        const struct ray inner = cpu_bed_inner(&rays[i]);
        struct ray_hit hit;
        single.counters = &counters;
        assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &single, NULL), BVHD_OK);
        traverse(&scenes[0]->walk.portable, &inner, NULL, &hit, &expected);
    }
    assert_true(counters.nodes == expected.nodes && counters.nodes > RAYS);
    assert_true(counters.triangles == expected.triangles && counters.instances == expected.instances);
}

/* Rays in packets visit nodes in another order, so that they test others, but not many others. */
static void work_in_packets_is_counted(void **state)
{
    static struct bvhd_cpu_hit hits[RAYS];
    struct bvhd_cpu_counters counters = {.struct_size = sizeof counters};
    struct traverse_counters expected = {0, 0, 0};
    struct bvhd_cpu_trace trace = cpu_bed_trace(rays, hits, RAYS);
    (void)state;
    trace.counters = &counters;
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], &trace, NULL), BVHD_OK);
    for (int i = 0; i < RAYS; i++) {
        const struct ray inner = cpu_bed_inner(&rays[i]);
        struct ray_hit hit;
        traverse(&scenes[0]->walk.portable, &inner, NULL, &hit, &expected);
    }
    assert_true(counters.nodes > expected.nodes / 2 && counters.nodes < 2 * expected.nodes);
    assert_true(counters.triangles > expected.triangles / 2 && counters.triangles < 2 * expected.triangles);
    assert_true(counters.instances > expected.instances / 2 && counters.instances < 2 * expected.instances);
}

static void *trace_on_thread(void *context)
{
    const struct bvhd_cpu_trace *trace = context;
    assert_int_equal(bvhd_cpu_scene_trace(scenes[0], trace, NULL), BVHD_OK);
    return NULL;
}

/* Threads trace through one scene at once, and nothing is allocated meanwhile. */
static void threads_share_a_scene(void **state)
{
    enum { THREADS = 4 };
    static struct bvhd_cpu_hit hits[THREADS][RAYS];
    struct bvhd_cpu_trace traces[THREADS];
    pthread_t threads[THREADS];
    (void)state;
    const uint64_t live = library_memory.live;
    library_memory.fail_after = 0;
    for (int i = 0; i < THREADS; i++) {
        traces[i] = cpu_bed_trace(rays, hits[i], RAYS);
        assert_int_equal(pthread_create(&threads[i], NULL, trace_on_thread, &traces[i]), 0);
    }
    for (int i = 0; i < THREADS; i++) {
        assert_int_equal(pthread_join(threads[i], NULL), 0);
        assert_memory_equal(hits[i], hits[0], sizeof hits[0]);
    }
    assert_int_equal(library_memory.fail_after, 0);
    assert_int_equal(library_memory.live, live);
    library_memory.fail_after = -1;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hits_are_those_of_the_internal_function),
        cmocka_unit_test(arrays_have_any_shape),
        cmocka_unit_test(any_hit_is_found_where_there_is_one),
        cmocka_unit_test(candidates_are_asked_about),
        cmocka_unit_test(verdicts_end_rays),
        cmocka_unit_test(hits_lead_to_corners_and_transforms),
        cmocka_unit_test(one_level_has_no_transform),
        cmocka_unit_test(wrong_calls_are_refused),
        cmocka_unit_test(wrong_rays_are_refused),
        cmocka_unit_test(empty_rays_hit_nothing),
        cmocka_unit_test(work_is_counted),
        cmocka_unit_test(work_in_packets_is_counted),
        cmocka_unit_test(threads_share_a_scene),
    };
    return cmocka_run_group_tests(tests, open_beds, close_beds);
}

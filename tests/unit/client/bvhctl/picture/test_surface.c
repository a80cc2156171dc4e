/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_surface.c - tests that the triangle of a hit is found, and that hits of triangles that do not exist are refused.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/surface.h"
#include "tests/support/client/bvhctl/test_world.h"

static struct tracer_hit cpu_hit(const struct structures *structures, const struct ray *ray)
{
    struct ray_hit hit;
    return structures_trace(structures, ray, &hit) ? tracer_hit_of(&hit) : tracer_miss;
}

static void open_world(struct test_world *world, struct surfaces *surfaces)
{
    test_world_init(world, 1);
    assert_int_equal(surfaces_init(surfaces, &world->structures, &world->local.memory, NULL), BVHD_OK);
}

static void close_world(struct test_world *world, struct surfaces *surfaces)
{
    surfaces_finish(surfaces);
    surfaces_finish(surfaces);
    test_world_finish(world);
    assert_int_equal(world->local.memory.live, 0);
}

static struct ray random_ray(uint64_t *state)
{
    struct vector from =
        vector_make(40 * rays_uniform(state) - 20, 20 * rays_uniform(state) - 10, 40 * rays_uniform(state) - 20);
    struct vector to =
        vector_make(8 * rays_uniform(state) - 4, 3 * rays_uniform(state) - 0.5, 8 * rays_uniform(state) - 4);
    return stage_ray(from, vector_unit(vector_sub(to, from)), 0);
}

/* The surface that is found by number is the one that the CPU's ray hits. */
static void test_same_as_stage(void **state)
{
    (void)state;
    struct test_world world;
    struct surfaces surfaces;
    struct stage stage;
    uint64_t random = 1;
    unsigned hits = 0;
    open_world(&world, &surfaces);
    assert_int_equal(surfaces.instance_count, TEST_WORLD_INSTANCES);
    assert_int_equal(stage_init(&stage, &world.structures, 'y', (struct stage_times){0, 1}, &world.local.memory, NULL),
                     BVHD_OK);
    for (int i = 0; i < 4000; i++) {
        struct ray ray = random_ray(&random);
        struct tracer_hit hit = cpu_hit(&world.structures, &ray);
        struct stage_hit met, expected;
        bool is_met = surfaces_meet(&surfaces, &ray, &hit, &met);
        struct vector origin = vector_make((double)ray.origin[0], (double)ray.origin[1], (double)ray.origin[2]);
        struct vector direction =
            vector_make((double)ray.direction[0], (double)ray.direction[1], (double)ray.direction[2]);
        assert_int_equal(is_met, stage_look(&stage, origin, direction, 0, &expected));
        if (!is_met)
            continue;
        hits++;
        assert_true(met.distance == expected.distance && met.instance == expected.instance &&
                    met.handle == expected.handle);
        assert_true(met.geometry == expected.geometry &&
                    vector_length(vector_sub(met.normal, expected.normal)) < 1e-12);
        assert_true(vector_length(vector_sub(met.position, expected.position)) < 1e-12);
    }
    assert_true(hits > 1000);
    stage_finish(&stage);
    close_world(&world, &surfaces);
}

/* Corner i of the cube has x, y, z from the bits of i; instance 3 is half as large and is at (3, 0.5, 0). */
static void test_corners(void **state)
{
    (void)state;
    struct test_world world;
    struct surfaces surfaces;
    struct surface surface;
    open_world(&world, &surfaces);
    const struct ray ray = stage_ray(vector_make(0, 0, 0), vector_make(0, 1, 0), 0);
    struct tracer_hit hit = {.t = 1, .instance = 3, .primitive = 0};
    assert_true(surfaces_find(&surfaces, &ray, &hit, &surface));
    static const struct vector corners[3] = {{2.5, 0, -0.5}, {2.5, 1, -0.5}, {3.5, 0, -0.5}};
    for (int i = 0; i < 3; i++)
        assert_true(vector_length(vector_sub(surface.corners[i], corners[i])) == 0);
    assert_true(vector_length(vector_sub(surface.shift, vector_make(3, 0.5, 0))) == 0);
    assert_true(fabs(surface_normal(&surface).z) == 1);
    hit.instance = 0;
    hit.primitive = 1;
    assert_true(surfaces_find(&surfaces, &ray, &hit, &surface));
    assert_true(fabs(surface_normal(&surface).y) == 1 && vector_length(surface.shift) == 0);
    close_world(&world, &surfaces);
}

static void test_nothing_there(void **state)
{
    (void)state;
    struct test_world world;
    struct surfaces surfaces;
    struct surface surface;
    struct stage_hit met;
    open_world(&world, &surfaces);
    static const struct tracer_hit hits[] = {
        {.t = 1, .instance = TEST_WORLD_INSTANCES},
        {.t = 1, .instance = RAY_NO_INSTANCE},
        {.t = 1, .instance = 2}, /* inactive */
        {.t = 1, .instance = 1, .geometry = 1},
        {.t = 1, .instance = 1, .geometry = UINT32_MAX},
        {.t = 1, .instance = 1, .primitive = 12},
        {.t = 1, .instance = 1, .primitive = UINT32_MAX},
        {.t = 1, .instance = 0, .primitive = 2},
        {.t = 1, .instance = TEST_WORLD_INSTANCES, .flags = TRACER_AABB},
    };
    struct ray ray = stage_ray(vector_make(0, 0, 0), vector_make(0, 1, 0), 0);
    for (size_t i = 0; i < sizeof hits / sizeof *hits; i++) {
        assert_false(surfaces_find(&surfaces, &ray, &hits[i], &surface));
        assert_false(surfaces_meet(&surfaces, &ray, &hits[i], &met));
    }
    struct tracer_hit hit = {.t = NAN, .instance = 1};
    assert_false(surfaces_meet(&surfaces, &ray, &hit, &met));
    assert_false(surfaces_meet(&surfaces, &ray, &tracer_miss, &met));
    close_world(&world, &surfaces);
}

/* The normal of an AABB points against the ray. */
static void test_aabb(void **state)
{
    (void)state;
    struct test_world world;
    struct surfaces surfaces;
    struct stage_hit met;
    open_world(&world, &surfaces);
    struct ray ray = stage_ray(vector_make(0, 5, 0), vector_make(0, -1, 0), 0);
    struct tracer_hit hit = {.t = 2, .instance = 3, .flags = TRACER_AABB};
    assert_true(surfaces_meet(&surfaces, &ray, &hit, &met));
    assert_true(met.normal.y == 1 && met.position.y == 3 && met.instance == 3 && met.handle == 1);
    close_world(&world, &surfaces);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct test_world world;
    struct surfaces surfaces;
    test_world_init(&world, 1);
    struct memory *memory = &world.local.memory;
    uint64_t live = memory->live;
    enum bvhd_status status = BVHD_NO_MEMORY;
    int64_t after = 0;
    for (; status != BVHD_OK; after++) {
        atomic_store(&memory->fail_after, after);
        status = surfaces_init(&surfaces, &world.structures, memory, NULL);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && memory->live == live));
    }
    atomic_store(&memory->fail_after, -1);
    assert_true(after > 4);
    close_world(&world, &surfaces);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_as_stage), cmocka_unit_test(test_corners),   cmocka_unit_test(test_nothing_there),
        cmocka_unit_test(test_aabb),          cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}

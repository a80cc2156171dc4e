/* SPDX-License-Identifier: Apache-2.0 */
/* test_tracer.c - tests the tracer on the CPU, and which tracer is chosen without a driver. */
#include "tests/support/unit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/stage.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "client/bvhctl/trace/tracer_choice.h"

enum { RAYS = 3000 };

static void make_rays(struct ray *rays)
{
    uint64_t state = 7;
    for (int i = 0; i < RAYS; i++) {
        struct vector from =
            vector_make(20 * rays_uniform(&state) - 10, 8 * rays_uniform(&state) - 2, 20 * rays_uniform(&state) - 10);
        struct vector to =
            vector_make(6 * rays_uniform(&state) - 2, 2 * rays_uniform(&state), 4 * rays_uniform(&state) - 2);
        rays[i] = stage_ray(from, vector_unit(vector_sub(to, from)), 0);
        rays[i].flags = i % 3 == 1 ? RAY_CULL_BACK_FACING : 0;
        rays[i].cull_mask = i % 5 == 4 ? 0 : 0xff;
    }
}

/* The tracer gives the answers of the traversal, for any number of threads and rays at once. */
static void test_cpu(void **state)
{
    (void)state;
    static struct ray rays[RAYS];
    static struct tracer_hit hits[RAYS];
    make_rays(rays);
    for (uint32_t threads = 1; threads <= 4; threads += 3) {
        struct test_world world;
        struct tracer *tracer;
        double seconds = -1;
        unsigned hit_count = 0;
        test_world_init(&world, threads);
        const struct local *local = &world.local;
        assert_int_equal(tracer_cpu_create(&world.structures, local->parallel, &world.local.memory, &tracer, NULL),
                         BVHD_OK);
        assert_string_equal(tracer->device, "cpu");
        assert_int_equal(tracer->target, TARGET_PORTABLE);
        for (uint64_t count = 0; count <= RAYS; count += RAYS / 3) {
            memset(hits, 0, sizeof hits);
            assert_int_equal(tracer->trace(tracer, rays, count, hits, &seconds, NULL), BVHD_OK);
            assert_true(seconds >= 0);
            if (count < RAYS)
                assert_true(hits[count].t == 0);
        }
        for (int i = 0; i < RAYS; i++) {
            struct ray_hit hit;
            bool is_hit = structures_trace(&world.structures, &rays[i], &hit);
            struct tracer_hit expected = is_hit ? tracer_hit_of(&hit) : tracer_miss;
            assert_memory_equal(&hits[i], &expected, sizeof expected);
            assert_int_equal(isinf(hits[i].t), !is_hit);
            hit_count += is_hit;
            if (is_hit)
                assert_int_equal(hits[i].flags, hit.front_face ? TRACER_FRONT_FACE : 0);
        }
        assert_true(hit_count > RAYS / 3);
        assert_int_equal(tracer->trace(tracer, rays, RAYS, hits, NULL, NULL), BVHD_OK);
        tracer_destroy(tracer);
        test_world_finish(&world);
        assert_int_equal(world.local.memory.live, 0);
    }
}

static void test_hit_of(void **state)
{
    (void)state;
    struct ray_hit hit = {.t = 1, .u = 2, .v = 3, .instance = 4, .custom_index = 5, .geometry = 6, .primitive = 7};
    struct tracer_hit expected = {1, 2, 3, 4, 5, 6, 7, TRACER_FRONT_FACE | TRACER_AABB}, made;
    hit.front_face = hit.is_aabb = true;
    made = tracer_hit_of(&hit);
    assert_memory_equal(&made, &expected, sizeof made);
    assert_int_equal(sizeof made, 32);
    hit = (struct ray_hit){.is_sphere = true};
    assert_int_equal(tracer_hit_of(&hit).flags, TRACER_SPHERE);
    hit = (struct ray_hit){.is_swept_sphere = true};
    assert_int_equal(tracer_hit_of(&hit).flags, TRACER_SWEPT_SPHERE);
}

static void test_choose_cpu(void **state)
{
    (void)state;
    struct test_world world;
    struct tracer_choice choice;
    test_world_init(&world, 1);
    struct memory *memory = &world.local.memory;
    uint64_t live = memory->live;
    assert_int_equal(tracer_choose("cpu", &world.structures, world.local.parallel, memory, &choice, NULL), BVHD_OK);
    assert_true(choice.is_cpu && !choice.gpu && !strcmp(choice.tracer->device, "cpu"));
    tracer_choice_finish(&choice);
    tracer_choice_finish(&choice);
    assert_int_equal(memory->live, live);
    atomic_store(&memory->fail_after, 0);
    assert_int_equal(tracer_choose("cpu", &world.structures, world.local.parallel, memory, &choice, NULL),
                     BVHD_NO_MEMORY);
    atomic_store(&memory->fail_after, -1);
    tracer_destroy(NULL);
    tracer_choice_finish(NULL);
    test_world_finish(&world);
}

/* Without a driver, "auto" chooses the CPU, and a device's name is an error that says what is missing. */
static void test_choose_without_driver(void **state)
{
    (void)state;
    struct test_world world;
    struct tracer_choice choice;
    struct bvhd_error error = {0};
    test_world_init(&world, 1);
    struct memory *memory = &world.local.memory;
    uint64_t live = memory->live;
    setenv("VK_DRIVER_FILES", "/nonexistent", 1);
    setenv("VK_ICD_FILENAMES", "/nonexistent", 1);
    assert_int_equal(tracer_choose("auto", &world.structures, world.local.parallel, memory, &choice, NULL), BVHD_OK);
    assert_true(choice.is_cpu);
    tracer_choice_finish(&choice);
    enum bvhd_status status = tracer_choose("voodoo", &world.structures, world.local.parallel, memory, &choice, &error);
    assert_int_equal(status, BVHD_UNAVAILABLE);
    assert_true(error.status == status && *error.text);
    assert_int_equal(memory->live, live);
    test_world_finish(&world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cpu),
        cmocka_unit_test(test_hit_of),
        cmocka_unit_test(test_choose_cpu),
        cmocka_unit_test(test_choose_without_driver),
    };
    return cmocka_run_group_tests_name("tracer", tests, NULL, NULL);
}

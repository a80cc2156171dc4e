/* SPDX-License-Identifier: Apache-2.0 */
/* test_oracle_timed.c - tests that a limit of time leaves rays out, and changes no answer. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/oracle/oracle_timed.h"
#include "client/bvhctl/oracle/rays.h"

enum { TRIANGLES = 500, RAYS = 3000 };

static float positions[TRIANGLES * 9];
static struct ray rays[RAYS];
static struct memory memory;
static uint64_t last_done, last_total;

static void watch(void *context, uint64_t done, uint64_t total)
{
    (void)context;
    assert_true(done <= total);
    last_done = done > last_done ? done : last_done;
    last_total = total;
}

static struct oracle_mesh make_mesh(void)
{
    uint64_t state = 9;
    struct oracle_mesh mesh = {.positions = positions, .primitive_count = TRIANGLES};
    for (int i = 0; i < TRIANGLES * 9; i++)
        positions[i] = (float)(10 * rays_uniform(&state)) + (i % 9 < 3 ? 0 : (float)rays_uniform(&state));
    rays_make(&mesh, 1, 4, RAYS, rays);
    return mesh;
}

/* Answers do not depend on the portions, and progress counts all of them. */
static void test_all(void **state)
{
    (void)state;
    static struct oracle_answer whole[RAYS], timed[RAYS];
    struct oracle_mesh mesh = make_mesh();
    struct oracle_work work = {&mesh, 1, &memory, &parallel_serial, watch, NULL};
    uint32_t count = 0;
    last_done = 0;
    assert_int_equal(oracle_trace(&mesh, 1, rays, RAYS, &memory, &parallel_serial, NULL, NULL, whole, NULL), BVHD_OK);
    assert_int_equal(oracle_trace_timed(&work, rays, RAYS, INFINITY, timed, &count, NULL), BVHD_OK);
    assert_int_equal(count, RAYS);
    assert_int_equal(oracle_work_tests(&work, RAYS), TRIANGLES * RAYS);
    assert_int_equal(last_total, TRIANGLES * RAYS);
    assert_int_equal(last_done, TRIANGLES * RAYS);
    for (int i = 0; i < RAYS; i++) {
        assert_int_equal(timed[i].outcome, whole[i].outcome);
        assert_true(timed[i].outcome != ORACLE_HIT || timed[i].t == whole[i].t);
    }
    oracle_finish(whole, RAYS, &memory);
    oracle_finish(timed, RAYS, &memory);
    assert_int_equal(memory.live, 0);
}

static void test_no_time(void **state)
{
    (void)state;
    static struct oracle_answer timed[RAYS];
    struct oracle_mesh mesh = make_mesh();
    struct oracle_work work = {&mesh, 1, &memory, &parallel_serial, NULL, NULL};
    uint32_t count = 0;
    assert_int_equal(oracle_trace_timed(&work, rays, RAYS, -1, timed, &count, NULL), BVHD_OK);
    assert_in_range(count, 1, RAYS - 1);
    for (uint32_t i = count; i < RAYS; i++)
        assert_int_equal(timed[i].outcome, ORACLE_MISS);
    oracle_finish(timed, RAYS, &memory);
    assert_int_equal(memory.live, 0);
    assert_true(oracle_work_seconds(&work, RAYS) > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_all), cmocka_unit_test(test_no_time)};
    memory_init(&memory, UINT64_MAX);
    return cmocka_run_group_tests_name("oracle_timed", tests, NULL, NULL);
}

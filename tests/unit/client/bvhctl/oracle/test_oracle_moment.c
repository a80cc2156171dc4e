/* SPDX-License-Identifier: Apache-2.0 */
/* test_oracle_moment.c - tests meshes at times: moving vertices, matrices, rotations, and what is not there. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/oracle/oracle_moment.h"
#include "client/bvhctl/oracle/rays.h"

/* A triangle in the plane z = 0 round the origin. */
static const float triangle[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};

/* Scale 1, no rotation, no translation: VkSRTDataNV. */
static const float rest[16] = {[0] = 1, [4] = 1, [7] = 1, [12] = 1};

static struct oracle_mesh moving_mesh(enum oracle_motion motion, const float *start, const float *end)
{
    return (struct oracle_mesh){.positions = triangle,
                                .primitive_count = 1,
                                .transform = start,
                                .motion = motion,
                                .end_transform = end,
                                .instance = 0};
}

/* Traces rays along z through (x, y) at these times. */
static void ask(const struct oracle_mesh *mesh, float x, float y, const float *times, uint32_t count,
                enum oracle_outcome *ret_outcomes)
{
    struct ray rays[8];
    struct oracle_answer answers[8];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t i = 0; i < count; i++)
        rays[i] = (struct ray){.origin = {x, y, -5}, .direction = {0, 0, 1}, .tmax = FLT_MAX, .time = times[i]};
    assert_int_equal(oracle_trace(mesh, 1, rays, count, &memory, &parallel_serial, NULL, NULL, answers, NULL), BVHD_OK);
    for (uint32_t i = 0; i < count; i++)
        ret_outcomes[i] = answers[i].outcome;
    oracle_finish(answers, count, &memory);
    assert_int_equal(memory.live, 0);
}

static enum oracle_outcome ask_one(const struct oracle_mesh *mesh, float x, float y, float time)
{
    enum oracle_outcome outcome;
    ask(mesh, x, y, &time, 1, &outcome);
    return outcome;
}

static void test_vertices_move(void **state)
{
    (void)state;
    float end[9];
    memcpy(end, triangle, sizeof end);
    for (int k = 0; k < 3; k++)
        end[3 * k] += 10;
    const struct oracle_mesh mesh = {.positions = triangle, .end_positions = end, .primitive_count = 1};
    static const float times[5] = {0, 0, 0.5F, 1, 0.5F};
    static const enum oracle_outcome at_start[5] = {ORACLE_HIT, ORACLE_HIT, ORACLE_MISS, ORACLE_MISS, ORACLE_MISS};
    static const enum oracle_outcome half_way[5] = {ORACLE_MISS, ORACLE_MISS, ORACLE_HIT, ORACLE_MISS, ORACLE_HIT};
    enum oracle_outcome outcomes[5];
    ask(&mesh, 0, -0.3F, times, 5, outcomes);
    assert_memory_equal(outcomes, at_start, sizeof outcomes);
    ask(&mesh, 5, -0.3F, times, 5, outcomes);
    assert_memory_equal(outcomes, half_way, sizeof outcomes);
    assert_int_equal(ask_one(&mesh, 10, -0.3F, 1), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 2.5F, -0.3F, 0.25F), ORACLE_HIT);
}

/* Each of the three operations is rounded to a float. */
static void test_places_are_exact(void **state)
{
    (void)state;
    const float start[3] = {0.1F, 3e38F, -1}, end[3] = {16777216, 3e38F, 1}, time = 0.3F;
    const struct oracle_mesh mesh = {.positions = start, .end_positions = end, .primitive_count = 1};
    struct oracle_moment moment;
    float place[3];
    assert_true(oracle_moment_make(&mesh, time, &moment));
    oracle_moment_vertex(&moment, 0, place);
    for (int k = 0; k < 3; k++) {
        volatile float before = start[k] * (1 - time), after = end[k] * time, sum = before + after;
        assert_true(place[k] == sum);
        assert_true(isfinite(place[k]));
    }
}

/* The corners change places: between, the triangle is a point. Infinite and missing places are nowhere at any time. */
static void test_vertices_vanish(void **state)
{
    (void)state;
    float end[9];
    for (int k = 0; k < 9; k++)
        end[k] = -triangle[k];
    const struct oracle_mesh mesh = {.positions = triangle, .end_positions = end, .primitive_count = 1};
    assert_int_equal(ask_one(&mesh, 0, 0, 0), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 0, 0, 0.5F), ORACLE_MISS);
    assert_int_equal(ask_one(&mesh, 0, 0, 1), ORACLE_HIT);
    end[4] = NAN;
    assert_int_equal(ask_one(&mesh, 0, 0, 0), ORACLE_MISS);
    end[4] = INFINITY;
    assert_int_equal(ask_one(&mesh, 0, 0, 0), ORACLE_MISS);
}

static void test_matrices_move(void **state)
{
    (void)state;
    static const float start[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       end[12] = {-1, 0, 0, 8, 0, 1, 0, 0, 0, 0, 1, 0};
    const struct oracle_mesh mesh = moving_mesh(ORACLE_MATRIX, start, end);
    assert_int_equal(ask_one(&mesh, 0, -0.3F, 0), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 2, -0.3F, 0.25F), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 4, -0.3F, 0.5F), ORACLE_MISS); /* the scale along x is 0 */
    assert_int_equal(ask_one(&mesh, 8, -0.3F, 1), ORACLE_HIT);
}

/* A quarter of a turn round z, then a translation. */
static void test_rotations_move(void **state)
{
    (void)state;
    float end[16];
    memcpy(end, rest, sizeof end);
    end[11] = end[12] = 3; /* its length does not matter */
    end[13] = 20;
    const struct oracle_mesh mesh = moving_mesh(ORACLE_SRT, rest, end);
    assert_int_equal(ask_one(&mesh, 0.9F, -0.9F, 0), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 0.9F, 0.9F, 0), ORACLE_MISS);
    assert_int_equal(ask_one(&mesh, 20.9F, -0.9F, 1), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 20.9F, 0.9F, 1), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 19.1F, -0.9F, 1), ORACLE_MISS);
    assert_int_equal(ask_one(&mesh, 10, 0, 0.5F), ORACLE_HIT);
    /* the pivot is moved before the rotation, x to y */
    end[3] = 7;
    assert_int_equal(ask_one(&mesh, 20, 7, 1), ORACLE_HIT);
}

static void test_transforms_vanish(void **state)
{
    (void)state;
    float end[16];
    memcpy(end, rest, sizeof end);
    end[12] = -1;
    const struct oracle_mesh mesh = moving_mesh(ORACLE_SRT, rest, end);
    assert_int_equal(ask_one(&mesh, 0, 0, 0.25F), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 0, 0, 0.5F), ORACLE_MISS); /* the quaternion is 0 */
    end[12] = 1;
    end[4] = 0; /* the scale along y */
    assert_int_equal(ask_one(&mesh, 0, 0, 0.75F), ORACLE_HIT);
    assert_int_equal(ask_one(&mesh, 0, 0, 1), ORACLE_MISS);
    end[4] = 1e-30F; /* too little for its sign to matter, but a ray may be that exact */
    end[1] = 1e10F;
    assert_int_equal(ask_one(&mesh, 0, 0, 1), ORACLE_UNCERTAIN);
}

static void test_rays_have_times(void **state)
{
    (void)state;
    float end[9];
    for (int k = 0; k < 9; k++)
        end[k] = triangle[k] + 100;
    const struct oracle_mesh still = {.positions = triangle, .primitive_count = 1},
                             mesh = {.positions = triangle, .end_positions = end, .primitive_count = 1};
    struct ray rays[64];
    struct oracle_answer answers[64];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    assert_false(oracle_moves(&still, 1));
    assert_true(oracle_moves(&mesh, 1));
    rays_make(&still, 1, 1, 64, rays);
    for (int i = 0; i < 64; i++)
        assert_true(rays[i].time == 0);
    rays_make(&mesh, 1, 1, 64, rays);
    assert_true(rays[0].time == 0 && rays[8].time == 1 && rays[16].time == 0.5F);
    assert_int_equal(oracle_trace(&mesh, 1, rays, 64, &memory, &parallel_serial, NULL, NULL, answers, NULL), BVHD_OK);
    for (int i = 0; i < 64; i++) {
        assert_true(rays[i].time >= 0 && rays[i].time <= 1 && rays[i].time == rays[i / 8 * 8].time);
        if (i % 2 == 0)
            assert_int_equal(answers[i].outcome, ORACLE_HIT);
    }
    oracle_finish(answers, 64, &memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_vertices_move),   cmocka_unit_test(test_places_are_exact),
        cmocka_unit_test(test_vertices_vanish), cmocka_unit_test(test_matrices_move),
        cmocka_unit_test(test_rotations_move),  cmocka_unit_test(test_transforms_vanish),
        cmocka_unit_test(test_rays_have_times),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

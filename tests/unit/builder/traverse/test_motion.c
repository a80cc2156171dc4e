/* SPDX-License-Identifier: Apache-2.0 */
/* test_motion.c - tests the numbers, vertices and matrices of what moves at the time of a ray. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/motion.h"
#include "tests/support/random.h"

enum { MATRIX = 12, SRT = 16 };

static void test_numbers(void **state)
{
    (void)state;
    struct random random = {1};
    for (int i = 0; i < 100000; i++) {
        const float start = (float)random_between(&random, -9, 9), end = (float)random_between(&random, -9, 9),
                    time = (float)random_between(&random, 0, 1);
        const volatile float rest = 1 - time, first = start * rest, second = end * time;
        const float expected = first + second;
        assert_true(motion_number(start, end, motion_weights_at(time)) == expected);
        assert_true(motion_number(start, end, motion_weights_at(0)) == start);
        assert_true(motion_number(start, end, motion_weights_at(1)) == end);
    }
}

static void test_corners(void **state)
{
    (void)state;
    const struct portable_moving_vertex vertices[4] = {
        {{0, 0, 0}, {8, 8, 8}}, {{1, 2, 3}, {1, 2, 3}}, {{4, 5, 6}, {8, 9, 10}}, {{-1, -1, -1}, {1, 1, 1}}};
    const struct portable_indexed_triangle triangles[2] = {{{0, 0, 0}, 1}, {{1, 2, 3}, 7}};
    const struct portable_view view = {.records = triangles, .vertices = (const float *)vertices};
    const float expected[3][3] = {{1, 2, 3}, {5, 6, 7}, {-0.5f, -0.5f, -0.5f}};
    float corners[3][3];
    assert_int_equal(motion_corners(&view, 1, motion_weights_at(0.25f), corners), 7);
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++)
            assert_true(corners[k][axis] == expected[k][axis]);
}

static void test_static_and_matrix(void **state)
{
    (void)state;
    struct portable_moving_instance instance = {.motion = MOTION_STATIC};
    float matrix[MATRIX];
    for (int i = 0; i < SRT; i++) {
        instance.start[i] = 0.1f * (float)i;
        instance.end[i] = i < 6 ? instance.start[i] : 7;
    }
    assert_true(motion_matrix(&instance, 0.3f, matrix));
    assert_memory_equal(matrix, instance.start, sizeof matrix);
    instance.motion = MOTION_MATRIX;
    assert_true(motion_matrix(&instance, 0.3f, matrix));
    for (int i = 0; i < MATRIX; i++)
        assert_true(matrix[i] == motion_number(instance.start[i], instance.end[i], motion_weights_at(0.3f)));
}

/* Turns a point by a quaternion, q * p * conjugate(q), divided by the square of its length. */
static void turn(const long double q[4], const long double p[3], long double ret_point[3])
{
    const long double size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        const long double along = q[0] * p[0] + q[1] * p[1] + q[2] * p[2];
        ret_point[a] = ((q[3] * q[3] - q[a] * q[a] - q[b] * q[b] - q[c] * q[c]) * p[a] + 2 * along * q[a] +
                        2 * q[3] * (q[b] * p[c] - q[c] * p[b])) /
                       size;
    }
}

/* The columns of the matrix are what the axes and the origin become: scaled, turned, moved. */
static void test_srt(void **state)
{
    (void)state;
    struct random random = {5};
    for (int i = 0; i < 20000; i++) {
        struct portable_moving_instance instance = {.motion = MOTION_SRT};
        const float time = i % 3 ? (float)random_between(&random, 0, 1) : (float)(i % 2);
        long double n[SRT];
        float matrix[MATRIX];
        for (int k = 0; k < SRT; k++) {
            instance.start[k] = (float)random_between(&random, -2, 2);
            instance.end[k] = (float)random_between(&random, -2, 2);
            n[k] = motion_number(instance.start[k], instance.end[k], motion_weights_at(time));
        }
        assert_true(motion_matrix(&instance, time, matrix));
        for (int column = 0; column < 4; column++) {
            const long double columns[4][3] = {{n[0], 0, 0}, {n[1], n[4], 0}, {n[2], n[5], n[7]}, {n[3], n[6], n[8]}};
            long double turned[3];
            turn(&n[9], columns[column], turned);
            for (int row = 0; row < 3; row++) {
                const long double expected = turned[row] + (column == 3 ? n[13 + row] : 0);
                const long double apart = matrix[4 * row + column] - expected;
                assert_true(fabsl(apart) <= 0x1p-24L * fabsl(expected) + 1e-13L);
            }
        }
    }
}

static void test_no_rotation(void **state)
{
    (void)state;
    struct portable_moving_instance instance = {.motion = MOTION_SRT, .start = {[0] = 1, [4] = 1, [7] = 1}};
    float matrix[MATRIX];
    memcpy(instance.end, instance.start, sizeof instance.end);
    assert_false(motion_matrix(&instance, 0, matrix));
    instance.start[12] = 1; /* then against it: at half time there is none */
    instance.end[12] = -1;
    assert_true(motion_matrix(&instance, 0, matrix));
    assert_true(motion_matrix(&instance, 0.25f, matrix));
    assert_false(motion_matrix(&instance, 0.5f, matrix));
    assert_true(motion_matrix(&instance, 1, matrix));
    instance.start[9] = INFINITY;
    assert_false(motion_matrix(&instance, 0.25f, matrix));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers), cmocka_unit_test(test_corners),     cmocka_unit_test(test_static_and_matrix),
        cmocka_unit_test(test_srt),     cmocka_unit_test(test_no_rotation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

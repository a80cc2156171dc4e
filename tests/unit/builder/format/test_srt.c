/* SPDX-License-Identifier: Apache-2.0 */
/* test_srt.c - tests the matrices of SRTs against scaling, turning and moving of points in long double. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/format/srt.h"
#include "tests/support/random.h"

static void cross(const long double a[3], const long double b[3], long double ret[3])
{
    for (int i = 0; i < 3; i++)
        ret[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Scales, turns and moves a point. A quaternion (v, w) of length 1 makes p + 2 v x (v x p + w p) of p. */
static void move(const float srt[SRT_NUMBERS], const double point[3], long double ret[3])
{
    const long double x = point[0], y = point[1], z = point[2];
    const long double p[3] = {srt[SRT_SX] * x + srt[SRT_A] * y + srt[SRT_B] * z + srt[SRT_PVX],
                              srt[SRT_SY] * y + srt[SRT_C] * z + srt[SRT_PVY], srt[SRT_SZ] * z + srt[SRT_PVZ]};
    long double q[4], length = 0, inner[3], outer[3];
    for (int i = 0; i < 4; i++)
        length += (long double)srt[SRT_QX + i] * srt[SRT_QX + i];
    for (int i = 0; i < 4; i++)
        q[i] = srt[SRT_QX + i] / sqrtl(length);
    cross(q, p, inner);
    for (int i = 0; i < 3; i++)
        inner[i] += q[3] * p[i];
    cross(q, inner, outer);
    for (int i = 0; i < 3; i++)
        ret[i] = p[i] + 2 * outer[i] + srt[SRT_TX + i];
}

static void matrices_move_as_srts_do(void **state)
{
    (void)state;
    struct random random = {3};
    for (int i = 0; i < 20000; i++) {
        float srt[SRT_NUMBERS], m[12];
        double point[3];
        long double expected[3];
        const double scale = exp2(random_between(&random, -30, 30)), length = exp2(random_between(&random, -60, 60));
        for (int k = 0; k < SRT_NUMBERS; k++)
            srt[k] = (float)((k >= SRT_QX && k <= SRT_QW ? length : scale) * random_between(&random, -1, 1));
        random_point(&random, point);
        assert_true(srt_matrix(srt, m));
        move(srt, point, expected);
        for (int row = 0; row < 3; row++) {
            const long double x = m[4 * row] * (long double)point[0] + m[4 * row + 1] * (long double)point[1] +
                                  m[4 * row + 2] * (long double)point[2] + m[4 * row + 3];
            assert_true(fabsl(x - expected[row]) < 1e-6L * scale);
        }
    }
}

/* Each number of a matrix is the exact one, rounded to float once. */
static void numbers_are_rounded_once(void **state)
{
    (void)state;
    static const float third = 1.0f / 3;
    const float srt[SRT_NUMBERS] = {[SRT_SX] = third, [SRT_A] = 5,  [SRT_SY] = 2,    [SRT_SZ] = 3,
                                    [SRT_PVX] = 1e8f, [SRT_QZ] = 7, [SRT_TY] = -1e8f}; /* 180 degrees about z */
    static const float expected[12] = {-third, -5, 0, -1e8f, 0, -2, 0, -1e8f, 0, 0, 3, 0};
    float matrix[12];
    assert_true(srt_matrix(srt, matrix));
    for (int i = 0; i < 12; i++)
        assert_true(matrix[i] == expected[i]);
}

static void quaternions_without_a_direction_have_no_matrix(void **state)
{
    (void)state;
    static const float zeros[12];
    static const float wrong[] = {0, NAN, INFINITY};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        float srt[SRT_NUMBERS] = {[SRT_SX] = 1, [SRT_SY] = 1, [SRT_SZ] = 1, [SRT_QY] = wrong[i], [SRT_TX] = 4}, m[12];
        assert_false(srt_matrix(srt, m));
        assert_memory_equal(m, zeros, sizeof m);
    }
    float least[SRT_NUMBERS] = {[SRT_SX] = 1, [SRT_SY] = 1, [SRT_SZ] = 1, [SRT_QW] = 0x1p-149f}, m[12];
    assert_true(srt_matrix(least, m));
    assert_true(m[0] == 1 && m[5] == 1 && m[10] == 1);
    least[SRT_QW] = FLT_MAX;
    assert_true(srt_matrix(least, m));
    assert_true(m[0] == 1 && m[5] == 1 && m[10] == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matrices_move_as_srts_do),
        cmocka_unit_test(numbers_are_rounded_once),
        cmocka_unit_test(quaternions_without_a_direction_have_no_matrix),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_transform.c - tests that matrices are applied in double with one rounding, and that identity is found. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/random.h"
#include "builder/input/transform.h"

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* Returns a float of random bits, so that denormals, infinities and NaNs occur. */
static float any_float(struct random *random)
{
    uint32_t bits = (uint32_t)random_next(random);
    if (random_next(random) % 4)
        bits = (bits & 0x807fffff) | (uint32_t)(120 + random_next(random) % 16) << 23;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void rows_are_summed_in_double(void **state)
{
    (void)state;
    struct random random = {7};
    for (int round = 0; round < 2000; round++) {
        float matrix[12], given[11][3], points[11][3];
        for (int i = 0; i < 12; i++)
            matrix[i] = any_float(&random);
        for (int i = 0; i < 33; i++)
            given[i / 3][i % 3] = any_float(&random);
        memcpy(points, given, sizeof points);
        uint64_t count = (uint64_t)round % 12;
        transform_points(matrix, points[0], count);
        for (uint64_t i = 0; i < 11; i++)
            for (int row = 0; row < 3; row++) {
                volatile double sum = (double)matrix[4 * row] * given[i][0];
                sum += (double)matrix[4 * row + 1] * given[i][1];
                sum += (double)matrix[4 * row + 2] * given[i][2];
                sum += matrix[4 * row + 3];
                float want = i >= count ? given[i][row] : isnan(sum) ? transform_nan() : (float)sum;
                assert_int_equal(bits_of(points[i][row]), bits_of(want));
            }
    }
}

static void identity_is_recognised(void **state)
{
    (void)state;
    float matrix[12] = {1, 0, -0.0f, 0, 0, 1, 0, 0, 0, 0, 1, -0.0f};
    assert_true(transform_is_identity(matrix));
    for (int i = 0; i < 12; i++) {
        float kept = matrix[i];
        matrix[i] = nextafterf(kept, 2);
        assert_false(transform_is_identity(matrix));
        matrix[i] = NAN;
        assert_false(transform_is_identity(matrix));
        matrix[i] = kept;
    }
}

static void there_is_one_nan(void **state)
{
    (void)state;
    assert_int_equal(bits_of(transform_nan()), 0x7fc00000);
}

/* The bounds hold all corners of the box, and are no larger than rounding needs. */
static void bounds_hold_the_corners(void **state)
{
    (void)state;
    struct random random = {4};
    for (int i = 0; i < 20000; i++) {
        const double scale = ldexp(1, (int)(random_next(&random) % 200) - 100);
        struct box box = box_empty();
        double matrix[12], min[3], max[3];
        for (int k = 0; k < 12; k++)
            matrix[k] = scale * random_between(&random, -1, 1);
        for (int k = 0; k < 2; k++) {
            double point[3];
            random_point(&random, point);
            const float corner[3] = {(float)point[0], (float)point[1], (float)point[2]};
            box_add_point(&box, corner);
        }
        transform_bounds(matrix, &box, min, max);
        for (int row = 0; row < 3; row++) {
            long double low = INFINITY, high = -INFINITY;
            for (int corner = 0; corner < 8; corner++) {
                long double x = matrix[4 * row + 3];
                for (int axis = 0; axis < 3; axis++)
                    x += (long double)matrix[4 * row + axis] * (corner >> axis & 1 ? box.max[axis] : box.min[axis]);
                low = fminl(low, x);
                high = fmaxl(high, x);
            }
            assert_true(min[row] <= low && max[row] >= high);
            assert_true(low - min[row] < 1e-13L * scale && max[row] - high < 1e-13L * scale);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_summed_in_double),
        cmocka_unit_test(identity_is_recognised),
        cmocka_unit_test(there_is_one_nan),
        cmocka_unit_test(bounds_hold_the_corners),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

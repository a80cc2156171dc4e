/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_lavapipe_invert.c - tests that inverses invert, and that their bits stay the same.
 *
 * tests/integration/driver_golden compares the bits with the driver's.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/lavapipe.h"
#include "tests/support/random.h"

/* Returns the largest difference between the product of the two matrices, in double, and the unit matrix. */
static double error_of(const float matrix[12], const float inverse[12])
{
    double worst = 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? matrix[4 * row + 3] : 0;
            for (int k = 0; k < 3; k++)
                sum += (double)matrix[4 * row + k] * inverse[4 * k + column];
            worst = fmax(worst, fabs(sum - (row == column)));
        }
    return worst;
}

static void products_are_unit_matrices(void **state)
{
    (void)state;
    struct random random = {1};
    for (int i = 0; i < 20000; i++) {
        float matrix[12], inverse[12];
        double most = 0;
        for (int k = 0; k < 12; k++)
            matrix[k] = (float)random_between(&random, -1, 1) * (k % 4 == 3 ? 100 : 1);
        lavapipe_invert(matrix, inverse);
        for (int k = 0; k < 12; k++)
            most = fmax(most, fabs((double)inverse[k]));
        assert_true(error_of(matrix, inverse) <= 1e-5 * (1 + most * most));
    }
}

static void known_inverses_are_found(void **state)
{
    (void)state;
    static const float pairs[][2][12] = {
        {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}},
        {{2, 0, 0, 3, 0, -4, 0, 5, 0, 0, 0.5f, 6}, {0.5f, 0, 0, -1.5f, 0, -0.25f, 0, 1.25f, 0, 0, 2, -12}},
        /*
         * The pivots are in lower rows: rows of the matrix are columns of the eliminated one. (Translations are pivots
         * too, so that nothing is exact.)
         */
        {{0, 1, 0, 7, 0, 0, 1, 8, 1, 0, 0, 9}, {0, 0, 1, -9, 1, 0, 0, -7, 0, 1, 0, -8}},
        {{0, 0, 4, 0, 0, 2, 0, 0, 1, 0, 0, 0}, {0, 0, 1, 0, 0, 0.5f, 0, 0, 0.25f, 0, 0, 0}},
        {{1, 0, 0, 1024, 0, 1, 0, 0, 0, 0, 1, 0}, {1, 0, 0, -1024, 0, 1, 0, 0, 0, 0, 1, 0}},
    };
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        float inverse[12];
        lavapipe_invert(pairs[i][0], inverse);
        for (int k = 0; k < 12; k++)
            assert_true(fabs((double)inverse[k] - pairs[i][1][k]) <= 1e-6 * (1 + fabs((double)pairs[i][1][k])));
    }
}

/* Matrices that Vulkan does not allow give zeros: all rays miss. */
static void singular_matrices_give_zeros(void **state)
{
    (void)state;
    static const float singular[][12] = {{0},
                                         {1, 2, 3, 4, 2, 4, 6, 8, 0, 0, 1, 0},
                                         {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 5},
                                         {0, 1, 0, 0, 0, 2, 1, 0, 0, 3, 2, 0}};
    for (size_t i = 0; i < sizeof singular / sizeof singular[0]; i++) {
        float inverse[12];
        memset(inverse, 0xff, sizeof inverse);
        lavapipe_invert(singular[i], inverse);
        for (int k = 0; k < 12; k++)
            assert_true(inverse[k] == 0);
    }
}

/*
 * Compares a hash of the bits of a thousand inverses, which changes with the order of operations and with fused
 * operations.
 */
static void bits_stay(void **state)
{
    (void)state;
    struct random random = {7};
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (int i = 0; i < 1000; i++) {
        float matrix[12], inverse[12];
        for (int k = 0; k < 12; k++)
            matrix[k] = i % 3 == 0 && k % 5 ? 0 : (float)random_between(&random, -10, 10);
        lavapipe_invert(matrix, inverse);
        const unsigned char *bytes = (const unsigned char *)inverse;
        for (size_t k = 0; k < sizeof inverse; k++)
            hash = (hash ^ bytes[k]) * UINT64_C(0x100000001b3);
    }
    if (hash != UINT64_C(0xe45ab3ed7503abec))
        fail_msg("the bits hash to 0x%016llx", (unsigned long long)hash);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(products_are_unit_matrices),
        cmocka_unit_test(known_inverses_are_found),
        cmocka_unit_test(singular_matrices_give_zeros),
        cmocka_unit_test(bits_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

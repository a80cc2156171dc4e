/* SPDX-License-Identifier: Apache-2.0 */
/* test_validate_canonical.c - tests the rules on contents directly; test_prepare has a wrong request for each. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/inputs.h"
#include "tests/support/random.h"
#include "builder/input/input_kind.h"
#include "builder/input/validate.h"

static void singular_matrices_are_found(void **state)
{
    (void)state;
    struct random random = {4};
    for (int round = 0; round < 5000; round++) {
        float matrix[12];
        int numbers[3][3];
        for (int i = 0; i < 9; i++)
            numbers[i / 3][i % 3] = (int)(random_next(&random) % 7) - 3;
        /* Whole numbers are exact, whatever power of two scales them. */
        float scale = ldexpf(1, (int)(random_next(&random) % 200) - 100);
        for (int i = 0; i < 12; i++)
            matrix[i] = i % 4 == 3 ? NAN : (float)numbers[i / 4][i % 4] * scale;
        int(*m)[3] = numbers;
        int determinant = m[0][0] * m[1][1] * m[2][2] + m[0][1] * m[1][2] * m[2][0] + m[0][2] * m[1][0] * m[2][1] -
                          m[0][2] * m[1][1] * m[2][0] - m[0][1] * m[1][0] * m[2][2] - m[0][0] * m[1][2] * m[2][1];
        assert_int_equal(validate_invertible(matrix), determinant != 0);
        matrix[round % 3 * 4 + round % 2] = round & 4 ? NAN : INFINITY;
        assert_false(validate_invertible(matrix));
    }
}

/* The third row is exactly the sum of the others, so whatever determinant double computes is rounding error. */
static void singular_floats_are_found(void **state)
{
    (void)state;
    struct random random = {5};
    unsigned exact = 0;
    for (int round = 0; round < 20000; round++) {
        float m[12] = {0};
        bool is_exact = true;
        for (int i = 0; i < 3; i++) {
            m[i] = (float)random_between(&random, -1, 1);
            m[4 + i] = (float)random_between(&random, -1, 1);
            m[8 + i] = m[i] + m[4 + i];
            is_exact &= (double)m[i] + m[4 + i] == (double)m[8 + i];
        }
        exact += is_exact;
        assert_true(!is_exact || !validate_invertible(m));
    }
    assert_true(exact > 1000);
}

static void small_and_flat_matrices_are_invertible(void **state)
{
    (void)state;
    const float tiny[12] = {1e-41f, 0, 0, 0, 0, 1e-20f, 0, 0, 0, 0, 1e30f, 0};
    const float turned[12] = {0.8f, -0.6f, 0, 0, 0.6e-6f, 0.8e-6f, 0, 0, 0, 0, 1, 0};
    assert_true(validate_invertible(tiny));
    assert_true(validate_invertible(turned));
}

/* True when the contents of primitives [0, count) keep the rules. */
static bool are_valid(const struct canonical_geometry *geometry, uint32_t count)
{
    struct bvhd_error error;
    return input_kind_of(geometry->type)->check_contents(geometry, 0, count, 0, 0, &error) == BVHD_OK;
}

static void runs_are_judged_whole(void **state)
{
    (void)state;
    struct test_input test;
    float boxes[20][6];
    const struct canonical_geometry aabbs = {.type = GEOMETRY_AABBS, .boxes = boxes[0]};
    const struct canonical_geometry instances = {.type = GEOMETRY_INSTANCES,
                                                 .instances = (const unsigned char *)test.records};
    for (int bad = -1; bad < 20; bad++) {
        for (int i = 0; i < 20; i++)
            for (int k = 0; k < 6; k++)
                boxes[i][k] = (float)(k < 3 ? -i : i);
        if (bad >= 0)
            boxes[bad][bad % 3] = 100;
        assert_int_equal(are_valid(&aabbs, 20), bad < 0);
        if (bad >= 0)
            boxes[bad][0] = NAN;
        assert_true(are_valid(&aabbs, 20));
    }
    for (int bad = -1; bad < INPUTS_RECORDS; bad++) {
        inputs_instances(&test);
        if (bad >= 0)
            test.records[bad][13] |= 0x80000000;
        assert_int_equal(are_valid(&instances, INPUTS_RECORDS), bad < 0);
    }
    assert_true(are_valid(&(struct canonical_geometry){.type = GEOMETRY_AABBS}, 0));
    assert_true(are_valid(&(struct canonical_geometry){.type = GEOMETRY_INSTANCES}, 0));
}

/* The first broken rule of all geometries is reported, with the entry's number in its batch. */
static void places_are_named(void **state)
{
    (void)state;
    float good[6] = {0, 0, 0, 1, 1, 1}, bad[12] = {0, 0, 0, 1, 1, 1, 0, 0, 2, 1, 1, 1};
    struct canonical_geometry geometries[2] = {{.type = GEOMETRY_AABBS, .primitive_count = 1, .boxes = good},
                                               {.type = GEOMETRY_AABBS, .primitive_count = 2, .boxes = bad}};
    struct canonical canonical = {.geometry_count = 2, .geometries = geometries};
    struct bvhd_error error;
    assert_int_equal(validate_canonical(&canonical, 6, NULL, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03548);
    assert_string_equal(error.where, "infos[6].geometries[1].aabbs[1].minZ");
    bad[8] = 1;
    assert_int_equal(validate_canonical(&canonical, 6, NULL, &error), BVHD_OK);
}

/* A geometry is checked in parts; in later parts, too, the primitive is named by its number in the geometry. */
static void later_primitives_are_named(void **state)
{
    (void)state;
    enum { COUNT = 20000, BAD = 17000 };
    float(*boxes)[6] = calloc(COUNT, sizeof *boxes);
    uint32_t(*records)[16] = calloc(COUNT, sizeof *records);
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = COUNT, .boxes = boxes[0]};
    struct canonical canonical = {.geometry_count = 1, .geometries = &geometry};
    struct bvhd_error error;
    assert_int_equal(validate_canonical(&canonical, 2, NULL, &error), BVHD_OK);
    boxes[BAD][1] = 1;
    assert_int_equal(validate_canonical(&canonical, 2, NULL, &error), BVHD_INVALID);
    assert_string_equal(error.where, "infos[2].geometries[0].aabbs[17000].minY");
    geometry = (struct canonical_geometry){
        .type = GEOMETRY_INSTANCES, .primitive_count = COUNT, .instances = (const unsigned char *)records};
    assert_int_equal(validate_canonical(&canonical, 2, NULL, &error), BVHD_OK);
    records[BAD][13] = 0x80000000;
    assert_int_equal(validate_canonical(&canonical, 2, NULL, &error), BVHD_INVALID);
    assert_string_equal(error.where, "infos[2].geometries[0].instances[17000].flags");
    free(boxes);
    free(records);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(singular_matrices_are_found),
        cmocka_unit_test(singular_floats_are_found),
        cmocka_unit_test(small_and_flat_matrices_are_invertible),
        cmocka_unit_test(runs_are_judged_whole),
        cmocka_unit_test(places_are_named),
        cmocka_unit_test(later_primitives_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

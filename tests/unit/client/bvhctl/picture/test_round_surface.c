/* SPDX-License-Identifier: Apache-2.0 */
/* test_round_surface.c - tests the normals of spheres and linear swept spheres, and what stands in for them. */
#include "tests/support/unit.h"

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/round_surface.h"

static const double tolerance = 1e-9;

static double between(uint64_t *state, double low, double high)
{
    return low + (high - low) * rays_uniform(state);
}

static struct vector random_unit(uint64_t *state)
{
    struct vector v;
    do
        v = vector_make(between(state, -1, 1), between(state, -1, 1), between(state, -1, 1));
    while (vector_length(v) > 1 || vector_length(v) < 0.1);
    return vector_unit(v);
}

/* Returns a swept sphere whose ends do not swallow each other, and by `u` a sphere that touches its side. */
static struct structure_round random_round(uint64_t *state, double *ret_u)
{
    struct structure_round round = {.caps = 3};
    struct vector way = vector_scale(random_unit(state), 3);
    for (int end = 0; end < 2; end++) {
        round.ends[end][0] = (float)(end * way.x);
        round.ends[end][1] = (float)(end * way.y);
        round.ends[end][2] = (float)(end * way.z);
        round.ends[end][3] = (float)between(state, 0.2, 1);
    }
    *ret_u = rays_uniform(state);
    return round;
}

/*
 * A point of the side whose normal is known: the normals there have the same slope along the axis, by which the radius
 * grows.
 */
static struct vector point_of_side(const struct structure_round *round, double u, struct vector side,
                                   struct vector *ret_normal)
{
    struct vector first = vector_from_floats(round->ends[0]), second = vector_from_floats(round->ends[1]);
    struct vector way = vector_sub(second, first), axis = vector_unit(way);
    double r0 = (double)round->ends[0][3], r1 = (double)round->ends[1][3], slope = (r0 - r1) / vector_length(way);
    struct vector across = vector_unit(vector_mad(side, axis, -vector_dot(side, axis)));
    *ret_normal = vector_mad(vector_scale(axis, slope), across, sqrt(1 - slope * slope));
    return vector_mad(vector_mix(first, second, u), *ret_normal, r0 + u * (r1 - r0));
}

static void normals_without_a_transform(void **state)
{
    uint64_t random = 1;
    (void)state;
    for (int i = 0; i < 1000; i++) {
        double u;
        struct vector normal;
        struct structure_round round = random_round(&random, &u);
        struct vector at = point_of_side(&round, u, random_unit(&random), &normal);
        struct vector found = round_surface_normal(&round, NULL, at, u);
        assert_true(vector_length(vector_sub(found, normal)) < tolerance);
    }
}

/* A transformed normal is perpendicular to transformed tangents, and points away from the inside, mirrored or not. */
static void normals_with_a_transform(void **state)
{
    uint64_t random = 2;
    int mirrored = 0;
    (void)state;
    for (int i = 0; i < 1000; i++) {
        double u;
        float matrix[12];
        struct vector normal, a, b;
        struct structure_round round = random_round(&random, &u);
        for (int k = 0; k < 12; k++)
            matrix[k] = (float)between(&random, -2, 2);
        struct vector x = {(double)matrix[0], (double)matrix[4], (double)matrix[8]},
                      y = {(double)matrix[1], (double)matrix[5], (double)matrix[9]},
                      z = {(double)matrix[2], (double)matrix[6], (double)matrix[10]};
        double determinant = vector_dot(x, vector_cross(y, z));
        mirrored += determinant < 0;
        if (fabs(determinant) < 0.5)
            continue;
        struct vector at = point_of_side(&round, u, random_unit(&random), &normal);
        vector_basis(normal, &a, &b);
        struct vector world = vector_transform(matrix, at);
        struct vector found = round_surface_normal(&round, matrix, world, u);
        assert_true(fabs(vector_length(found) - 1) < tolerance);
        struct vector to_a = vector_unit(vector_sub(vector_transform(matrix, vector_add(at, a)), world)),
                      to_b = vector_unit(vector_sub(vector_transform(matrix, vector_add(at, b)), world)),
                      outside = vector_sub(vector_transform(matrix, vector_add(at, normal)), world);
        assert_true(fabs(vector_dot(found, to_a)) < 1e-6 && fabs(vector_dot(found, to_b)) < 1e-6);
        assert_true(vector_dot(found, outside) > 0);
    }
    assert_in_range(mirrored, 100, 900);
}

/* Matrices of any magnitude that floats have. */
static void large_and_small_transforms(void **state)
{
    static const float scales[] = {1e-30f, 1e-10f, 1, 1e10f, 1e30f};
    const struct structure_round sphere = {.ends = {{0, 0, 0, 1}, {0, 0, 0, 1}}};
    (void)state;
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        float s = scales[i], matrix[12] = {s, 0, 0, 0, 0, 2 * s, 0, 0, 0, 0, -s, 0};
        struct vector at = vector_make(0.6 * (double)s, 0, -0.8 * (double)s);
        struct vector found = round_surface_normal(&sphere, matrix, at, 0);
        assert_true(vector_length(vector_sub(found, vector_make(0.6, 0, -0.8))) < 1e-6);
    }
}

static void stand_ins_cover_the_primitive(void **state)
{
    const struct structure_round swept = {.ends = {{1, 0, 0, 0.5f}, {4, 0, 0, 0.25f}}},
                                 sphere = {.ends = {{1, 2, 3, 2}, {1, 2, 3, 2}}};
    struct vector corners[3];
    (void)state;
    round_surface_stand_in(&swept, corners);
    assert_true(corners[0].x == 0.5 && corners[1].x == 0.5 && corners[2].x == 4.25);
    assert_true(vector_length(vector_sub(corners[0], corners[1])) == 1);
    round_surface_stand_in(&sphere, corners);
    assert_true(vector_length(vector_normal(corners)) > 0.99);
    for (int i = 0; i < 3; i++)
        assert_true(vector_length(vector_sub(corners[i], vector_make(1, 2, 3))) < 3);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(normals_without_a_transform),
        cmocka_unit_test(normals_with_a_transform),
        cmocka_unit_test(large_and_small_transforms),
        cmocka_unit_test(stand_ins_cover_the_primitive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

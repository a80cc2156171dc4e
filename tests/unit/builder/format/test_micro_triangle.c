/* SPDX-License-Identifier: Apache-2.0 */
/* test_micro_triangle.c - tests the order of micro-triangles against the recursion that defines it, in double. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/micro_triangle.h"

struct point {
    double u, v;
};

static struct point middle(struct point a, struct point b)
{
    return (struct point){(a.u + b.u) / 2, (a.v + b.v) / 2};
}

/* Checks a micro-triangle: points in it have its index, and it has these corners. */
static void check_micro(uint32_t index, unsigned level, struct point a, struct point b, struct point c)
{
    static const double weights[][3] = {
        {1. / 3, 1. / 3, 1. / 3}, {0.98, 0.01, 0.01}, {0.01, 0.98, 0.01}, {0.01, 0.01, 0.98}, {0.49, 0.49, 0.02}};
    for (size_t i = 0; i < sizeof weights / sizeof weights[0]; i++) {
        const double *w = weights[i];
        float u = (float)(w[0] * a.u + w[1] * b.u + w[2] * c.u), v = (float)(w[0] * a.v + w[1] * b.v + w[2] * c.v);
        assert_int_equal(micro_triangle_index(u, v, level), index);
    }
    uint32_t corners[3][2];
    bool is_upright = micro_triangle_corners(index, level, corners);
    const struct point points[3] = {a, b, c};
    for (unsigned corner = 0; corner < 3; corner++) {
        assert_true(ldexp(corners[corner][0], -(int)level) == points[corner].u);
        assert_true(ldexp(corners[corner][1], -(int)level) == points[corner].v);
    }
    double low_u = fmin(a.u, fmin(b.u, c.u)), low_v = fmin(a.v, fmin(b.v, c.v));
    bool has_low = false;
    for (unsigned corner = 0; corner < 3; corner++)
        has_low |= points[corner].u == low_u && points[corner].v == low_v;
    assert_int_equal(is_upright, has_low);
}

static void check_below(uint32_t index, unsigned depth, unsigned level, struct point a, struct point b, struct point c)
{
    if (depth == level) {
        check_micro(index, level, a, b, c);
        return;
    }
    struct point p = middle(a, b), q = middle(b, c), r = middle(c, a);
    check_below(4 * index, depth + 1, level, a, p, r);
    check_below(4 * index + 1, depth + 1, level, r, q, p);
    check_below(4 * index + 2, depth + 1, level, p, b, q);
    check_below(4 * index + 3, depth + 1, level, q, r, c);
}

static void test_order(void **state)
{
    (void)state;
    for (unsigned level = 0; level <= 8; level++)
        check_below(0, 0, level, (struct point){0, 0}, (struct point){1, 0}, (struct point){0, 1});
}

/* The middles of the micro-triangles that level 1 has, as the specification draws them. */
static void test_level_1(void **state)
{
    (void)state;
    assert_int_equal(micro_triangle_index(0.1f, 0.1f, 1), 0);
    assert_int_equal(micro_triangle_index(0.3f, 0.3f, 1), 1);
    assert_int_equal(micro_triangle_index(0.8f, 0.1f, 1), 2);
    assert_int_equal(micro_triangle_index(0.1f, 0.8f, 1), 3);
}

/* Equal to the index of a point inside; what any float gives is in range. */
static void test_hostile(void **state)
{
    (void)state;
    const float odd[] = {NAN,    -NAN, INFINITY, -INFINITY, -0.0f,   0,        -1,       2,        1e30f,
                         -1e30f, 0.5f, 1,        1e-45f,    -1e-45f, 0x1p-24f, 0x1p-12f, 0.99999f, 1.00001f};
    const size_t count = sizeof odd / sizeof odd[0];
    for (unsigned level = 0; level <= MICRO_LEVEL_MAX; level++) {
        for (size_t i = 0; i < count; i++)
            for (size_t j = 0; j < count; j++)
                assert_true(micro_triangle_index(odd[i], odd[j], level) < micro_triangle_count(level));
        uint32_t first = micro_triangle_index(0, 0, level), second = micro_triangle_index(1, 0, level);
        uint32_t third = micro_triangle_index(0, 1, level);
        assert_int_equal(micro_triangle_index(NAN, NAN, level), first);
        assert_int_equal(micro_triangle_index(-1, -INFINITY, level), first);
        assert_int_equal(micro_triangle_index(INFINITY, NAN, level), second);
        assert_int_equal(micro_triangle_index(1, -3, level), second);
        assert_int_equal(micro_triangle_index(5, 1, level), third);
    }
}

static void test_sizes(void **state)
{
    (void)state;
    assert_int_equal(micro_triangle_bytes(MICRO_2_STATE, 0), 1);
    assert_int_equal(micro_triangle_bytes(MICRO_4_STATE, 0), 1);
    assert_int_equal(micro_triangle_bytes(MICRO_2_STATE, 1), 1);
    assert_int_equal(micro_triangle_bytes(MICRO_4_STATE, 1), 1);
    assert_int_equal(micro_triangle_bytes(MICRO_2_STATE, 2), 2);
    assert_int_equal(micro_triangle_bytes(MICRO_4_STATE, 4), 64);
    assert_int_equal(micro_triangle_bytes(MICRO_2_STATE, 12), 2097152);
    assert_int_equal(micro_triangle_bytes(MICRO_4_STATE, 12), 4194304);
}

static void test_states(void **state)
{
    (void)state;
    const unsigned char states[] = {0xe4, 0x1b};
    const unsigned four[] = {0, 1, 2, 3, 3, 2, 1, 0}, two[] = {0, 0, 1, 0, 0, 1, 1, 1, 1, 1, 0, 1, 1, 0, 0, 0};
    for (uint32_t i = 0; i < 8; i++)
        assert_int_equal(micro_triangle_state(states, MICRO_4_STATE, i), four[i]);
    for (uint32_t i = 0; i < 16; i++)
        assert_int_equal(micro_triangle_state(states, MICRO_2_STATE, i), two[i]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order), cmocka_unit_test(test_level_1), cmocka_unit_test(test_hostile),
        cmocka_unit_test(test_sizes), cmocka_unit_test(test_states),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

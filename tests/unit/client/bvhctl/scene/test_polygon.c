/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_polygon.c - tests that polygons of any shape are cut into corners - 2 triangles, which cover those that are
 * simple exactly, and in bounded time.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/polygon.h"
#include "tests/support/random.h"

enum { MOST = 1000 };

static float positions[3 * MOST];
static uint32_t vertices[MOST], triangles[3 * MOST];
static struct memory memory;

static int prepare(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t i = 0; i < MOST; i++)
        vertices[i] = i;
    return 0;
}

/* Places corner i at (x, y) of a plane that is tilted in one of several ways. */
static void place(uint32_t i, double x, double y, int tilt)
{
    float *p = positions + (size_t)3 * i;
    p[tilt % 3] = (float)x;
    p[(tilt + 1) % 3] = (float)(tilt % 2 ? -y : y);
    p[(tilt + 2) % 3] = (float)(tilt / 6 ? 0.25 * x - 0.5 * y : 3);
}

static bool cut(uint32_t count)
{
    struct polygon_cutter cutter;
    bool is_fanned;
    polygon_cutter_init(&cutter, &memory);
    assert_true(polygon_cut(&cutter, positions, vertices, count, triangles, &is_fanned));
    polygon_cutter_finish(&cutter);
    polygon_cutter_finish(&cutter);
    assert_int_equal(memory.live, 0);
    for (uint32_t i = 0; i < 3 * (count - 2); i++)
        assert_true(triangles[i] < count);
    return is_fanned;
}

/* Adds the normal of a triangle, with the length of twice its area; returns that length. */
static double add_normal(const uint32_t *corners, double sum[3])
{
    double a[3], b[3], normal[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)positions[3 * corners[1] + (uint32_t)axis] - positions[3 * corners[0] + (uint32_t)axis];
        b[axis] = (double)positions[3 * corners[2] + (uint32_t)axis] - positions[3 * corners[0] + (uint32_t)axis];
    }
    for (int axis = 0; axis < 3; axis++)
        sum[axis] += normal[axis] = a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3];
    return sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
}

/*
 * The areas sum up to the polygon's area. Triangles that overlap, or that face the other way, would give more, because
 * the sum of the normals is the polygon's in any case.
 */
static void check_cover(uint32_t count)
{
    double sum[3] = {0}, areas = 0;
    for (uint32_t i = 0; i + 2 < count; i++)
        areas += add_normal(triangles + (size_t)3 * i, sum);
    double area = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]), polygon[3] = {0};
    assert_true(fabs(areas - area) <= 1e-5 * area);
    for (uint32_t i = 2; i < count; i++)
        add_normal((const uint32_t[]){0, i - 1, i}, polygon);
    for (int axis = 0; axis < 3; axis++)
        assert_true(fabs(polygon[axis] - sum[axis]) <= 1e-5 * area);
}

static void test_orders(void **state)
{
    (void)state;
    static const uint32_t quad[] = {0, 1, 2, 0, 2, 3}, dart[] = {2, 3, 0, 2, 0, 1};
    static const uint32_t pentagon[] = {4, 0, 1, 4, 1, 2, 2, 3, 4};
    static const double dart_points[4][2] = {{0, 0}, {4, 0}, {1, 1}, {0, 4}};
    for (int tilt = 0; tilt < 12; tilt++) {
        for (uint32_t i = 0; i < 4; i++)
            place(i, i == 1 || i == 2, i >= 2, tilt);
        assert_false(cut(4));
        assert_memory_equal(triangles, quad, sizeof quad);
        for (uint32_t i = 0; i < 4; i++)
            place(i, dart_points[i][0], dart_points[i][1], tilt);
        assert_false(cut(4));
        assert_memory_equal(triangles, dart, sizeof dart);
        for (uint32_t i = 0; i < 5; i++)
            place(i, cos(i * 1.2566), sin(i * 1.2566), tilt);
        assert_false(cut(5));
        assert_memory_equal(triangles, pentagon, sizeof pentagon);
    }
}

/* Stars and combs with random sizes are simple, and most of their corners are reflex. */
static void test_simple(void **state)
{
    (void)state;
    struct random random = {3};
    for (int run = 0; run < 600; run++) {
        uint32_t count = 5 + (uint32_t)(random_next(&random) % (run % 50 ? 60 : MOST - 5));
        bool is_comb = run % 2;
        for (uint32_t i = 0; i < count; i++) {
            double size = random_between(&random, 0.2, 3), angle = i * 6.283185307 / count;
            if (!is_comb)
                place(i, size * cos(angle), size * sin(angle), run % 12);
            else if (i + 2 < count)
                place(i, i, i % 2 ? 5 : size, run % 12);
            else
                place(i, i + 2 == count ? (double)count : -1, 100, run % 12);
        }
        assert_false(cut(count));
        check_cover(count);
    }
}

/* Straight and repeated corners give triangles without area, and no corner is left out. */
static void test_straight(void **state)
{
    (void)state;
    for (int tilt = 0; tilt < 12; tilt++) {
        for (uint32_t i = 0; i < 40; i++) {
            uint32_t side = i / 10, along = side % 2 ? 0 : i % 10;
            place(i,
                  side == 0   ? along
                  : side == 1 ? 10
                  : side == 2 ? 10.0 - along
                              : 0,
                  side == 0   ? 0
                  : side == 1 ? i % 10
                  : side == 2 ? 10
                              : 10.0 - i % 10,
                  tilt);
        }
        assert_false(cut(40));
        check_cover(40);
        for (uint32_t i = 0; i < 40; i++)
            place(i, 1, 1, tilt);
        cut(40);
    }
}

/* Corners that form no simple polygon give as many triangles, too. */
static void test_any(void **state)
{
    (void)state;
    struct random random = {4};
    int fanned = 0;
    for (int run = 0; run < 3000; run++) {
        uint32_t count = 3 + (uint32_t)(random_next(&random) % 30);
        for (uint32_t i = 0; i < 3 * count; i++) {
            uint64_t kind = random_next(&random) % 40;
            positions[i] = kind == 0 ? NAN : kind == 1 ? INFINITY : (float)(int)(random_next(&random) % 9);
        }
        fanned += cut(count);
    }
    assert_true(fanned > 100);
}

/* A polygon in which no ear is found for long is a fan after a second at most, not after minutes. */
static void test_time(void **state)
{
    (void)state;
    enum { LARGE = 300000 };
    float *points = malloc(LARGE * 3 * sizeof *points);
    uint32_t *numbers = malloc(LARGE * sizeof *numbers), *result = malloc(LARGE * 3 * sizeof *result);
    struct random random = {5};
    for (uint32_t i = 0; i < LARGE; i++) {
        numbers[i] = i;
        points[3 * i] = (float)random_between(&random, 0, 1);
        points[3 * i + 1] = (float)random_between(&random, 0, 1);
        points[3 * i + 2] = 0;
    }
    struct polygon_cutter cutter;
    bool is_fanned;
    polygon_cutter_init(&cutter, &memory);
    assert_true(polygon_cut(&cutter, points, numbers, LARGE, result, &is_fanned));
    assert_true(is_fanned);
    polygon_cutter_finish(&cutter);
    free(points);
    free(numbers);
    free(result);
}

static void test_no_memory(void **state)
{
    (void)state;
    for (int64_t after = 0; after < 2; after++) {
        struct polygon_cutter cutter;
        bool is_fanned;
        polygon_cutter_init(&cutter, &memory);
        atomic_store(&memory.fail_after, after);
        assert_false(polygon_cut(&cutter, positions, vertices, 7, triangles, &is_fanned));
        polygon_cutter_finish(&cutter);
        assert_int_equal(memory.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_orders), cmocka_unit_test(test_simple), cmocka_unit_test(test_straight),
        cmocka_unit_test(test_any),    cmocka_unit_test(test_time),   cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("polygon", tests, prepare, NULL);
}

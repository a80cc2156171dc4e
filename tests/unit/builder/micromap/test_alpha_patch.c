/* SPDX-License-Identifier: Apache-2.0 */
/* test_alpha_patch.c - tests bounds of filtered alpha against its values at many points. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/alpha_patch.h"
#include "tests/support/random.h"

enum { GRID = 60 };

static const double box_below[2] = {-1, -1}, box_above[2] = {2, 2};

static double value(const struct alpha_patch *patch, double s, double t)
{
    return patch->a + patch->b * s + patch->c * t + patch->d * s * t;
}

static bool is_inside(const struct half_plane planes[3], double s, double t, double more)
{
    for (int i = 0; i < 3; i++)
        if (planes[i].s * s + planes[i].t * t > planes[i].limit + more)
            return false;
    return true;
}

/* Bounds hold at each point, and are reached but for what alpha changes between the points. */
static void test_range(void **state)
{
    (void)state;
    struct random random = {3};
    unsigned found = 0;
    for (int round = 0; round < 3000; round++) {
        const struct alpha_patch patch = {random_between(&random, 0, 255), random_between(&random, -200, 200),
                                          random_between(&random, -200, 200), random_between(&random, -300, 300)};
        struct half_plane planes[3];
        for (int i = 0; i < 3; i++) {
            const double turn = random_between(&random, 0, 6.2832);
            planes[i] = (struct half_plane){cos(turn), sin(turn), random_between(&random, -0.8, 1.6)};
        }
        const double box_low[2] = {random_between(&random, -1, 0.4), random_between(&random, -1, 0.4)};
        const double box_high[2] = {random_between(&random, 0.6, 2), random_between(&random, 0.6, 2)};
        double low = NAN, high = NAN, least = INFINITY, most = -INFINITY;
        const bool is_there = alpha_patch_range(&patch, box_low, box_high, planes, &low, &high);
        for (int i = 0; i <= GRID; i++)
            for (int j = 0; j <= GRID; j++) {
                const double s = (double)i / GRID, t = (double)j / GRID, at = value(&patch, s, t);
                if (s < box_low[0] || s > box_high[0] || t < box_low[1] || t > box_high[1] ||
                    !is_inside(planes, s, t, 0))
                    continue;
                assert_true(is_there && low <= at && at <= high);
                least = fmin(least, at);
                most = fmax(most, at);
            }
        if (!is_there || least > most)
            continue;
        found++;
        const double step = 4.0 / GRID * (fabs(patch.b) + fabs(patch.c) + 2 * fabs(patch.d));
        bool has_inner = false; /* thin parts have points of the grid by chance */
        for (int i = 0; i <= GRID; i++)
            for (int j = 0; j <= GRID; j++)
                has_inner |= is_inside(planes, (double)i / GRID, (double)j / GRID, -0.2);
        if (has_inner && planes[0].limit > 1 && planes[1].limit > 1 && box_low[0] < 0 && box_low[1] < 0 &&
            box_high[0] > 1 && box_high[1] > 1) {
            assert_true(low >= least - step);
            assert_true(high <= most + step);
        }
    }
    assert_true(found > 500);
}

/* A saddle has its extremes over a thin band along a diagonal in the middle of an edge of the band. */
static void test_edge_extreme(void **state)
{
    (void)state;
    const struct alpha_patch saddle = {0, 0, 0, 100}; /* 100 s t */
    const double half = sqrt(0.5);
    const struct half_plane band[3] = {{half, half, half}, {-half, -half, -half}, {1, 0, 2}};
    double low, high;
    assert_true(alpha_patch_range(&saddle, box_below, box_above, band, &low, &high));
    assert_true(fabs(low - 0) < 0.01);
    assert_true(fabs(high - 25) < 0.01);
}

static void test_nothing(void **state)
{
    (void)state;
    const struct alpha_patch patch = {1, 2, 3, 4};
    const struct half_plane apart[3] = {{1, 0, -0.1}, {0, 1, 5}, {0, 1, 5}};
    const struct half_plane all[3] = {{1, 0, 5}, {0, 1, 5}, {-1, 0, 5}};
    double low = 7, high = 7;
    assert_false(alpha_patch_range(&patch, box_below, box_above, apart, &low, &high));
    assert_true(low == 7 && high == 7);
    assert_false(alpha_patch_range(&patch, (const double[2]){0.5, -1}, (const double[2]){0.4, 2}, all, &low, &high));
    assert_false(alpha_patch_range(&patch, (const double[2]){-1, 1.5}, (const double[2]){2, 2}, all, &low, &high));
    assert_true(low == 7 && high == 7);
    assert_true(alpha_patch_range(&patch, box_below, box_above, all, &low, &high));
    assert_true(fabs(low - 1) < 0.01 && fabs(high - 10) < 0.01);
}

static void test_make(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const unsigned char texels[] = {10, 20, 40, 80};
    const struct alpha_source source = {
        .texels = {texels, 4}, .row_stride = 2, .width = 2, .height = 2, .cutoff = 0.5f};
    struct alpha_cells cells;
    assert_int_equal(alpha_cells_init(&source, &context, &cells, NULL), BVHD_OK);
    struct alpha_patch patch = alpha_patch_make(&cells, 0, 0);
    assert_true(value(&patch, 0, 0) == 10 && value(&patch, 1, 0) == 20);
    assert_true(value(&patch, 0, 1) == 40 && value(&patch, 1, 1) == 80);
    patch = alpha_patch_make(&cells, -1, 3); /* texels 1, 0 of row 1, then of row 0 */
    assert_true(value(&patch, 0, 0) == 80 && value(&patch, 1, 0) == 40);
    assert_true(value(&patch, 0, 1) == 20 && value(&patch, 1, 1) == 10);
    alpha_cells_finish(&cells, &memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_range),
        cmocka_unit_test(test_edge_extreme),
        cmocka_unit_test(test_nothing),
        cmocka_unit_test(test_make),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_micro_reach.c - tests that rows reach every point of micro-triangles and not much more, with and without SSE2.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/micro_scan.h"
#include "tests/support/random.h"

struct micro_range reach_of_scalar(const struct micro_shape *shape, const double anchor[2], double from, double to,
                                   double pad);

static struct memory memory;
static struct alpha_cells cells;

static struct texture_triangle make_triangle(struct random *random)
{
    float corners[3][2];
    const double size = pow(10, random_between(random, -3, 0));
    for (int i = 0; i < 6; i++)
        corners[i / 2][i % 2] = (float)random_between(random, 0.3, 0.3 + size);
    switch (random_next(random) % 8) {
    case 0:
        corners[0][1] = corners[1][1];
        break;
    case 1:
        corners[0][1] = nextafterf(corners[1][1], 2);
        break;
    case 2:
        corners[0][1] = corners[1][1] = corners[2][1];
        break;
    case 3:
        for (int axis = 0; axis < 2; axis++)
            corners[2][axis] = (corners[0][axis] + corners[1][axis]) / 2;
        break;
    case 4:
        corners[0][0] = corners[1][0];
        break;
    default:
        break;
    }
    static const float extra[2] = {0, 0};
    struct texture_triangle triangle;
    texture_triangle_init(&cells, (const float(*)[2])corners, extra, 4, &triangle);
    return triangle;
}

/* The true reach of the part of a triangle between two lines, from its corners and from where lines cut its edges. */
static bool true_reach(double corners[3][2], double from, double to, double *ret_low, double *ret_high)
{
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double *a = corners[i], *b = corners[(i + 1) % 3], cuts[2] = {from, to};
        if (a[1] >= from && a[1] <= to) {
            low = fmin(low, a[0]);
            high = fmax(high, a[0]);
        }
        for (int cut = 0; cut < 2; cut++) {
            const double share = (cuts[cut] - a[1]) / (b[1] - a[1]), x = a[0] + share * (b[0] - a[0]);
            if (share >= 0 && share <= 1) {
                low = fmin(low, x);
                high = fmax(high, x);
            }
        }
    }
    *ret_low = low;
    *ret_high = high;
    return low <= high;
}

/* Checks the rows of one micro-triangle; `slack` is how far a box may exceed a flat shape. */
static void check_rows(const struct texture_triangle *triangle, unsigned level, bool is_upright, double anchor[2])
{
    const struct micro_grid *grid = &triangle->grids[level];
    const struct micro_shape *shape = is_upright ? &grid->upright : &grid->turned;
    const struct micro_placed placed = micro_reach_place(shape, anchor);
    const struct micro_range rows = micro_reach_rows(&placed, triangle->pad[1]);
    const double sign = is_upright ? 1 : -1, *pad = triangle->pad, least_pad = pad[0] / 1.25;
    double corners[3][2];
    for (int axis = 0; axis < 2; axis++) {
        corners[0][axis] = anchor[axis];
        corners[1][axis] = anchor[axis] + sign * grid->step_u[axis];
        corners[2][axis] = anchor[axis] + sign * grid->step_v[axis];
    }
    for (int64_t row = rows.first - 1; row <= rows.last + 1; row++) {
        double low, high;
        const double from = (double)row - pad[1] / 1.25, to = (double)row + 1 + pad[1] / 1.25;
        if (!true_reach(corners, from, to, &low, &high))
            continue;
        assert_true(row >= rows.first && row <= rows.last);
        const double given_from = (double)row - pad[1], given_to = (double)row + 1 + pad[1];
        const struct micro_range reach = micro_reach_between(&placed, given_from, given_to, pad[0]);
        assert_true((double)reach.first <= low - least_pad && (double)reach.last + 1 >= high + least_pad);
        const struct micro_range same = reach_of_scalar(shape, anchor, given_from, given_to, pad[0]);
        assert_true(same.first == reach.first && same.last == reach.last);
        /* A wider strip by two more pads reaches as far, but for boxes. */
        if (placed.bottom - placed.top > pad[1] && true_reach(corners, from - pad[1], to + pad[1], &low, &high))
            assert_true((double)reach.first >= floor(low - 2 * pad[0]) && (double)reach.last <= high + 2 * pad[0]);
    }
}

static void test_rows(void **state)
{
    (void)state;
    struct random random = {1};
    for (int round = 0; round < 20000; round++) {
        const struct texture_triangle triangle = make_triangle(&random);
        const unsigned level = (unsigned)(random_next(&random) % 5);
        const uint32_t parts = 1u << level, i = (uint32_t)(random_next(&random) % parts);
        const bool is_upright = i == parts - 1 || random_next(&random) % 2;
        const uint32_t turned = is_upright ? 0 : 1;
        double anchor[2];
        texture_triangle_anchor(&triangle, level, i + turned, turned, anchor);
        check_rows(&triangle, level, is_upright, anchor);
    }
}

static void test_floor(void **state)
{
    (void)state;
    static const double numbers[] = {0, 0.5, -0.5, 1, -1, -1.25, 7.999, 1e8, -1e8};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        assert_true((double)micro_reach_floor(numbers[i]) == floor(numbers[i]));
}

int main(void)
{
    static const unsigned char texels[1000];
    const struct alpha_source source = {
        .texels = {texels, 1000}, .row_stride = 1, .width = 1, .height = 1000, .cutoff = 0.5f};
    struct alpha_source wide = source;
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    static unsigned char plane[256 * 256];
    memory_init(&memory, UINT64_MAX);
    wide.texels = (struct bytes){plane, sizeof plane};
    wide.row_stride = wide.width = wide.height = 256;
    if (alpha_cells_init(&wide, &context, &cells, NULL) != BVHD_OK)
        return 1;
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_rows), cmocka_unit_test(test_floor)};
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    alpha_cells_finish(&cells, &memory);
    return failed;
}

/* The version without SSE2, which headers leave out where there is SSE2. */
#define BVHD_SCALAR
#undef BVHD_MICRO_REACH_H
#undef MICRO_REACH_MAX
#undef MICRO_REACH_SSE2
#define micro_shape micro_shape_scalar
#define micro_range micro_range_scalar
#define micro_placed micro_placed_scalar
#define micro_reach_floor micro_reach_floor_scalar
#define micro_reach_least micro_reach_least_scalar
#define micro_reach_greatest micro_reach_greatest_scalar
#define micro_reach_place micro_reach_place_scalar
#define micro_reach_between micro_reach_between_scalar
#define micro_reach_rows micro_reach_rows_scalar
#include "builder/micromap/micro_reach.h"
#undef micro_shape
#undef micro_range

struct micro_range reach_of_scalar(const struct micro_shape *shape, const double anchor[2], double from, double to,
                                   double pad)
{
    struct micro_shape_scalar copy;
    _Static_assert(sizeof copy == sizeof *shape, "the same struct");
    memcpy(&copy, shape, sizeof copy);
    const struct micro_placed_scalar placed = micro_reach_place_scalar(&copy, anchor);
    const struct micro_range_scalar range = micro_reach_between_scalar(&placed, from, to, pad);
    (void)micro_reach_rows_scalar;
    return (struct micro_range){range.first, range.last};
}

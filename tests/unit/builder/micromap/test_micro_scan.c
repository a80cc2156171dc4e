/* SPDX-License-Identifier: Apache-2.0 */
/* test_micro_scan.c - tests what is decided in micro-triangles against points of them, and that enough is decided. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/micro_scan.h"
#include "tests/support/random.h"

enum { SIDE = 64, POINTS = 20 };

static unsigned char texels[SIDE * SIDE];
static struct memory memory;
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

static struct alpha_cells make_cells(struct random *random, bool is_nearest)
{
    const double a = random_between(random, 0.05, 0.4), b = random_between(random, 0.05, 0.4);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int x = i % SIDE, y = i / SIDE;
        texels[i] = (unsigned char)fmin(255, fmax(0, 127.5 + 300 * sin(a * x + 2 * sin(b * y))));
    }
    const struct alpha_source source = {.texels = {texels, sizeof texels},
                                        .row_stride = SIDE,
                                        .width = SIDE,
                                        .height = SIDE,
                                        .wrap_u = (enum bake_wrap)(random_next(random) % 3),
                                        .wrap_v = (enum bake_wrap)(random_next(random) % 3),
                                        .is_nearest = is_nearest,
                                        .cutoff = 0.5f};
    struct alpha_cells cells;
    assert_int_equal(alpha_cells_init(&source, &context, &cells, NULL), BVHD_OK);
    return cells;
}

struct tally {
    unsigned decided, missed, wrong;
};

/* Compares the sets of a micro-triangle with points of it. */
static void check_micro(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                        bool is_upright, const double anchor[2], struct tally *tally)
{
    const struct micro_grid *grid = &triangle->grids[level];
    const double sign = is_upright ? 1 : -1;
    unsigned points = 0;
    for (int i = 0; i <= POINTS; i++)
        for (int j = 0; i + j <= POINTS; j++) {
            double at[2];
            for (int axis = 0; axis < 2; axis++)
                at[axis] = anchor[axis] + sign * (i * grid->step_u[axis] + j * grid->step_v[axis]) / POINTS;
            points |= alpha_cells_pass(cells, at[0], at[1]) ? ALPHA_PASSES : ALPHA_FAILS;
        }
    const unsigned quick = micro_scan(cells, triangle, level, is_upright, anchor, grid->order);
    const unsigned last = micro_scan(cells, triangle, level, is_upright, anchor, grid->order_last);
    const unsigned corners = micro_scan_corners(cells, triangle, level, is_upright, anchor);
    const unsigned bounds =
        grid->may_bound ? micro_scan_bounds(cells, triangle, level, is_upright, anchor) : (unsigned)ALPHA_MIXED;
    assert_true(quick != 0 && last != 0 && bounds != 0);
    assert_int_equal(corners & ~points, 0);
    const unsigned sets[] = {quick, last, bounds};
    for (int i = 0; i < 3; i++)
        if (sets[i] == ALPHA_PASSES || sets[i] == ALPHA_FAILS)
            tally->wrong += sets[i] != points;
    const bool is_uniform = points == ALPHA_PASSES || points == ALPHA_FAILS;
    tally->decided += is_uniform && (bounds == points || last == points);
    tally->missed += is_uniform && bounds != points && last != points;
}

static struct tally check_all(bool is_nearest, double least, double most)
{
    static const float extra[2] = {0, 0};
    struct random random = {1};
    struct tally tally = {0};
    for (int round = 0; round < 100; round++) {
        struct alpha_cells cells = make_cells(&random, is_nearest);
        for (int i = 0; i < 20; i++) {
            float corners[3][2];
            const double size = random_between(&random, least, most), away = random_between(&random, -3, 3);
            for (int axis = 0; axis < 6; axis++)
                corners[axis / 2][axis % 2] = (float)(away + random_between(&random, -size, size));
            struct texture_triangle triangle;
            texture_triangle_init(&cells, (const float(*)[2])corners, extra, 3, &triangle);
            assert_false(triangle.is_everywhere);
            const unsigned level = (unsigned)(random_next(&random) % 4);
            const bool is_upright = level == 0 || random_next(&random) % 2;
            double anchor[2];
            texture_triangle_anchor(&triangle, level, is_upright ? 0 : 1, is_upright ? 0 : 1, anchor);
            check_micro(&cells, &triangle, level, is_upright, anchor, &tally);
        }
        alpha_cells_finish(&cells, &memory);
    }
    return tally;
}

static void test_nearest(void **state)
{
    (void)state;
    const struct tally tally = check_all(true, 0.01, 0.3);
    assert_int_equal(tally.wrong, 0);
    assert_true(tally.decided > 50 * tally.missed && tally.decided > 300); /* points may miss a texel */
}

static void test_bilinear(void **state)
{
    (void)state;
    const struct tally tally = check_all(false, 0.01, 0.3);
    assert_int_equal(tally.wrong, 0);
    assert_true(tally.decided > 30 * tally.missed && tally.decided > 300);
}

/* Over many repeats blocks are looked at, and nothing is missed. */
static void test_large(void **state)
{
    (void)state;
    assert_int_equal(check_all(false, 2, 500).wrong, 0);
    assert_int_equal(check_all(true, 2, 500).wrong, 0);
}

static void test_everywhere(void **state)
{
    (void)state;
    static const float extra[2] = {0, 0};
    struct random random = {1};
    struct alpha_cells cells = make_cells(&random, false);
    const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f, 0x1p20f, -0x1p21f};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        for (int place = 0; place < 6; place++) {
            float corners[3][2] = {{0, 0}, {1, 0}, {0, 1}};
            corners[place / 2][place % 2] = bad[i];
            struct texture_triangle triangle;
            texture_triangle_init(&cells, (const float(*)[2])corners, extra, 3, &triangle);
            assert_true(triangle.is_everywhere);
        }
    alpha_cells_finish(&cells, &memory);
}

int main(void)
{
    memory_init(&memory, UINT64_MAX);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_bilinear),
        cmocka_unit_test(test_large),
        cmocka_unit_test(test_everywhere),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_alpha_cells.c - tests what is said of cells and blocks against the texels that they read. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/alpha_cells.h"
#include "builder/workers.h"
#include "tests/support/random.h"

enum { SIDE_MAX = 150 };

static unsigned char texels[SIDE_MAX * SIDE_MAX];

/* Texels with long and short runs of few values. */
static struct alpha_source make_source(struct random *random, uint32_t width, uint32_t height)
{
    static const unsigned char values[] = {0, 255, 127, 128, 1, 254};
    for (uint32_t i = 0; i < width * height; i++)
        texels[i] = i > 0 && random_next(random) % 8 ? texels[i - 1] : values[random_next(random) % 6];
    return (struct alpha_source){.texels = {texels, (uint64_t)width * height},
                                 .row_stride = width,
                                 .width = width,
                                 .height = height,
                                 .wrap_u = (enum bake_wrap)(random_next(random) % 3),
                                 .wrap_v = (enum bake_wrap)(random_next(random) % 3),
                                 .is_nearest = random_next(random) % 2,
                                 .mode = random_next(random) % 2 ? BAKE_MASK : BAKE_BLEND,
                                 .cutoff = 0.5f};
}

/* The set of a cell, from its texels; its numbers may be outside the texture. */
static unsigned set_of(const struct alpha_source *source, const struct alpha_cells *cells, int64_t x, int64_t y)
{
    const int64_t reach = source->is_nearest ? 0 : 1;
    int least = 255, most = 0;
    for (int64_t i = 0; i <= reach; i++)
        for (int64_t j = 0; j <= reach; j++) {
            const int alpha =
                alpha_cells_texel(cells, x + i + cells->axes[0].first_texel, y + j + cells->axes[1].first_texel);
            least = alpha < least ? alpha : least;
            most = alpha > most ? alpha : most;
        }
    if (source->mode == BAKE_MASK)
        return least >= 128 ? ALPHA_PASSES : most < 128 ? ALPHA_FAILS : ALPHA_MIXED;
    return least == 255 ? ALPHA_PASSES : most == 0 ? ALPHA_FAILS : ALPHA_MIXED;
}

/* Compares runs of random rows at each order with the sums of their cells. */
static void check_runs(const struct alpha_source *source, const struct alpha_cells *cells, struct random *random)
{
    for (int i = 0; i < 300; i++) {
        const unsigned order = (unsigned)(random_next(random) % cells->order_count);
        const int64_t row = (int64_t)(random_next(random) % (uint64_t)cells->orders[order].height);
        const int64_t first = (int64_t)(random_next(random) % 600) - 300;
        const int64_t last = first + (int64_t)(random_next(random) % 300);
        const unsigned seen = alpha_cells_wrapped_run(cells, order, row, first, last);
        unsigned expected = 0;
        for (int64_t x = first; x <= last; x++)
            for (int64_t y = row << order; y < (row + 1) << order && y < cells->axes[1].cells; y++)
                expected |= set_of(source, cells, x, y);
        if (order == 0)
            assert_int_equal(seen, expected);
        else if (seen == ALPHA_PASSES || seen == ALPHA_FAILS)
            assert_int_equal(seen, expected); /* blocks may say that they are mixed, but not more than cells do */
    }
}

static void test_runs(void **state)
{
    (void)state;
    struct random random = {1};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    for (int i = 0; i < 200; i++) {
        const uint32_t width = i < 10 ? 1 : (uint32_t)(random_next(&random) % SIDE_MAX) + 1;
        const uint32_t height = i % 10 ? (uint32_t)(random_next(&random) % SIDE_MAX) + 1 : 1;
        const struct alpha_source source = make_source(&random, width, height);
        struct alpha_cells cells;
        assert_int_equal(alpha_cells_init(&source, &context, &cells, NULL), BVHD_OK);
        check_runs(&source, &cells, &random);
        const struct alpha_order *top = &cells.orders[cells.order_count - 1];
        assert_true(top->width == 1 && top->height == 1);
        alpha_cells_finish(&cells, &memory);
    }
    assert_int_equal(memory.live, 0);
}

static void test_threads(void **state)
{
    (void)state;
    struct random random = {5};
    struct memory memory;
    struct workers *workers;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(workers_create(4, &workers, NULL), BVHD_OK);
    const struct build_context alone = {.memory = &memory, .parallel = &parallel_serial};
    const struct build_context together = {.memory = &memory, .parallel = workers_parallel(workers)};
    const struct alpha_source source = make_source(&random, SIDE_MAX, SIDE_MAX);
    struct alpha_cells a, b;
    assert_int_equal(alpha_cells_init(&source, &alone, &a, NULL), BVHD_OK);
    assert_int_equal(alpha_cells_init(&source, &together, &b, NULL), BVHD_OK);
    for (unsigned order = 0; order < a.order_count; order++)
        assert_memory_equal(a.orders[order].rows, b.orders[order].rows,
                            (size_t)(a.orders[order].width * a.orders[order].height));
    alpha_cells_finish(&a, &memory);
    alpha_cells_finish(&b, &memory);
    workers_destroy(workers);
}

/* Thresholds are those of a shader, which compares floats. */
static void test_thresholds(void **state)
{
    (void)state;
    static const float cutoffs[] = {-1, 0, 0x1p-30f, 0.25f, 0.5f, 128 / 255.0f, 254 / 255.0f, 1, 1.001f, INFINITY};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    for (int i = 0; i < 256; i++)
        texels[i] = (unsigned char)i;
    for (size_t i = 0; i < sizeof cutoffs / sizeof cutoffs[0]; i++) {
        const struct alpha_source source = {.texels = {texels, 256},
                                            .row_stride = 256,
                                            .width = 256,
                                            .height = 1,
                                            .is_nearest = true,
                                            .cutoff = cutoffs[i]};
        struct alpha_cells cells;
        assert_int_equal(alpha_cells_init(&source, &context, &cells, NULL), BVHD_OK);
        for (int texel = 0; texel < 256; texel++) {
            const bool passes = (float)texel / 255.0f >= cutoffs[i];
            assert_int_equal(alpha_cells_run(&cells.orders[0], 0, texel, texel), passes ? ALPHA_PASSES : ALPHA_FAILS);
            assert_int_equal(alpha_cells_pass(&cells, texel + 0.5, 0.5), passes);
        }
        alpha_cells_finish(&cells, &memory);
    }
}

/* Filtered alpha between two texels, 100 and 200, with the cutoff at 150. */
static void test_pass(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const unsigned char two[] = {100, 200};
    const struct alpha_source source = {.texels = {two, 2},
                                        .row_stride = 2,
                                        .width = 2,
                                        .height = 1,
                                        .wrap_u = BAKE_CLAMP_TO_EDGE,
                                        .wrap_v = BAKE_CLAMP_TO_EDGE,
                                        .cutoff = 150 / 255.0f};
    struct alpha_cells cells;
    assert_int_equal(alpha_cells_init(&source, &context, &cells, NULL), BVHD_OK);
    const double shift = cells.axes[0].shift; /* the middle lies at one texel */
    assert_false(alpha_cells_pass(&cells, 0.99 + shift, 0.5));
    assert_true(alpha_cells_pass(&cells, 1.01 + shift, 0.5));
    assert_false(alpha_cells_pass(&cells, -7 + shift, -3));
    assert_true(alpha_cells_pass(&cells, 9 + shift, 12));
    alpha_cells_finish(&cells, &memory);
}

static void test_refusals(void **state)
{
    (void)state;
    struct random random = {9};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    atomic_bool cancel = true;
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const struct alpha_source good = make_source(&random, 10, 10);
    struct alpha_source bad[9];
    struct alpha_cells cells;
    struct bvhd_error error;
    for (int i = 0; i < 9; i++)
        bad[i] = good;
    bad[0].width = 0;
    bad[1].height = 0;
    bad[2].texels.size = 99;
    bad[3].texels.data = NULL;
    bad[4].row_stride = 9;
    bad[5].row_stride = UINT64_MAX / 4;
    bad[6].wrap_u = (enum bake_wrap)3;
    bad[7].mode = (enum bake_mode)2;
    bad[8].mode = BAKE_MASK;
    bad[8].cutoff = NAN;
    for (int i = 0; i < 9; i++)
        assert_int_equal(alpha_cells_init(&bad[i], &context, &cells, &error), BVHD_INVALID);
    bad[0].width = ALPHA_SIZE_MAX + 1;
    assert_int_equal(alpha_cells_init(&bad[0], &context, &cells, &error), BVHD_TOO_LARGE);
    memory.fail_after = 0;
    assert_int_equal(alpha_cells_init(&good, &context, &cells, &error), BVHD_NO_MEMORY);
    memory.fail_after = -1;
    context.cancel = &cancel;
    assert_int_equal(alpha_cells_init(&good, &context, &cells, &error), BVHD_CANCELLED);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_runs), cmocka_unit_test(test_threads),  cmocka_unit_test(test_thresholds),
        cmocka_unit_test(test_pass), cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

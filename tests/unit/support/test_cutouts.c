/* SPDX-License-Identifier: Apache-2.0 */
/* test_cutouts.c - tests that generated cut-outs have the shapes and outlines that they are said to have. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/scene/cutouts.h"

enum { SIDE = 256 };

static unsigned char alpha[SIDE * SIDE], other[SIDE * SIDE];

/* Returns the share of the picture that lies inside, and sets that of texels that are neither in nor out. */
static double share(const unsigned char *texels, uint32_t size, double *ret_outline)
{
    double sum = 0, outline = 0;
    for (uint32_t i = 0; i < size * size; i++) {
        sum += texels[i] / 255.0;
        outline += texels[i] > 0 && texels[i] < 255;
    }
    *ret_outline = outline / size / size;
    return sum / size / size;
}

static void test_leaf(void **state)
{
    (void)state;
    double outline;
    cutout_draw(CUTOUT_LEAF, SIDE, alpha);
    const double covered = share(alpha, SIDE, &outline);
    assert_true(covered > 0.2 && covered < 0.4);
    assert_true(outline > 0.002 && outline < 0.02);
    assert_int_equal(alpha[SIDE / 2 * SIDE + SIDE / 2], 255);
    for (int i = 0; i < SIDE; i++) { /* nothing reaches the edges, so that cards do not show them */
        assert_int_equal(alpha[i], 0);
        assert_int_equal(alpha[i * SIDE], 0);
        assert_int_equal(alpha[i * SIDE + SIDE - 1], 0);
    }
}

/* The fence is the same after a shift by half a picture in both directions, and its wires go on beyond its edges. */
static void test_fence(void **state)
{
    (void)state;
    double outline;
    cutout_draw(CUTOUT_FENCE, SIDE, alpha);
    const double covered = share(alpha, SIDE, &outline);
    assert_true(covered > 0.08 && covered < 0.12);
    assert_true(outline < 0.05);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            assert_int_equal(alpha[y * SIDE + x], alpha[(y + SIDE / 2) % SIDE * SIDE + (x + SIDE / 2) % SIDE]);
}

/* Pictures are alike at all sizes, and atlases consist of them. */
static void test_sizes(void **state)
{
    (void)state;
    for (int cutout = 0; cutout < CUTOUTS; cutout++) {
        double outline;
        cutout_draw((enum cutout)cutout, SIDE, alpha);
        const double covered = share(alpha, SIDE, &outline);
        for (uint32_t size = 32; size < SIDE; size *= 2) {
            cutout_draw((enum cutout)cutout, size, other);
            assert_true(fabs(share(other, size, &outline) - covered) < 0.01);
            cutout_draw_atlas((enum cutout)cutout, SIDE, SIDE / size, alpha);
            assert_true(fabs(share(alpha, SIDE, &outline) - covered) < 0.01);
            for (uint32_t y = 0; y < size; y++)
                assert_memory_equal(alpha + y * SIDE, other + y * size, size);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_leaf),
        cmocka_unit_test(test_fence),
        cmocka_unit_test(test_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

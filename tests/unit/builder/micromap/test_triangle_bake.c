/* SPDX-License-Identifier: Apache-2.0 */
/* test_triangle_bake.c - tests the states of whole triangles against the micro-triangles one by one. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/triangle_bake.h"
#include "tests/support/random.h"
#include "tests/support/scene/cutouts.h"

enum { SIDE = 64, LEVEL_MAX = 5 };

static unsigned char texels[SIDE * SIDE];
static struct memory memory;
static struct alpha_cells cells;
static const float extra[2] = {0, 0};

static void make_triangle(struct random *random, struct texture_triangle *triangle)
{
    float corners[3][2];
    const double size = random_between(random, 0.05, 1);
    for (int axis = 0; axis < 6; axis++)
        corners[axis / 2][axis % 2] = (float)random_between(random, 0.5 - size, 0.5 + size);
    texture_triangle_init(&cells, (const float(*)[2])corners, extra, MICRO_LEVEL_MAX, triangle);
}

/* The state of one micro-triangle by the functions below this module. */
static enum micro_state single(const struct texture_triangle *triangle, enum micro_format format, unsigned level,
                               uint32_t index)
{
    uint32_t corners[3][2];
    const bool is_upright = micro_triangle_corners(index, level, corners);
    uint32_t i = UINT32_MAX, j = UINT32_MAX;
    for (int corner = 0; corner < 3; corner++) {
        i = corners[corner][0] < i ? corners[corner][0] : i;
        j = corners[corner][1] < j ? corners[corner][1] : j;
    }
    const struct micro_grid *grid = &triangle->grids[level];
    const uint32_t turned = is_upright ? 0 : 1;
    double anchor[2], middle[2];
    texture_triangle_anchor(triangle, level, i + turned, j + turned, anchor);
    for (int axis = 0; axis < 2; axis++)
        middle[axis] = anchor[axis] + (is_upright ? 1 : -1) * (grid->step_u[axis] + grid->step_v[axis]) / 3;
    const bool passes = alpha_cells_pass(&cells, middle[0], middle[1]);
    if (format == MICRO_2_STATE)
        return passes ? MICRO_OPAQUE : MICRO_TRANSPARENT;
    unsigned seen = micro_scan(&cells, triangle, level, is_upright, anchor, grid->order_last);
    if (seen != ALPHA_PASSES && seen != ALPHA_FAILS && grid->may_bound)
        seen = micro_scan_bounds(&cells, triangle, level, is_upright, anchor);
    return seen == ALPHA_PASSES  ? MICRO_OPAQUE
           : seen == ALPHA_FAILS ? MICRO_TRANSPARENT
           : passes              ? MICRO_UNKNOWN_OPAQUE
                                 : MICRO_UNKNOWN_TRANSPARENT;
}

static void test_states(void **state)
{
    (void)state;
    struct random random = {1};
    const struct triangle_baker baker = {.cells = &cells};
    unsigned char states[4096];
    for (int round = 0; round < 60; round++) {
        struct texture_triangle triangle;
        make_triangle(&random, &triangle);
        for (unsigned level = 0; level <= LEVEL_MAX; level++)
            for (int format = MICRO_2_STATE; format <= MICRO_4_STATE; format++) {
                uint32_t counts[MICRO_STATES] = {0}, expected_counts[MICRO_STATES] = {0};
                memset(states, 0x5a, sizeof states);
                assert_true(triangle_bake_states(&baker, &triangle, (enum micro_format)format, level, states, counts));
                for (uint32_t i = 0; i < micro_triangle_count(level); i++) {
                    const enum micro_state expected = single(&triangle, (enum micro_format)format, level, i);
                    const enum micro_state found = micro_triangle_state(states, (enum micro_format)format, i);
                    assert_int_equal(found, expected);
                    expected_counts[expected]++;
                }
                assert_memory_equal(counts, expected_counts, sizeof counts);
                const uint32_t bytes = micro_triangle_bytes((enum micro_format)format, level);
                assert_int_equal(states[bytes], 0x5a);
                if (level == 0)
                    assert_true(states[0] < 4);
            }
    }
}

/* What exploring says is decided is what states are, and it ends early only where nothing would be worth it. */
static void test_explore(void **state)
{
    (void)state;
    struct random random = {2};
    const struct triangle_baker baker = {.cells = &cells};
    unsigned char states[4096];
    for (int round = 0; round < 60; round++) {
        struct texture_triangle triangle;
        uint32_t decided[MICRO_LEVEL_MAX + 1], early[MICRO_LEVEL_MAX + 1];
        make_triangle(&random, &triangle);
        assert_true(triangle_bake_explore(&baker, &triangle, MICRO_4_STATE, LEVEL_MAX, 0, decided));
        for (unsigned level = 1; level <= LEVEL_MAX; level++) {
            uint32_t counts[MICRO_STATES] = {0};
            assert_true(triangle_bake_states(&baker, &triangle, MICRO_4_STATE, level, states, counts));
            const uint32_t certain = counts[MICRO_TRANSPARENT] + counts[MICRO_OPAQUE];
            assert_true(decided[level] >= decided[level - 1]);
            assert_int_equal(decided[level], certain * micro_triangle_count(MICRO_LEVEL_MAX - level));
        }
        assert_int_equal(decided[MICRO_LEVEL_MAX], decided[LEVEL_MAX]);
        const double worth = 1e-3 * MICRO_COUNT_MAX;
        assert_true(triangle_bake_explore(&baker, &triangle, MICRO_4_STATE, LEVEL_MAX, worth, early));
        for (unsigned level = 1; level <= LEVEL_MAX; level++) {
            if (early[level] == decided[level])
                continue;
            const double bytes = micro_triangle_bytes(MICRO_4_STATE, level) -
                                 (level > 1 ? micro_triangle_bytes(MICRO_4_STATE, level - 1) : 0);
            assert_true(MICRO_COUNT_MAX - decided[level - 1] < worth * bytes);
            break;
        }
    }
}

static void test_everywhere(void **state)
{
    (void)state;
    const struct triangle_baker baker = {.cells = &cells};
    const float corners[3][2] = {{0, 0}, {NAN, 0}, {0, 1}};
    unsigned char states[64];
    uint32_t counts[MICRO_STATES] = {0}, decided[MICRO_LEVEL_MAX + 1];
    struct texture_triangle triangle;
    texture_triangle_init(&cells, corners, extra, 4, &triangle);
    assert_int_equal(triangle_bake_whole(&baker, &triangle), ALPHA_MIXED);
    assert_true(triangle_bake_states(&baker, &triangle, MICRO_4_STATE, 4, states, counts));
    assert_int_equal(counts[MICRO_UNKNOWN_OPAQUE], 256);
    assert_int_equal(states[63], 0xff);
    assert_true(triangle_bake_states(&baker, &triangle, MICRO_2_STATE, 0, states, counts));
    assert_int_equal(counts[MICRO_OPAQUE], 1);
    assert_int_equal(states[0], 1);
    assert_true(triangle_bake_explore(&baker, &triangle, MICRO_4_STATE, 4, 0, decided));
    assert_int_equal(decided[4], 0);
}

static void test_cancel(void **state)
{
    (void)state;
    const float card[3][2] = {{0, 0}, {1, 0}, {0, 1}};
    atomic_bool cancel = true;
    const struct triangle_baker baker = {.cells = &cells, .cancel = &cancel};
    static unsigned char states[1 << 20];
    uint32_t counts[MICRO_STATES] = {0}, decided[MICRO_LEVEL_MAX + 1];
    struct texture_triangle triangle;
    texture_triangle_init(&cells, card, extra, 10, &triangle);
    assert_false(triangle_bake_states(&baker, &triangle, MICRO_4_STATE, 10, states, counts));
    assert_true(counts[0] + counts[1] + counts[2] + counts[3] < micro_triangle_count(10));
    assert_false(triangle_bake_explore(&baker, &triangle, MICRO_4_STATE, 10, 0, decided));
}

int main(void)
{
    const struct alpha_source source = {
        .texels = {texels, sizeof texels}, .row_stride = SIDE, .width = SIDE, .height = SIDE, .cutoff = 0.5f};
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    memory_init(&memory, UINT64_MAX);
    cutout_draw(CUTOUT_LEAF, SIDE, texels);
    if (alpha_cells_init(&source, &context, &cells, NULL) != BVHD_OK)
        return 1;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_states),
        cmocka_unit_test(test_explore),
        cmocka_unit_test(test_everywhere),
        cmocka_unit_test(test_cancel),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    alpha_cells_finish(&cells, &memory);
    return failed;
}

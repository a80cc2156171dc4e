/* SPDX-License-Identifier: Apache-2.0 */
/* test_texture_axis.c - tests wrap modes against the definition of each, texel by texel. */
#include "tests/support/unit.h"

#include "builder/micromap/texture_axis.h"

static const enum bake_wrap wraps[] = {BAKE_REPEAT, BAKE_MIRRORED_REPEAT, BAKE_CLAMP_TO_EDGE};

/* The texel by Vulkan's definition of the modes. */
static int64_t texel_of(enum bake_wrap wrap, int64_t at, int64_t texels)
{
    if (wrap == BAKE_CLAMP_TO_EDGE)
        return at < 0 ? 0 : at >= texels ? texels - 1 : at;
    const int64_t period = wrap == BAKE_REPEAT ? texels : 2 * texels, within = (at % period + period) % period;
    return within < texels ? within : period - 1 - within;
}

/* The pair of texels that a cell reads, as a set: the first one's number, and the second one's. */
static void pair_of(const struct texture_axis *axis, int64_t cell, int64_t ret_pair[2])
{
    const int64_t first = texel_of(axis->wrap, cell + axis->first_texel, axis->texels);
    const int64_t second = axis->is_bilinear ? texel_of(axis->wrap, cell + axis->first_texel + 1, axis->texels) : first;
    ret_pair[0] = first < second ? first : second;
    ret_pair[1] = first < second ? second : first;
}

static void test_texels(void **state)
{
    (void)state;
    for (int wrap = 0; wrap < 3; wrap++)
        for (int64_t texels = 1; texels <= 7; texels++) {
            const struct texture_axis axis = texture_axis_make(texels, wraps[wrap], false);
            for (int64_t at = -40; at <= 40; at++)
                assert_int_equal(texture_axis_texel(&axis, at), texel_of(wraps[wrap], at, texels));
        }
}

/* Each cell of a piece reads the same texels as the cell of the texture that the piece says, and pieces are longest. */
static void check_pieces(const struct texture_axis *axis)
{
    for (int64_t at = -40; at <= 40; at++) {
        const struct texture_piece piece = texture_axis_piece(axis, at);
        assert_true(piece.count >= 1 && piece.cell >= 0 && piece.cell < axis->cells);
        for (int64_t i = 0; i < piece.count && i < 50; i++) {
            int64_t found[2], expected[2];
            const int64_t cell = piece.cell + piece.direction * i;
            assert_true(cell >= 0 && cell < axis->cells);
            pair_of(axis, cell, found);
            pair_of(axis, at + i, expected);
            assert_memory_equal(found, expected, sizeof found);
        }
    }
}

/* Blocks follow each other without gaps, and each has cells of one block only. */
static void check_blocks(const struct texture_axis *axis, unsigned order)
{
    int64_t at = -40, next;
    while (at < 40) {
        const int64_t block = texture_axis_block(axis, order, at, &next);
        assert_true(next > at);
        for (int64_t cell = at; cell < next && cell < at + 50; cell++)
            assert_int_equal(texture_axis_piece(axis, cell).cell >> order, block);
        at = next;
    }
}

static void test_pieces(void **state)
{
    (void)state;
    for (int choice = 0; choice < 6; choice++)
        for (int64_t texels = 1; texels <= 9; texels++) {
            const struct texture_axis axis = texture_axis_make(texels, wraps[choice / 2], choice % 2);
            check_pieces(&axis);
            for (unsigned order = 0; order < 5; order++)
                check_blocks(&axis, order);
        }
}

/* Coordinate 0 is the left edge of texel 0, and with bilinear filtering half a texel before the middle of it. */
static void test_shift(void **state)
{
    (void)state;
    assert_true(texture_axis_make(4, BAKE_REPEAT, false).shift == 0);
    for (int wrap = 0; wrap < 3; wrap++) {
        const struct texture_axis axis = texture_axis_make(4, wraps[wrap], true);
        /* The middle of texel 2, at 2.5 texels, is the corner between cells that read texels 1, 2 and 2, 3. */
        const double middle = 2.5 + axis.shift;
        assert_true(middle == (double)(int64_t)middle);
        assert_int_equal((int64_t)middle + axis.first_texel, 2);
    }
    assert_int_equal(texture_axis_floor(-0.5), -1);
    assert_int_equal(texture_axis_floor(-1), -1);
    assert_int_equal(texture_axis_floor(2.75), 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_texels),
        cmocka_unit_test(test_pieces),
        cmocka_unit_test(test_shift),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

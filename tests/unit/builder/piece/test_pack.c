/* SPDX-License-Identifier: Apache-2.0 */
/* test_pack.c - tests that kept boxes are packed in their order, by both implementations. */
#include "tests/support/unit.h"

#include <stdbool.h>
#include <string.h>

#include "builder/piece/pack.h"

enum { MOST = 600, ROOM = MOST + 2 * NEAREST_PAD };

/* A sequence of boxes whose coordinates say where they come from. */
struct row {
    float floats[6][ROOM];
    uint32_t nodes[ROOM];
    struct nearest_boxes boxes;
};

static void row_init(struct row *row, float first)
{
    for (uint32_t k = 0; k < 6; k++) {
        float **place = k < 3 ? &row->boxes.min[k] : &row->boxes.max[k - 3];
        *place = row->floats[k] + NEAREST_PAD;
        for (uint32_t i = 0; i < ROOM; i++)
            row->floats[k][i] = first < 0 ? first : first + (float)(k * ROOM + i);
    }
    for (uint32_t i = 0; i < ROOM; i++)
        row->nodes[i] = first < 0 ? UINT32_MAX : 7 * i;
}

static void check(const struct row *from, const uint8_t *kept, uint32_t count, const struct row *to)
{
    uint32_t next = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (!kept[i])
            continue;
        for (int axis = 0; axis < 3; axis++) {
            assert_true(to->boxes.min[axis][next] == from->boxes.min[axis][i]);
            assert_true(to->boxes.max[axis][next] == from->boxes.max[axis][i]);
        }
        assert_int_equal(to->nodes[next++], from->nodes[i]);
    }
    for (int axis = 0; axis < 3; axis++)
        for (int i = 1; i <= NEAREST_PAD; i++) {
            assert_true(to->boxes.min[axis][-i] == -1 && to->boxes.max[axis][-i] == -1);
            assert_true(to->boxes.min[axis][next + PACK_PAD - 1 + (uint32_t)i] == -1 ||
                        next + PACK_PAD + (uint32_t)i > MOST);
        }
}

static void check_packer(pack_packer packer)
{
    static struct row from, to;
    uint8_t kept[MOST + PACK_PAD];
    uint32_t seed = 1;
    for (uint32_t count = 0; count <= MOST; count += 1 + count / 9)
        for (uint32_t share = 0; share <= 8; share++) {
            row_init(&from, 1);
            row_init(&to, -1);
            memset(kept, 0, sizeof kept);
            for (uint32_t i = 0; i < count; i++) {
                seed = seed * 1664525 + 1013904223;
                kept[i] = seed >> 29 < share;
            }
            packer(&from.boxes, from.nodes, kept, count, &to.boxes, to.nodes);
            check(&from, kept, count, &to);
        }
}

static void what_is_kept_comes_in_its_order(void **state)
{
    (void)state;
    check_packer(pack_row_plain);
    check_packer(pack_row);
}

/* The fast implementation is used on processors that have the instructions, and have them fast. */
static void vectors_do_the_same(void **state)
{
    (void)state;
    bool able = false;
#if defined(__x86_64__)
    able = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("popcnt") &&
           !__builtin_cpu_is("znver1") && !__builtin_cpu_is("znver2");
#endif
    assert_int_equal(pack_row_avx2() != NULL, able);
    if (!able)
        skip();
    check_packer(pack_row_avx2());
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_is_kept_comes_in_its_order),
                                       cmocka_unit_test(vectors_do_the_same)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <float.h>

#include "octants.h"
#include "random.h"

static double gain(const float offsets[3][8], unsigned child, unsigned slot)
{
    double sum = 0;
    for (unsigned axis = 0; axis < 3; axis++)
        sum += slot >> axis & 1 ? offsets[axis][child] : -offsets[axis][child];
    return sum;
}

/* The maximum over all assignments, by dynamic programming over sets of slots. */
static double best_total(const float offsets[3][8], unsigned count)
{
    double best[256], most = -DBL_MAX;
    best[0] = 0;
    for (unsigned set = 1; set < 256; set++) {
        unsigned child = (unsigned)__builtin_popcount(set) - 1;
        best[set] = -DBL_MAX;
        for (unsigned slot = 0; slot < 8 && child < count; slot++)
            if (set >> slot & 1 && best[set ^ 1u << slot] + gain(offsets, child, slot) > best[set])
                best[set] = best[set ^ 1u << slot] + gain(offsets, child, slot);
        if (child + 1 == count && best[set] > most)
            most = best[set];
    }
    return most;
}

static void check_distinct(const uint8_t slots[8], unsigned count)
{
    unsigned taken = 0;
    for (unsigned i = 0; i < count; i++) {
        assert_true(slots[i] < 8);
        assert_int_equal(taken >> slots[i] & 1, 0);
        taken |= 1u << slots[i];
    }
}

static void totals_are_near_the_best(void **state)
{
    (void)state;
    struct random random = {1};
    double total = 0, best = 0;
    for (int round = 0; round < 4000; round++) {
        unsigned count = 1 + (unsigned)(random_next(&random) % 8);
        float offsets[3][8];
        uint8_t slots[8];
        for (unsigned axis = 0; axis < 3; axis++)
            for (unsigned i = 0; i < 8; i++)
                offsets[axis][i] = (float)(random_between(&random, -1, 1) * (axis == 2 ? 0.2 : 1));
        octants_assign((const float(*)[8])offsets, count, slots);
        check_distinct(slots, count);
        for (unsigned i = 0; i < count; i++)
            total += gain((const float(*)[8])offsets, i, slots[i]);
        best += best_total((const float(*)[8])offsets, count);
    }
    assert_true(total <= best * (1 + 1e-9));
    assert_true(total >= best * 0.98);
}

static void corners_go_home(void **state)
{
    (void)state;
    for (unsigned turn = 0; turn < 8; turn++) {
        float offsets[3][8];
        uint8_t slots[8];
        for (unsigned i = 0; i < 8; i++)
            for (unsigned axis = 0; axis < 3; axis++)
                offsets[axis][i] = (i ^ turn) >> axis & 1 ? 1.5f : -2;
        octants_assign((const float(*)[8])offsets, 8, slots);
        for (unsigned i = 0; i < 8; i++)
            assert_int_equal(slots[i], i ^ turn);
    }
}

static void extremes_still_give_distinct_slots(void **state)
{
    (void)state;
    static const float values[] = {0, -0.0f, FLT_MAX / 8, -FLT_MAX / 8, 1e-45f, -1e-45f, 1, -1};
    struct random random = {2};
    for (int round = 0; round < 2000; round++) {
        float offsets[3][8];
        uint8_t slots[8];
        for (unsigned axis = 0; axis < 3; axis++)
            for (unsigned i = 0; i < 8; i++)
                offsets[axis][i] = round ? values[random_next(&random) % 8] : 0;
        octants_assign((const float(*)[8])offsets, 8, slots);
        check_distinct(slots, 8);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(totals_are_near_the_best),
        cmocka_unit_test(corners_go_home),
        cmocka_unit_test(extremes_still_give_distinct_slots),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

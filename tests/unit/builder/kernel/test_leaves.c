/* SPDX-License-Identifier: Apache-2.0 */
/* test_leaves.c - tests that leaves_cut() finds the cheapest cut of each range, and keeps to the limits of a leaf. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/kernel/leaves.h"
#include "tests/support/builder/test_refs.h"

#define CUT_COST 1.7f

static double area_of(const struct primitive_ref *refs, uint32_t count)
{
    struct box box = primitive_ref_box(&refs[0]);
    for (uint32_t i = 1; i < count; i++) {
        struct box other = primitive_ref_box(&refs[i]);
        box_grow(&box, &other);
    }
    return box_half_area(&box);
}

static double cut_between(const struct primitive_ref *refs)
{
    double smaller = 2 * fmin(area_of(refs, 1), area_of(refs + 1, 1));
    return CUT_COST * fmin(smaller, area_of(refs, 2));
}

/*
 * Returns the cost, as leaves.h defines it, of a sequence cut into leaves of these lengths; infinite if one is too
 * large.
 */
static double cost_of(const struct primitive_ref *refs, const uint8_t *lengths, uint32_t leaves, uint32_t leaf_max)
{
    double cost = 0;
    for (uint32_t leaf = 0; leaf < leaves; refs += lengths[leaf++]) {
        uint32_t primitives = 0;
        for (uint32_t i = 0; i < lengths[leaf]; i++)
            primitives += 1 + refs[i].link;
        if (lengths[leaf] > 1 && primitives > leaf_max)
            return INFINITY;
        cost += area_of(refs, lengths[leaf]) * primitives;
        cost += leaf ? cut_between(refs - 1) : 0;
    }
    return cost;
}

/*
 * Returns the least cost over all ways to cut `count` refs: the base-3 digits of a number, as far as they make up the
 * sequence, are the lengths.
 */
static double least_cost(const struct primitive_ref *refs, uint32_t count, uint32_t leaf_max)
{
    double least = INFINITY;
    uint32_t ways = 1;
    for (uint32_t i = 0; i < count; i++)
        ways *= 3;
    for (uint32_t way = 0; way < ways; way++) {
        uint8_t lengths[16];
        uint32_t leaves = 0, sum = 0;
        for (uint32_t rest = way; sum < count; rest /= 3)
            sum += lengths[leaves++] = (uint8_t)(1 + rest % 3);
        if (sum == count)
            least = fmin(least, cost_of(refs, lengths, leaves, leaf_max));
    }
    return least;
}

/* Each range is cut by itself, so costs are compared range by range. */
static void no_other_cut_is_cheaper(void **state)
{
    (void)state;
    struct random random = {3};
    for (uint32_t round = 0; round < 300; round++) {
        uint32_t count = 1 + round % 28, leaf_max = 1 + round % 5, length = (count + LEAVES_RANGES - 1) / LEAVES_RANGES;
        uint8_t lengths[28], *next = lengths;
        struct primitive_ref *refs = test_refs_make(round % 2 ? REFS_CLUSTERS : REFS_CHAIN, count, round);
        for (uint32_t i = 0; i < count; i++) {
            for (int axis = 0; axis < 3; axis++)
                refs[i].max[axis] += (float)random_between(&random, 0.5, 2);
            refs[i].link = round % 3 ? 0 : random_next(&random) % 3;
        }
        uint32_t leaves = leaves_cut(refs, count, &(struct leaves_options){leaf_max, CUT_COST}, lengths);
        for (uint32_t first = 0; first < count; first += length) {
            uint32_t here = count - first < length ? count - first : length, own = 0;
            for (uint32_t refs_seen = 0; refs_seen < here; own++)
                refs_seen += next[own];
            double cost = cost_of(refs + first, next, own, leaf_max), least = least_cost(refs + first, here, leaf_max);
            assert_true(cost <= least * 1.00001);
            next += own;
        }
        assert_int_equal(next - lengths, leaves);
        free(refs);
    }
}

static void check_cut(const struct primitive_ref *refs, uint32_t count, uint32_t leaf_max)
{
    uint8_t *lengths = malloc(count);
    assert_non_null(lengths);
    uint32_t leaves = leaves_cut(refs, count, &(struct leaves_options){leaf_max, CUT_COST}, lengths), sum = 0;
    for (uint32_t i = 0; i < leaves; i++) {
        uint32_t primitives = 0;
        assert_in_range(lengths[i], 1, LEAVES_REFS_MAX);
        for (uint32_t k = 0; k < lengths[i]; k++)
            primitives += 1 + refs[sum + k].link;
        assert_true(lengths[i] == 1 || primitives <= leaf_max);
        sum += lengths[i];
    }
    assert_int_equal(sum, count);
    free(lengths);
}

/* For any boxes each ref is in one leaf, and no leaf is too large. */
static void every_row_is_covered(void **state)
{
    (void)state;
    static const float values[] = {FLT_MAX, -FLT_MAX, 0, 1, 1e-45f, 0x1p60f};
    static const uint32_t most[] = {1, 2, 3, 31, UINT32_MAX};
    struct random random = {9};
    for (uint32_t round = 0; round < 400; round++) {
        uint32_t count = 1 + round % 50;
        struct primitive_ref *refs = test_refs_make((enum test_refs_kind)(round % REFS_KINDS), count, round);
        for (uint32_t i = 0; i < count; i++) {
            refs[i].link = round % 3 ? random_next(&random) % 3 : 0;
            if (round % 2)
                refs[i].max[random_next(&random) % 3] = values[random_next(&random) % 6];
        }
        check_cut(refs, count, most[round % 5]);
        free(refs);
    }
}

/* Two equal boxes share a leaf; boxes that lie far apart do not. */
static void neighbours_share_a_leaf(void **state)
{
    (void)state;
    enum { COUNT = 96 };
    uint8_t lengths[COUNT];
    struct primitive_ref *refs = test_refs_make(REFS_SAME, COUNT, 0);
    for (uint32_t i = 0; i < COUNT; i++) {
        refs[i].min[0] += 10 * (float)(i / 2);
        refs[i].max[0] += 10 * (float)(i / 2);
    }
    assert_int_equal(leaves_cut(refs, COUNT, &(struct leaves_options){3, CUT_COST}, lengths), COUNT / 2);
    for (uint32_t i = 0; i < COUNT / 2; i++)
        assert_int_equal(lengths[i], 2);
    assert_int_equal(leaves_cut(refs, COUNT, &(struct leaves_options){1, CUT_COST}, lengths), COUNT);
    for (uint32_t i = 0; i < COUNT; i++) {
        refs[i].min[0] += 10 * (float)i;
        refs[i].max[0] += 10 * (float)i;
    }
    assert_int_equal(leaves_cut(refs, COUNT, &(struct leaves_options){3, CUT_COST}, lengths), COUNT);
    free(refs);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_other_cut_is_cheaper),
        cmocka_unit_test(every_row_is_covered),
        cmocka_unit_test(neighbours_share_a_leaf),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

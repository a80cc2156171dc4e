/* SPDX-License-Identifier: Apache-2.0 */
/* test_full_sweep.c - tests that the pairs of a full sweep form one tree, and that no other cut is cheaper. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/piece/full_sweep.h"
#include "tests/support/builder/test_refs.h"

static double half_area(const struct box *box)
{
    double side[3];
    for (int axis = 0; axis < 3; axis++)
        side[axis] = (double)box->max[axis] - box->min[axis];
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
}

static struct box box_of(const struct primitive_ref *refs, uint32_t count, uint64_t set)
{
    struct box box = box_empty();
    for (uint32_t i = 0; i < count; i++)
        if (set >> i & 1) {
            struct box own = primitive_ref_box(&refs[i]);
            box_grow(&box, &own);
        }
    return box;
}

static double cost_of(const struct primitive_ref *refs, uint32_t count, uint64_t left, uint64_t right)
{
    struct box a = box_of(refs, count, left), b = box_of(refs, count, right);
    return half_area(&a) * __builtin_popcountll(left) + half_area(&b) * __builtin_popcountll(right);
}

/* Returns the least cost of all cuts across an axis between different centroids. */
static double best_cost(const struct primitive_ref *refs, uint32_t count, uint64_t set)
{
    double best = INFINITY;
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t i = 0; i < count; i++) {
            uint64_t left = 0;
            for (uint32_t k = 0; k < count; k++)
                if (set >> k & 1 && refs[k].min[axis] + refs[k].max[axis] < refs[i].min[axis] + refs[i].max[axis])
                    left |= UINT64_C(1) << k;
            if (left && set >> i & 1)
                best = fmin(best, cost_of(refs, count, left, set & ~left));
        }
    return best;
}

/*
 * Checks that every pair joins two existing subtrees that no other pair has, and that the last one holds all. ret_sets:
 * the refs below each number.
 */
static void check_pairs(const struct full_sweep_pair *pairs, uint32_t count, uint64_t ret_sets[2 * FULL_SWEEP_MOST])
{
    bool is_taken[2 * FULL_SWEEP_MOST] = {false};
    for (uint32_t i = 0; i < count; i++)
        ret_sets[i] = UINT64_C(1) << i;
    for (uint32_t i = 0; i + 1 < count; i++) {
        uint32_t left = pairs[i].left, right = pairs[i].right, own = count + i;
        assert_true(left < own && right < own && left != right);
        assert_false(is_taken[left] || is_taken[right]);
        is_taken[left] = is_taken[right] = true;
        ret_sets[own] = ret_sets[left] | ret_sets[right];
    }
    assert_int_equal(ret_sets[2 * count - 2], (UINT64_C(1) << count) - 1);
}

static void pairs_make_one_tree_of_all(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count <= FULL_SWEEP_MOST; count++) {
            struct full_sweep_pair pairs[FULL_SWEEP_MOST];
            uint64_t sets[2 * FULL_SWEEP_MOST];
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count + 100);
            full_sweep(refs, count, pairs);
            check_pairs(pairs, count, sets);
            free(refs);
        }
}

/* Three boxes are joined in the best way; larger sets are cut where it is cheapest, up to rounding. */
static void no_cut_is_cheaper(void **state)
{
    (void)state;
    static const enum test_refs_kind kinds[] = {REFS_CLOUD, REFS_CLUSTERS, REFS_FLAT};
    for (uint32_t trial = 0; trial < 60; trial++) {
        const uint32_t count = 3 + trial % (FULL_SWEEP_MOST - 2);
        struct full_sweep_pair pairs[FULL_SWEEP_MOST];
        uint64_t sets[2 * FULL_SWEEP_MOST];
        struct primitive_ref *refs = test_refs_make(kinds[trial % 3], count, trial);
        full_sweep(refs, count, pairs);
        check_pairs(pairs, count, sets);
        for (uint32_t i = 0; i + 1 < count; i++) {
            uint64_t set = sets[count + i];
            double own = cost_of(refs, count, sets[pairs[i].left], sets[pairs[i].right]);
            if (__builtin_popcountll(set) > 2)
                assert_true(own <= best_cost(refs, count, set) * (1 + 1e-5));
        }
        free(refs);
    }
}

/* The boxes lie close together and far from the origin, where floats are coarse. */
static void an_offset_does_not_hide_the_order(void **state)
{
    (void)state;
    enum { COUNT = 40 };
    struct primitive_ref refs[COUNT] = {0};
    struct full_sweep_pair pairs[FULL_SWEEP_MOST];
    uint64_t sets[2 * FULL_SWEEP_MOST];
    for (uint32_t i = 0; i < COUNT; i++) {
        uint32_t place = i * 7 % COUNT;
        for (int axis = 0; axis < 3; axis++)
            refs[i].min[axis] = refs[i].max[axis] = 1048576;
        refs[i].min[0] += (float)place / 4;
        refs[i].max[0] = refs[i].min[0] + 0.125f;
        refs[i].max[1] += 1;
    }
    full_sweep(refs, COUNT, pairs);
    check_pairs(pairs, COUNT, sets);
    struct box left = box_of(refs, COUNT, sets[pairs[COUNT - 2].left]),
               right = box_of(refs, COUNT, sets[pairs[COUNT - 2].right]);
    assert_true(left.max[0] < right.min[0] || right.max[0] < left.min[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pairs_make_one_tree_of_all),
        cmocka_unit_test(no_cut_is_cheaper),
        cmocka_unit_test(an_offset_does_not_hide_the_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

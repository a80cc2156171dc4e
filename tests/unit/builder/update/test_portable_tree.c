/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_tree.c - tests what nodes cost, which decides on the decay of updates, against sums in double over
 * decoded boxes. test_refit.c has how trees are read and cut.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/update/portable_tree.h"
#include "tests/support/random.h"

/* Makes a node of random boxes, on a random grid, and its shape. Some slots are empty, and some axes are flat. */
static struct portable_moving_node make_node(struct random *random, struct portable_shape *ret_shape)
{
    struct portable_moving_node node;
    memset(&node, 0, sizeof node);
    *ret_shape = (struct portable_shape){.inner = (unsigned)(random_next(random) % 256)};
    for (int axis = 0; axis < 3; axis++)
        node.start.exponent[axis] = random_next(random) % 8 ? (uint8_t)(120 + random_next(random) % 12) : 0;
    for (unsigned slot = 0; slot < 8; slot++) {
        const bool is_inner = ret_shape->inner >> slot & 1;
        ret_shape->counts[slot] = is_inner ? 0 : (uint8_t)(random_next(random) % 4);
        ret_shape->occupied |= (unsigned)(is_inner || ret_shape->counts[slot] > 0) << slot;
        for (int axis = 0; axis < 3; axis++) {
            const uint8_t a = (uint8_t)(random_next(random) % 200), b = (uint8_t)(random_next(random) % 56),
                          c = (uint8_t)(random_next(random) % 200), d = (uint8_t)(random_next(random) % 56);
            const bool is_used = ret_shape->occupied >> slot & 1;
            node.start.lo[axis][slot] = is_used ? a : 255;
            node.start.hi[axis][slot] = is_used ? (uint8_t)(a + b) : 0;
            node.end_lo[axis][slot] = is_used ? c : 255;
            node.end_hi[axis][slot] = is_used ? (uint8_t)(c + d) : 0;
        }
    }
    return node;
}

/* Returns half the area of the box of the slots in `slots` at one key. */
static double area_of(const struct portable_moving_node *node, unsigned slots, int key)
{
    double sides[3];
    for (int axis = 0; axis < 3; axis++) {
        const uint8_t *lo = key ? node->end_lo[axis] : node->start.lo[axis],
                      *hi = key ? node->end_hi[axis] : node->start.hi[axis];
        double low = INFINITY, high = -INFINITY;
        for (unsigned slot = 0; slot < 8; slot++)
            if (slots >> slot & 1) {
                low = fmin(low, lo[slot]);
                high = fmax(high, hi[slot]);
            }
        const int exponent = node->start.exponent[axis];
        sides[axis] = exponent == 0 ? 0 : ldexp(high - low, exponent - 127);
    }
    return sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0];
}

static void costs_are_those_of_all_ends(void **state)
{
    struct random random = {31};
    (void)state;
    for (int round = 0; round < 2000; round++) {
        const double leaf_cost = random_between(&random, 0.1, 2);
        struct portable_shape shape;
        const struct portable_moving_node node = make_node(&random, &shape);
        double costs[2] = {0, 0};
        for (unsigned slot = 0; slot < 8; slot++)
            for (int key = 0; key < 2 && shape.occupied >> slot & 1; key++)
                costs[key] +=
                    area_of(&node, 1u << slot, key) * (shape.inner >> slot & 1 ? 1 : leaf_cost * shape.counts[slot]);
        const double still = portable_tree_node_cost(&node.start, false, &shape, leaf_cost),
                     moving = portable_tree_node_cost(&node.start, true, &shape, leaf_cost);
        assert_true(fabs(still - costs[0]) <= 1e-12 * costs[0]);
        assert_true(fabs(moving - costs[0] - costs[1]) <= 1e-12 * (costs[0] + costs[1]));
        if (shape.occupied == 0)
            continue;
        const double all = area_of(&node, shape.occupied, 0) + area_of(&node, shape.occupied, 1);
        assert_true(fabs(portable_tree_moving_area(&node) - all) <= 1e-12 * all);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(costs_are_those_of_all_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

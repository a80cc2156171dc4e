/* SPDX-License-Identifier: Apache-2.0 */
/* test_nearest.c - tests that the nearest neighbour is found, and that some pair always chooses each other. */
#include "tests/support/unit.h"

#include <math.h>
#include <stdbool.h>

#include "builder/piece/nearest.h"
#include "tests/support/random.h"

enum { MOST = 100, ROOM = MOST + 2 * NEAREST_PAD };

struct world {
    float floats[6][ROOM];
    struct nearest_boxes boxes;
    int32_t keys[MOST + 8];
};

/* Makes boxes on a grid of `step`; a coarse one gives many equal areas. */
static void fill(struct world *world, uint32_t count, double step, double size, uint64_t seed)
{
    struct random random = {seed};
    for (int axis = 0; axis < 3; axis++) {
        world->boxes.min[axis] = world->floats[2 * axis] + NEAREST_PAD;
        world->boxes.max[axis] = world->floats[2 * axis + 1] + NEAREST_PAD;
    }
    for (uint32_t i = 0; i < count; i++) {
        double centre[3];
        random_point(&random, centre);
        for (int axis = 0; axis < 3; axis++) {
            world->boxes.min[axis][i] = (float)(size * floor(centre[axis] / step) * step);
            world->boxes.max[axis][i] = (float)(size * (floor(centre[axis] / step) + 1) * step);
        }
    }
    nearest_pad(&world->boxes, count);
}

static double union_area(const struct nearest_boxes *boxes, uint32_t i, uint32_t k)
{
    double side[3];
    for (int axis = 0; axis < 3; axis++)
        side[axis] = fmax((double)boxes->max[axis][i], (double)boxes->max[axis][k]) -
                     fmin((double)boxes->min[axis][i], (double)boxes->min[axis][k]);
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
}

static void the_nearest_is_found(void **state)
{
    (void)state;
    static const double steps[] = {1.0 / 1024, 0.5, 4}, sizes[] = {1, 0x1p40, 0x1p-30};
    for (uint32_t count = 2; count <= MOST; count += count < 20 ? 1 : 13)
        for (uint32_t radius = 1; radius <= NEAREST_MAX; radius++)
            for (int kind = 0; kind < 9; kind++) {
                struct world world;
                fill(&world, count, steps[kind % 3], sizes[kind / 3] / 4, count);
                nearest_find(&world.boxes, count, radius, world.keys);
                for (uint32_t i = 0; i < count; i++) {
                    uint32_t found = nearest_partner(i, world.keys[i]);
                    double least = INFINITY;
                    for (uint32_t k = i < radius ? 0 : i - radius; k < count && k <= i + radius; k++)
                        least = k == i ? least : fmin(least, union_area(&world.boxes, i, k));
                    assert_true(found < count && found != i && (found > i ? found - i : i - found) <= radius);
                    assert_true(union_area(&world.boxes, i, found) <= least * (1 + 0x1p-17));
                }
            }
}

/* Otherwise clustering would never end. */
static void somebody_always_chooses_each_other(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed < 300; seed++) {
        struct world world;
        uint32_t count = 2 + (uint32_t)(seed % (MOST - 1)), pairs = 0;
        fill(&world, count, seed % 2 ? 4 : 0.25, seed % 3 ? 1 : 0, seed);
        nearest_find(&world.boxes, count, 1 + (uint32_t)(seed % NEAREST_MAX), world.keys);
        for (uint32_t i = 0; i < count; i++) {
            uint32_t partner = nearest_partner(i, world.keys[i]);
            bool mutual = nearest_partner(partner, world.keys[partner]) == i;
            assert_int_equal(mutual, world.keys[partner] == world.keys[i]);
            pairs += mutual;
        }
        assert_true(pairs >= 2);
    }
}

/* When all boxes are equal, every box except possibly the last has a partner. */
static void equals_pair_up(void **state)
{
    (void)state;
    struct world world;
    for (uint32_t count = 2; count < MOST; count++) {
        uint32_t alone = 0;
        fill(&world, count, 4, 1, 7);
        for (int axis = 0; axis < 3; axis++)
            for (uint32_t i = 0; i < count; i++) {
                world.boxes.min[axis][i] = 1;
                world.boxes.max[axis][i] = 2;
            }
        nearest_find(&world.boxes, count, 4, world.keys);
        for (uint32_t i = 0; i < count; i++)
            alone += world.keys[nearest_partner(i, world.keys[i])] != world.keys[i];
        assert_int_equal(alone, count % 2);
    }
}

static void both_ways_agree(void **state)
{
    (void)state;
    nearest_finder avx2 = nearest_find_avx2();
    if (!avx2)
        skip();
    for (uint64_t seed = 1; seed < 300; seed++) {
        struct world world;
        int32_t other[MOST + 8];
        uint32_t count = 2 + (uint32_t)(seed % (MOST - 1)), radius = 1 + (uint32_t)(seed % NEAREST_MAX);
        fill(&world, count, seed % 2 ? 1.0 / 512 : 1, seed % 5 ? 1 : 0x1p38, seed);
        avx2(&world.boxes, count, radius, world.keys);
        nearest_find_plain(&world.boxes, count, radius, other);
        assert_memory_equal(world.keys, other, count * sizeof *other);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_is_found),
        cmocka_unit_test(somebody_always_chooses_each_other),
        cmocka_unit_test(equals_pair_up),
        cmocka_unit_test(both_ways_agree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

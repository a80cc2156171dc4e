/* SPDX-License-Identifier: Apache-2.0 */
/* test_octants.c - tests that children get the slots of their octants, near the best sum, in all versions alike. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/wide/octants.h"
#include "tests/support/random.h"

/* Include the version without SSE2, which the library leaves out where it has SSE2. */
void octants_assign_scalar(const float offsets[8][4], unsigned rounds, uint8_t ret_children[8]);
#define BVHD_SCALAR
#define octants_assign octants_assign_scalar
#include "builder/wide/octants.c"
#undef octants_assign

static double worth(const float offsets[8][4], unsigned child, unsigned slot)
{
    double sum = 0;
    for (unsigned axis = 0; axis < 3; axis++)
        sum += slot >> axis & 1 ? offsets[child][axis] : -offsets[child][axis];
    return sum;
}

/* Returns the maximum over all assignments, by dynamic programming over sets of slots. */
static double best_total(const float offsets[8][4])
{
    double best[256];
    best[0] = 0;
    for (unsigned set = 1; set < 256; set++) {
        unsigned child = (unsigned)__builtin_popcount(set) - 1;
        best[set] = -DBL_MAX;
        for (unsigned slot = 0; slot < 8; slot++)
            if (set >> slot & 1)
                best[set] = fmax(best[set], best[set ^ 1u << slot] + worth(offsets, child, slot));
    }
    return best[255];
}

/* Runs both versions, which must agree; each child must occur once. */
static void assign(const float offsets[8][4], uint8_t ret_children[8])
{
    uint8_t scalar[8];
    unsigned seen = 0;
    octants_assign(offsets, OCTANTS_ROUNDS, ret_children);
    octants_assign_scalar(offsets, OCTANTS_ROUNDS, scalar);
    assert_memory_equal(ret_children, scalar, 8);
    for (int slot = 0; slot < 8; slot++)
        seen |= 1u << ret_children[slot];
    assert_int_equal(seen, 0xff);
}

static void totals_are_near_the_best(void **state)
{
    (void)state;
    struct random random = {1};
    double total = 0, best = 0;
    for (int round = 0; round < 4000; round++) {
        unsigned count = 1 + (unsigned)(random_next(&random) % 8);
        float offsets[8][4] = {{0}};
        uint8_t children[8];
        for (unsigned i = 0; i < count; i++)
            for (unsigned axis = 0; axis < 3; axis++)
                offsets[i][axis] = (float)(random_between(&random, -1, 1) * (axis == 2 ? 0.2 : 1));
        assign((const float(*)[4])offsets, children);
        for (unsigned slot = 0; slot < 8; slot++)
            total += worth((const float(*)[4])offsets, children[slot], slot);
        best += best_total((const float(*)[4])offsets);
    }
    assert_true(total <= best * (1 + 1e-9));
    assert_true(total >= best * 0.965);
}

static void corners_go_home(void **state)
{
    (void)state;
    for (unsigned turn = 0; turn < 8; turn++) {
        float offsets[8][4] = {{0}};
        uint8_t children[8];
        for (unsigned i = 0; i < 8; i++)
            for (unsigned axis = 0; axis < 3; axis++)
                offsets[i][axis] = (i ^ turn) >> axis & 1 ? 1.5f : -2;
        assign((const float(*)[4])offsets, children);
        for (unsigned slot = 0; slot < 8; slot++)
            assert_int_equal(children[slot], slot ^ turn);
    }
}

/* A single child goes to its octant, whatever its number is. */
static void one_alone_goes_home(void **state)
{
    (void)state;
    for (unsigned child = 0; child < 8; child++)
        for (unsigned octant = 0; octant < 8; octant++) {
            float offsets[8][4] = {{0}};
            uint8_t children[8];
            for (unsigned axis = 0; axis < 3; axis++)
                offsets[child][axis] = octant >> axis & 1 ? 1.0f : -1.0f;
            assign((const float(*)[4])offsets, children);
            assert_int_equal(children[octant], child);
        }
}

static void extremes_still_give_each_a_slot(void **state)
{
    (void)state;
    static const float values[] = {0, -0.0f, FLT_MAX / 8, -FLT_MAX / 8, 1e-45f, -1e-45f, 1, -1};
    struct random random = {2};
    for (int round = 0; round < 2000; round++) {
        float offsets[8][4] = {{0}};
        uint8_t children[8];
        for (unsigned i = 0; i < 8; i++)
            for (unsigned axis = 0; axis < 3; axis++)
                offsets[i][axis] = round ? values[random_next(&random) % 8] : 0;
        assign((const float(*)[4])offsets, children);
    }
}

/* Assigns boxes with centres anywhere, by every version that this machine has. */
static void boxes_go_where_their_centres_go(void **state)
{
    (void)state;
    struct random random = {5};
    for (int round = 0; round < 4000; round++) {
        unsigned count = 1 + (unsigned)(random_next(&random) % 8);
        double size = ldexp(1, (int)(random_next(&random) % 250) - 130),
               place = random_next(&random) % 2 ? size * 1000 : 0;
        struct box parent = {{0}, {0}}, children[8];
        const struct box *pointers[8];
        float offsets[8][4] = {{0}};
        uint8_t expected[8], found[8];
        for (int axis = 0; axis < 3; axis++)
            parent.max[axis] = (float)(place + size * random_between(&random, 0, 1));
        for (unsigned i = 0; i < 8; i++) {
            pointers[i] = &children[i];
            for (unsigned axis = 0; axis < 3; axis++) {
                children[i].min[axis] = (float)(place + size * (double)(random_next(&random) % 16));
                children[i].max[axis] = children[i].min[axis] + (float)(size * (double)(random_next(&random) % 4));
                float centre = 0.0625f * parent.min[axis] + 0.0625f * parent.max[axis];
                if (i < count)
                    offsets[i][axis] = 0.0625f * children[i].min[axis] + 0.0625f * children[i].max[axis] - centre;
            }
        }
        for (unsigned rounds = 0; rounds <= OCTANTS_ROUNDS; rounds++) {
            octants_assign_scalar((const float(*)[4])offsets, rounds, expected);
            for (int wide = 0; wide <= octants_has_avx2(); wide++) {
                octants_assign_boxes(&parent, pointers, count, rounds, wide, found);
                assert_memory_equal(found, expected, 8);
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(totals_are_near_the_best),
        cmocka_unit_test(corners_go_home),
        cmocka_unit_test(one_alone_goes_home),
        cmocka_unit_test(extremes_still_give_each_a_slot),
        cmocka_unit_test(boxes_go_where_their_centres_go),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

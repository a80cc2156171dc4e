/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_quantise.c - tests that quantised boxes are conservative with their margin, tight, and the same in
 * every version.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/format/portable_quantise.h"
#include "tests/support/random.h"

/* The plain version, which the library does not contain if the machine has SSE2. */
#define BVHD_SCALAR
#define portable_quantise portable_quantise_scalar
#define portable_quantise_moving portable_quantise_moving_scalar
void portable_quantise_scalar(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node);
void portable_quantise_moving_scalar(const struct portable_boxes *start, const struct portable_boxes *end,
                                     unsigned occupied, struct portable_moving_node *ret_node);
#include "builder/format/portable_quantise.c"
#undef portable_quantise
#undef portable_quantise_moving

/*
 * Returns the sign of high - low - span in real numbers: the rounded difference decides unless it equals span; then its
 * rounding error decides.
 */
static int compare(float high, float low, double span)
{
    double a = high, b = low, difference = a - b;
    double b_part = a - difference, a_part = difference + b_part;
    double rest = (a - a_part) + (b_part - b);
    if (difference != span)
        return difference > span ? 1 : -1;
    return (rest > 0) - (rest < 0);
}

static double step_of(const struct portable_node *node, int axis)
{
    return node->exponent[axis] ? ldexp(1, node->exponent[axis] - 127) : 0;
}

/* What all boxes on one axis reach from and to. */
struct reach {
    float low, high;
};

/* Checks the bytes of one axis, and extends *reach. */
static void check_axis(const struct portable_boxes *boxes, unsigned occupied, const struct portable_node *node,
                       const uint8_t lows[8], const uint8_t highs[8], int axis, struct reach *reach)
{
    double step = step_of(node, axis);
    float origin = node->origin[axis];
    assert_true(isfinite(origin));
    assert_true(node->exponent[axis] < 255);
    for (int slot = 0; slot < 8; slot++) {
        int lo = lows[slot], hi = highs[slot];
        float min = boxes->min[axis][slot], max = boxes->max[axis][slot];
        if (!(occupied >> slot & 1)) {
            assert_int_equal(lo, 255);
            assert_int_equal(hi, 0);
            continue;
        }
        reach->low = min < reach->low ? min : reach->low;
        reach->high = max > reach->high ? max : reach->high;
        if (step == 0) {
            assert_true(min == origin && max == origin && lo == 0 && hi == 0);
            continue;
        }
        assert_true(lo <= hi);
        if (origin == -FLT_MAX && lo == 0)
            assert_true(min >= origin);
        else
            assert_true(compare(min, origin, step * (lo + 1.0 / 64)) >= 0);
        assert_true(compare(max, origin, step * (hi - 1.0 / 64)) <= 0);
        /* It is also tight: one step further inward would not hold. */
        assert_true(compare(min, origin, step * (lo + 1 + 1.0 / 64 + 0x1p-20)) < 0);
        assert_true(hi == 0 || compare(max, origin, step * (hi - 1 - 1.0 / 64 - 0x1p-20)) > 0);
    }
}

/* Half the step would not suffice, unless floats are too coarse for its origin. */
static void check_step(const struct portable_node *node, int axis, struct reach reach)
{
    const double step = step_of(node, axis),
                 coarse = fmax(nextafterf(fabsf(reach.low), INFINITY) - (double)fabsf(reach.low), 0);
    if (step > 0x1p-126)
        assert_true((double)reach.high - reach.low + 2 * coarse > step / 2 * (255 - 1.0 / 32) * (1 - 0x1p-30));
}

static void make_rows(const struct portable_boxes *boxes, struct box rows[8], const struct box *pointers[8])
{
    for (int slot = 0; slot < 8; slot++) {
        pointers[slot] = &rows[slot];
        for (int axis = 0; axis < 3; axis++) {
            rows[slot].min[axis] = boxes->min[axis][slot];
            rows[slot].max[axis] = boxes->max[axis][slot];
        }
    }
}

/* Quantises from pointers to boxes, in every version that this machine supports. */
static void check_boxes(const struct portable_boxes *boxes, unsigned occupied, const struct portable_node *expected)
{
    struct box rows[8];
    const struct box *pointers[8];
    make_rows(boxes, rows, pointers);
    for (int wide = 0; wide <= portable_has_avx2(); wide++) {
        struct portable_node node;
        memset(&node, 0x5a, sizeof node);
        portable_quantise_boxes(pointers, occupied, wide, &node);
        assert_memory_equal(&node, expected, sizeof node);
    }
}

static void check(const struct portable_boxes *boxes, unsigned occupied)
{
    struct portable_node node, scalar;
    memset(&node, 0x5a, sizeof node);
    memset(&scalar, 0x5a, sizeof scalar);
    portable_quantise(boxes, occupied, &node);
    portable_quantise_scalar(boxes, occupied, &scalar);
    assert_memory_equal(&node, &scalar, sizeof node);
    check_boxes(boxes, occupied, &scalar);
    for (int axis = 0; axis < 3; axis++) {
        struct reach reach = {FLT_MAX, -FLT_MAX};
        check_axis(boxes, occupied, &node, node.lo[axis], node.hi[axis], axis, &reach);
        check_step(&node, axis, reach);
    }
    assert_int_equal(node.first_child, 0x5a5a5a5a);
    assert_int_equal(node.meta[3], 0x5a);
}

/* The same for a node with two boxes in each slot. */
static void check_moving(const struct portable_boxes *start, const struct portable_boxes *end, unsigned occupied)
{
    struct portable_moving_node node, other;
    struct box rows[2][8];
    const struct box *pointers[2][8];
    memset(&node, 0x5a, sizeof node);
    other = node;
    portable_quantise_moving(start, end, occupied, &node);
    portable_quantise_moving_scalar(start, end, occupied, &other);
    assert_memory_equal(&node, &other, sizeof node);
    make_rows(start, rows[0], pointers[0]);
    make_rows(end, rows[1], pointers[1]);
    for (int wide = 0; wide <= portable_has_avx2(); wide++) {
        memset(&other, 0x5a, sizeof other);
        portable_quantise_moving_boxes(pointers[0], pointers[1], occupied, wide, &other);
        assert_memory_equal(&node, &other, sizeof node);
    }
    for (int axis = 0; axis < 3; axis++) {
        struct reach reach = {FLT_MAX, -FLT_MAX};
        check_axis(start, occupied, &node.start, node.start.lo[axis], node.start.hi[axis], axis, &reach);
        check_axis(end, occupied, &node.start, node.end_lo[axis], node.end_hi[axis], axis, &reach);
        check_step(&node.start, axis, reach);
    }
    assert_int_equal(node.start.first_child, 0x5a5a5a5a);
    assert_int_equal(node.start.meta[3], 0x5a);
}

static float clamp(double value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : (float)value;
}

static void fill(struct random *random, double centre, double size, unsigned occupied, struct portable_boxes *boxes)
{
    int filler = __builtin_ctz(occupied);
    for (int slot = 0; slot < 8; slot++)
        for (int axis = 0; axis < 3; axis++) {
            double a = random_between(random, -1, 1), b = random_next(random) % 4 ? random_between(random, -1, 1) : a;
            float x = clamp(centre + a * size), y = clamp(centre + b * size);
            boxes->min[axis][slot] = x < y ? x : y;
            boxes->max[axis][slot] = x < y ? y : x;
        }
    for (int slot = 0; slot < 8; slot++)
        for (int axis = 0; axis < 3 && !(occupied >> slot & 1); axis++) {
            boxes->min[axis][slot] = boxes->min[axis][filler];
            boxes->max[axis][slot] = boxes->max[axis][filler];
        }
}

/* Sizes and distances from the origin range over all powers of two that floats hold. */
static void boxes_hold_with_room_at_every_magnitude(void **state)
{
    (void)state;
    struct random random = {3};
    for (int round = 0; round < 60000; round++) {
        struct portable_boxes boxes;
        double size = ldexp(random_between(&random, 0.5, 1), (int)(random_next(&random) % 279) - 150);
        double centre = random_next(&random) % 3
                            ? size * ldexp(random_between(&random, -1, 1), (int)(random_next(&random) % 40))
                            : 0;
        unsigned occupied = 1 + (unsigned)(random_next(&random) % 255);
        fill(&random, centre, size, occupied, &boxes);
        check(&boxes, occupied);
    }
}

static void both_keys_hold_on_one_grid(void **state)
{
    (void)state;
    struct random random = {9};
    for (int round = 0; round < 30000; round++) {
        struct portable_boxes start, end;
        const double size = ldexp(random_between(&random, 0.5, 1), (int)(random_next(&random) % 279) - 150),
                     centre = size * ldexp(random_between(&random, -1, 1), (int)(random_next(&random) % 40)),
                     way = random_next(&random) % 3 ? ldexp(size, (int)(random_next(&random) % 40) - 30) : 0;
        const unsigned occupied = 1 + (unsigned)(random_next(&random) % 255);
        fill(&random, centre, size, occupied, &start);
        fill(&random, centre + way, random_next(&random) % 2 ? size : size / 64, occupied, &end);
        check_moving(&start, random_next(&random) % 8 ? &end : &start, occupied);
    }
}

/* An axis has no step only if the boxes of both keys lie at one coordinate. */
static void moving_axes_are_flat_together(void **state)
{
    (void)state;
    struct portable_boxes start, end;
    struct portable_moving_node node;
    for (int slot = 0; slot < 8; slot++)
        for (int axis = 0; axis < 3; axis++) {
            start.min[axis][slot] = start.max[axis][slot] = -0.0f;
            end.min[axis][slot] = end.max[axis][slot] = axis == 1 ? 1 : 0;
        }
    portable_quantise_moving(&start, &end, 0xff, &node);
    assert_true(node.start.exponent[0] == 0 && node.start.exponent[1] > 0 && node.start.exponent[2] == 0);
    assert_true(node.start.hi[1][0] < node.end_lo[1][0]);
    assert_false(signbit(node.start.origin[0]));
    check_moving(&start, &end, 0xff);
    check_moving(&end, &start, 0x81);
    for (int slot = 0; slot < 8; slot++)
        end.max[2][slot] = FLT_MAX, start.min[2][slot] = -FLT_MAX;
    check_moving(&start, &end, 0xff);
}

static void one_ulp_apart(void **state)
{
    (void)state;
    static const float values[] = {0,      1,       1e6f,     -1e6f, 1e-45f,      -1e-45f, 3e38f,
                                   -3e38f, FLT_MIN, -FLT_MIN, 0.1f,  -8388608.0f, FLT_MAX, -FLT_MAX};
    for (unsigned v = 0; v < sizeof values / sizeof values[0]; v++)
        for (int ulps = 0; ulps < 300; ulps += 1 + ulps / 10) {
            struct portable_boxes boxes;
            float from = values[v], to = from;
            for (int i = 0; i < ulps; i++)
                to = nextafterf(to, from > 0 ? -FLT_MAX : FLT_MAX);
            for (int axis = 0; axis < 3; axis++)
                for (int slot = 0; slot < 8; slot++) {
                    boxes.min[axis][slot] = slot % 2 ? fminf(from, to) : from;
                    boxes.max[axis][slot] = slot % 2 ? fmaxf(from, to) : from;
                }
            check(&boxes, 0xff);
        }
}

static void the_whole_range_of_floats(void **state)
{
    (void)state;
    struct portable_boxes boxes;
    for (int axis = 0; axis < 3; axis++)
        for (int slot = 0; slot < 8; slot++) {
            boxes.min[axis][slot] = slot == 2 ? -FLT_MAX : slot * 1e37f;
            boxes.max[axis][slot] = slot == 5 ? FLT_MAX : slot * 1e37f;
        }
    check(&boxes, 0xff);
}

static void flat_axes_are_exact(void **state)
{
    (void)state;
    struct portable_boxes boxes;
    struct portable_node node;
    for (int slot = 0; slot < 8; slot++)
        for (int axis = 0; axis < 3; axis++)
            boxes.min[axis][slot] = boxes.max[axis][slot] = axis == 1 ? 0.3f : (float)slot;
    portable_quantise(&boxes, 0xff, &node);
    assert_int_equal(node.exponent[1], 0);
    assert_true(node.origin[1] == 0.3f);
    assert_true(node.exponent[0] > 0);
    check(&boxes, 0xff);
}

/* 255 - 1/32 steps fit into a node, slightly more do not. */
static void the_step_is_the_smallest_that_fits(void **state)
{
    (void)state;
    for (int extent = 1; extent < 2000; extent++) {
        struct portable_boxes boxes;
        struct portable_node node;
        for (int slot = 0; slot < 8; slot++)
            for (int axis = 0; axis < 3; axis++) {
                boxes.min[axis][slot] = 0;
                boxes.max[axis][slot] = (float)extent;
            }
        portable_quantise(&boxes, 0xff, &node);
        int expected = 127;
        while (extent / ldexp(1, expected - 127) > 255 - 1.0 / 32)
            expected++;
        while (extent / ldexp(1, expected - 1 - 127) <= 255 - 1.0 / 32)
            expected--;
        assert_int_equal(node.exponent[0], expected);
    }
}

/* The AVX2 version rarely leaves a node to the plain one. */
static void most_nodes_are_for_the_wide_version(void **state)
{
    (void)state;
    struct random random = {4};
    int done = 0, rounds = 2000;
    for (int round = 0; round < rounds && portable_has_avx2(); round++) {
        struct box rows[8];
        const struct box *pointers[8];
        struct portable_node node;
        for (int slot = 0; slot < 8; slot++) {
            pointers[slot] = &rows[slot];
            for (int axis = 0; axis < 3; axis++) {
                rows[slot].min[axis] = (float)random_between(&random, 5, 6);
                rows[slot].max[axis] = rows[slot].min[axis] + (float)random_between(&random, 0, 0.1);
            }
        }
        done += portable_quantise_avx2(pointers, 0xff, &node);
    }
    assert_true(!portable_has_avx2() || done > rounds * 9 / 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_hold_with_room_at_every_magnitude),
        cmocka_unit_test(both_keys_hold_on_one_grid),
        cmocka_unit_test(moving_axes_are_flat_together),
        cmocka_unit_test(one_ulp_apart),
        cmocka_unit_test(the_whole_range_of_floats),
        cmocka_unit_test(flat_axes_are_exact),
        cmocka_unit_test(the_step_is_the_smallest_that_fits),
        cmocka_unit_test(most_nodes_are_for_the_wide_version),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

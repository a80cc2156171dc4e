/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_boxtest.c - tests that no box that a ray meets is missed, in every version of the box test and at every
 * magnitude.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/boxtest_kernels.h"
#include "tests/support/random.h"

/*
 * Makes a node in [-2, 2) * 2^magnitude, shifted, sometimes with flat axes, with some empty slots; and the bounds of a
 * structure around it.
 */
static void make_node(struct random *random, int magnitude, struct portable_node *ret_node, float ret_bounds[6])
{
    memset(ret_node, 0, sizeof *ret_node);
    for (int axis = 0; axis < 3; axis++) {
        double step = ldexp(1, magnitude - (int)random_between(random, 0, 12));
        bool flat = random_next(random) % 8 == 0;
        ret_node->origin[axis] = (float)ldexp(random_between(random, -2, 2), magnitude);
        ret_node->exponent[axis] = flat ? 0 : (uint8_t)(127 + ilogb(step / 128));
        for (int s = 0; s < 8; s++) {
            unsigned a = random_next(random) & 255, b = random_next(random) & 255;
            ret_node->meta[s] = random_next(random) % 6 ? 0x20 : 0;
            ret_node->lo[axis][s] = (uint8_t)(a < b ? a : b);
            ret_node->hi[axis][s] = (uint8_t)(a < b ? b : a);
        }
        ret_bounds[axis] = ret_node->origin[axis];
        ret_bounds[3 + axis] = (float)(ret_node->origin[axis] + (flat ? 0 : 4 * step));
    }
}

struct span {
    long double near, far;
};

/*
 * Returns the interval of the ray within child s in long double, which is exact for these tests. It is empty if near >
 * far.
 */
static struct span exact_span(const struct portable_node *node, int s, const double origin[3],
                              const double direction[3])
{
    struct span span = {-INFINITY, INFINITY};
    for (int axis = 0; axis < 3; axis++) {
        long double scale = node->exponent[axis] ? ldexpl(1, node->exponent[axis] - 127) : 0;
        long double lo = (long double)node->origin[axis] + node->lo[axis][s] * scale - origin[axis];
        long double hi = (long double)node->origin[axis] + node->hi[axis][s] * scale - origin[axis];
        if (direction[axis] == 0) {
            if (lo > 0 || hi < 0)
                span = (struct span){INFINITY, -INFINITY};
            continue;
        }
        long double first = (direction[axis] > 0 ? lo : hi) / direction[axis],
                    last = (direction[axis] > 0 ? hi : lo) / direction[axis];
        span.near = fmaxl(span.near, first);
        span.far = fminl(span.far, last);
    }
    return span;
}

/* Makes a ray towards the node, sometimes with components that are zero or tiny. */
static void make_ray(struct random *random, const struct portable_node *node, bool floats, double ret_origin[3],
                     double ret_direction[3])
{
    int s = (int)(random_next(random) & 7);
    double distance = pow(2, random_between(random, -6, 10));
    for (int axis = 0; axis < 3; axis++) {
        double scale = node->exponent[axis] ? ldexp(1, node->exponent[axis] - 127) : 0;
        double q =
            random_next(random) % 4 ? random_between(random, node->lo[axis][s], node->hi[axis][s]) : node->lo[axis][s];
        double target = node->origin[axis] + q * scale, size = ldexp(1, ilogb(fabs(node->origin[axis]) + 256 * scale));
        double direction = random_between(random, -1, 1) * size;
        if (random_next(random) % 8 == 0)
            direction = 0;
        else if (random_next(random) % 8 == 0)
            direction *= pow(2, random_between(random, -60, 0));
        ret_direction[axis] = floats ? (float)direction : direction;
        ret_origin[axis] = floats ? (float)(target - direction * distance) : target - direction * distance;
    }
}

struct tally {
    int met, apart, kept_apart;
};

/* Checks that every child that is exactly met is reported; counts reported children that are clearly missed. */
static void check_bits(const struct portable_node *node, const double origin[3], const double direction[3], double tmin,
                       double tmax, unsigned bits, const double near[8], double tolerance, struct tally *tally)
{
    for (int s = 0; s < 8; s++) {
        struct span span = exact_span(node, s, origin, direction);
        bool meets = fmaxl(span.near, tmin) <= fminl(span.far, tmax);
        bool reported = bits >> s & 1;
        if (node->meta[s] == 0) {
            assert_false(reported);
            continue;
        }
        if (meets) {
            assert_true(reported);
            assert_true(near[s] <= fmaxl(span.near, tmin));
            tally->met++;
        }
        long double margin = tolerance * (fabsl(span.near) + fabsl(span.far) + fabs(tmin));
        bool comparable = isfinite((double)span.near) && isfinite((double)span.far);
        if (comparable && span.near - margin > span.far + margin && span.near > 0 && span.far > 0) {
            tally->apart++;
            tally->kept_apart += !reported;
        }
    }
}

static bool init_floats(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                        struct boxtest_ray *ret_ray)
{
    float o[4] = {(float)origin[0], (float)origin[1], (float)origin[2], NAN};
    float d[4] = {(float)direction[0], (float)direction[1], (float)direction[2], 0};
    return boxtest_init_floats(o, d, tmin, bounds, ret_ray);
}

/* Reverses the ray along the same line and the same interval. */
static void turn_around(double direction[3], float *tmin, float *tmax)
{
    float begin = -*tmax;
    for (int axis = 0; axis < 3; axis++)
        direction[axis] = -direction[axis];
    *tmax = -*tmin;
    *tmin = begin;
}

static void test_float_is_conservative(void **state)
{
    (void)state;
    struct random random = {1};
    struct tally tally = {0};
    int floats = 0;
    for (int i = 0; i < 300000; i++) {
        struct portable_node node;
        float bounds[6], near[8];
        double origin[3], direction[3], near_double[8];
        struct boxtest_ray ray;
        make_node(&random, (int)random_between(&random, -20, 20), &node, bounds);
        make_ray(&random, &node, i % 2, origin, direction);
        /* Sometimes the node is a small part of its structure. */
        for (int axis = 0; axis < 3 && i % 7 == 0; axis++)
            bounds[3 + axis] += (float)fabs(origin[axis]) * ldexpf(1, i % 29);
        float tmin = i % 3 ? 0 : (float)random_between(&random, 0, 4),
              tmax = i % 5 ? FLT_MAX : tmin + (float)random_between(&random, 0, 64);
        if (i % 11 == 0) /* everything that is met lies behind the origin */
            turn_around(direction, &tmin, &tmax);
        if (!boxtest_init(origin, direction, tmin, bounds, &ray))
            continue;
        floats++;
        /* Each way to prepare the ray is tried with each test. */
        for (int way = 0; way <= (boxtest_has_avx2() ? 1 + i % 2 : 0); way++) {
            if (way)
                assert_true((way == 1 ? boxtest_init_avx2 : init_floats)(origin, direction, tmin, bounds, &ray));
            for (int wide = 0; wide <= boxtest_has_avx2(); wide++) {
                unsigned bits = (wide ? boxtest_avx2 : boxtest_float)(&ray, &node, tmax, near);
                for (int s = 0; s < 8; s++)
                    near_double[s] = near[s];
                check_bits(&node, origin, direction, tmin, tmax, bits, near_double, 1e-5, &tally);
            }
        }
    }
    assert_true(floats > 200000 && tally.met > 200000 && tally.apart > 100000 && tally.kept_apart > 0.99 * tally.apart);
}

/* The double version is conservative from the smallest to the largest floats. */
static void test_double_is_conservative(void **state)
{
    (void)state;
    struct random random = {2};
    struct tally tally = {0};
    for (int i = 0; i < 100000; i++) {
        struct portable_node node;
        float bounds[6];
        double origin[3], direction[3], near[8];
        struct boxtest_exact ray;
        make_node(&random, (int)random_between(&random, -100, 124), &node, bounds);
        make_ray(&random, &node, i % 2, origin, direction);
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
            continue;
        boxtest_init_exact(origin, direction, 0, bounds, &ray);
        unsigned bits = boxtest_double(&ray, &node, FLT_MAX, near);
        check_bits(&node, origin, direction, 0, FLT_MAX, bits, near, 1e-9, &tally);
    }
    assert_true(tally.met > 50000 && tally.apart > 30000 && tally.kept_apart > 0.99 * tally.apart);
}

typedef bool (*init_function)(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                              struct boxtest_ray *ret_ray);

/* Checks the ranges in which float tests may be used. */
static void check_range(init_function init)
{
    struct boxtest_ray ray;
    const float bounds[6] = {-1, -1, -1, 1, 1, 1}, large[6] = {0, 0, 0, 1, 1, 0x1p61f},
                small[6] = {0, 0, 0, 0x1p-61f, 0x1p-70f, 0};
    const double origin[3] = {0, 0, 5}, far[3] = {0x1p61, 0, 0}, ahead[3] = {0, 0, -1}, long_one[3] = {0x1p61, 0, 0},
                 short_one[3] = {0x1p-33, 0, 0}, tiny_axis[3] = {0x1p-100, 0x1p-140, 1}, not_a_number[3] = {1, NAN, 1};
    assert_true(init(origin, ahead, 0, bounds, &ray));
    assert_int_equal(ray.parallel_axes, 3);
    assert_true(init(origin, tiny_axis, 0, bounds, &ray));
    assert_int_equal(ray.parallel_axes, 3);
    assert_false(init(not_a_number, ahead, 0, bounds, &ray));
    assert_false(init(origin, not_a_number, 0, bounds, &ray));
    assert_false(init(origin, (double[]){0, 0, 0}, 0, bounds, &ray));
    assert_false(init(far, ahead, 0, bounds, &ray));
    assert_false(init(origin, long_one, 0, bounds, &ray));
    assert_false(init(origin, short_one, 0, bounds, &ray));
    assert_false(init(origin, ahead, 0, large, &ray));
    assert_false(init(origin, ahead, 0, small, &ray));
}

static void test_range(void **state)
{
    (void)state;
    check_range(boxtest_init);
    if (boxtest_has_avx2()) {
        check_range(boxtest_init_avx2);
        check_range(init_floats);
    }
}

/* A box of any magnitude, sometimes flat, and a ray towards it or, if `touches`, towards its lowest corner. */
struct aimed {
    float min[3], max[3];
    double origin[3], direction[3];
};

static struct aimed make_aimed(struct random *random, bool touches)
{
    struct aimed aimed;
    int magnitude = (int)random_between(random, -140, 120);
    for (int axis = 0; axis < 3; axis++) {
        float a = (float)ldexp(random_between(random, -1, 1), magnitude),
              b = (float)ldexp(random_between(random, -1, 1), magnitude);
        if (random_next(random) % 6 == 0)
            b = a;
        aimed.min[axis] = fminf(a, b);
        aimed.max[axis] = fmaxf(a, b);
        aimed.origin[axis] = (float)ldexp(random_between(random, -2, 2), magnitude);
        double target =
            touches ? aimed.min[axis] : (aimed.min[axis] + (double)aimed.max[axis]) * random_between(random, 0, 1);
        aimed.direction[axis] = random_next(random) % 6 ? target - aimed.origin[axis] : 0;
    }
    return aimed;
}

static bool is_aimed_nowhere(const struct aimed *aimed)
{
    return aimed->direction[0] == 0 && aimed->direction[1] == 0 && aimed->direction[2] == 0;
}

/*
 * Returns the interval of the ray within the box in long double. `*ret_beside` says whether the ray is within the box
 * on all axes along which it does not move.
 */
static struct span span_of(const struct aimed *aimed, bool *ret_beside)
{
    struct span span = {-INFINITY, INFINITY};
    *ret_beside = true;
    for (int axis = 0; axis < 3; axis++) {
        double origin = aimed->origin[axis], direction = aimed->direction[axis];
        if (direction == 0) {
            *ret_beside = *ret_beside && origin >= aimed->min[axis] && origin <= aimed->max[axis];
            continue;
        }
        long double low = aimed->min[axis], high = aimed->max[axis];
        span.near = fmaxl(span.near, ((direction > 0 ? low : high) - origin) / direction);
        span.far = fminl(span.far, ((direction > 0 ? high : low) - origin) / direction);
    }
    return span;
}

/* Results are compared with long double. Touching counts as a hit, and a ray that starts inside enters at tmin. */
static void test_aabb(void **state)
{
    (void)state;
    struct random random = {3};
    int met = 0, missed = 0;
    for (int i = 0; i < 300000; i++) {
        struct aimed aimed = make_aimed(&random, i % 2);
        if (is_aimed_nowhere(&aimed))
            continue;
        bool beside;
        double entry;
        struct span span = span_of(&aimed, &beside);
        bool reported = boxtest_aabb(aimed.origin, aimed.direction, aimed.min, aimed.max, 0, 4, &entry);
        bool meets = beside && fmaxl(span.near, 0) <= fminl(span.far, 4);
        if (meets) {
            assert_true(reported);
            long double expected = fmaxl(span.near, 0);
            assert_true(fabsl(entry - expected) <= 1e-14L * expected && entry >= 0 && entry <= 4);
        }
        if (!beside || span.near * (1 - 1e-14L) > span.far * (1 + 1e-14L) || span.far < 0 || span.near > 4 + 1e-13L)
            assert_false(reported);
        met += meets;
        missed += !reported;
    }
    assert_true(met > 20000 && missed > 20000);
}

/* Boxes of nodes with two children: no box that is met is missed, and few others are reported. */
static void test_box(void **state)
{
    (void)state;
    struct random random = {4};
    int met = 0, apart = 0, kept_apart = 0;
    for (int i = 0; i < 300000; i++) {
        struct aimed aimed = make_aimed(&random, i % 2);
        if (is_aimed_nowhere(&aimed))
            continue;
        float bounds[6];
        bool beside;
        double near;
        struct boxtest_exact ray;
        struct span span = span_of(&aimed, &beside);
        memcpy(bounds, aimed.min, sizeof aimed.min);
        memcpy(bounds + 3, aimed.max, sizeof aimed.max);
        boxtest_init_exact(aimed.origin, aimed.direction, 0, bounds, &ray);
        bool reported = kernel_box(&ray, aimed.min, aimed.max, 4, &near);
        if (beside && fmaxl(span.near, 0) <= fminl(span.far, 4)) {
            assert_true(reported && near <= fmaxl(span.near, 0));
            met++;
        } else if (beside && (span.near > span.far + 1e-9L || span.far < -1e-9L || span.near > 4 + 1e-9L)) {
            apart++;
            kept_apart += !reported;
        }
    }
    assert_true(met > 20000 && apart > 20000 && kept_apart > 0.99 * apart);
}

static void test_box_edges(void **state)
{
    (void)state;
    const float min[3] = {1, -1, -1}, max[3] = {2, 1, 1}, bounds[6] = {1, -1, -1, 2, 1, 1};
    const float nans[3] = {NAN, -1, -1}, high[3] = {INFINITY, INFINITY, INFINITY},
                low[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double origin[3] = {0, 0, 0}, ahead[3] = {1, 0, 0}, aside[3] = {0, 0, 1};
    struct boxtest_exact ray, across;
    double near = -1;
    boxtest_init_exact(origin, ahead, 0, bounds, &ray);
    boxtest_init_exact(origin, aside, 0, bounds, &across);
    assert_true(kernel_box(&ray, min, max, 10, &near) && near <= 1 && near > 0.999);
    assert_true(kernel_box(&ray, min, max, 1, &near));
    assert_false(kernel_box(&ray, min, max, 0.5, &near));
    assert_false(kernel_box(&across, min, max, 10, &near));
    assert_false(kernel_box(&ray, nans, max, 10, &near));
    assert_false(kernel_box(&ray, min, nans, 10, &near));
    assert_false(kernel_box(&ray, high, low, INFINITY, &near));
    assert_true(kernel_box(&ray, low, high, INFINITY, &near) && near == 0);
}

static void test_aabb_edges(void **state)
{
    (void)state;
    const float min[3] = {1, -1, -1}, max[3] = {2, 1, 1}, nan_min[3] = {NAN, -1, -1}, swapped[3] = {3, -1, -1};
    const double origin[3] = {0, 0, 0}, ahead[3] = {1, 0, 0}, inside[3] = {1.5, 0, 0}, grazing[3] = {0, 1, -1};
    double entry = -1;
    assert_true(boxtest_aabb(origin, ahead, min, max, 0, 10, &entry) && entry == 1);
    assert_true(boxtest_aabb(origin, ahead, min, max, 2, 10, &entry) && entry == 2);
    assert_true(boxtest_aabb(origin, ahead, min, max, 0, 1, &entry) && entry == 1);
    assert_false(boxtest_aabb(origin, ahead, min, max, 2.5, 10, &entry));
    assert_false(boxtest_aabb(origin, ahead, min, max, 0, 0.5, &entry));
    assert_true(boxtest_aabb(inside, ahead, min, max, 0, 10, &entry) && entry == 0);
    assert_true(boxtest_aabb(grazing, ahead, min, max, 0, 10, &entry) && entry == 1);
    assert_true(boxtest_aabb(origin, ahead, min, max, 0, INFINITY, &entry));
    assert_false(boxtest_aabb(origin, ahead, nan_min, max, 0, 10, &entry));
    assert_false(boxtest_aabb(origin, ahead, swapped, max, 0, 10, &entry));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_float_is_conservative),
        cmocka_unit_test(test_double_is_conservative),
        cmocka_unit_test(test_range),
        cmocka_unit_test(test_aabb),
        cmocka_unit_test(test_aabb_edges),
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_box_edges),
    };
    return cmocka_run_group_tests_name("boxtest", tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_swept_shape.c - tests that boxes of spheres and linear swept spheres contain every point of the surface, and
 * little more. The reference samples the surface in extended precision, from its definition as the envelope of the
 * spheres between both ends.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/swept_shape.h"
#include "tests/support/random.h"

enum { SHAPES = 100000, SAMPLES = 12 };

/* A shape as the reference sees it. */
struct swept {
    float ends[2][4];
    unsigned caps;
    long double axis[3], length, slope; /* the unit vector along the axis; the radii's difference over the length */
    int swallower; /* the end whose sphere contains the other one; -1: none */
};

static void reference_init(struct swept *swept)
{
    long double square = 0;
    for (int k = 0; k < 3; k++) {
        swept->axis[k] = (long double)swept->ends[1][k] - swept->ends[0][k];
        square += swept->axis[k] * swept->axis[k];
    }
    const long double difference = (long double)swept->ends[0][3] - swept->ends[1][3];
    swept->length = sqrtl(square);
    swept->slope = difference / swept->length;
    for (int k = 0; k < 3; k++)
        swept->axis[k] /= swept->length;
    swept->swallower = swept->length > fabsl(difference) ? -1 : difference < 0;
}

static long double dot(const long double a[3], const long double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool normalise(long double v[3])
{
    const long double length = sqrtl(dot(v, v));
    for (int k = 0; k < 3; k++)
        v[k] /= length;
    return length > 1e-9L;
}

static long double magnitude(const float end[4])
{
    return fabsl(end[0]) + fabsl(end[1]) + fabsl(end[2]) + end[3];
}

static void must_contain(const struct swept *swept, const struct box *box, const long double point[3], const char *what)
{
    /* What the reference itself may be off by. */
    const long double slack = (magnitude(swept->ends[0]) + magnitude(swept->ends[1])) * 0x1p-58L;
    for (int k = 0; k < 3; k++)
        if (point[k] < box->min[k] - slack || point[k] > box->max[k] + slack)
            fail_msg("%s: %.12Lg on axis %d is outside of %.9g to %.9g, caps %u, ends (%g %g %g) %g, (%g %g %g) %g",
                     what, point[k], k, (double)box->min[k], (double)box->max[k], swept->caps,
                     (double)swept->ends[0][0], (double)swept->ends[0][1], (double)swept->ends[0][2],
                     (double)swept->ends[0][3], (double)swept->ends[1][0], (double)swept->ends[1][1],
                     (double)swept->ends[1][2], (double)swept->ends[1][3]);
}

/* Makes a direction orthogonal to the axis; twice, because the first time much may cancel. */
static bool normal_to(const struct swept *swept, const long double across[3], long double ret_normal[3])
{
    memcpy(ret_normal, across, 3 * sizeof *across);
    for (int turn = 0; turn < 2; turn++) {
        const long double along = dot(ret_normal, swept->axis);
        for (int k = 0; k < 3; k++)
            ret_normal[k] -= along * swept->axis[k];
        if (!normalise(ret_normal))
            return false;
    }
    return true;
}

/* The point of the side that the sphere at `z` touches, in the direction of `across`. */
static bool side_point(const struct swept *swept, long double z, const long double across[3], long double ret_point[3])
{
    long double normal[3];
    const long double root = sqrtl(1 - swept->slope * swept->slope);
    if (!normal_to(swept, across, normal))
        return false;
    const long double radius = swept->ends[0][3] * (1 - z) + swept->ends[1][3] * z;
    for (int k = 0; k < 3; k++)
        ret_point[k] = swept->ends[0][k] * (1 - z) + swept->ends[1][k] * z +
                       radius * (swept->slope * swept->axis[k] + root * normal[k]);
    return true;
}

/* The point of an end's sphere in a direction, if it belongs to the cap. */
static bool cap_point(const struct swept *swept, int end, const long double direction[3], long double ret_point[3])
{
    const long double along = dot(direction, swept->axis) - swept->slope;
    if (!(swept->caps & 1u << end) || (swept->swallower < 0 && (end == 0 ? along > 0 : along < 0)) ||
        (swept->swallower >= 0 && swept->swallower != end))
        return false;
    for (int k = 0; k < 3; k++)
        ret_point[k] = swept->ends[end][k] + swept->ends[end][3] * direction[k];
    return true;
}

static void random_direction(struct random *random, long double ret_direction[3])
{
    do {
        double point[3];
        random_point(random, point);
        for (int k = 0; k < 3; k++)
            ret_direction[k] = point[k];
    } while (!normalise(ret_direction));
}

static void grow(const long double point[3], long double reached[6])
{
    for (int k = 0; k < 3; k++) {
        reached[k] = fminl(reached[k], point[k]);
        reached[3 + k] = fmaxl(reached[3 + k], point[k]);
    }
}

/* Samples along the axes, where the extremes are, or else at random; `reached` is the box of the samples. */
static void sample(const struct swept *swept, struct random *random, const struct box *box, bool extremes,
                   long double reached[6])
{
    for (int i = 0; i < (extremes ? 6 : SAMPLES); i++) {
        long double direction[3] = {0, 0, 0}, point[3];
        if (extremes)
            direction[i % 3] = i < 3 ? 1 : -1;
        else
            random_direction(random, direction);
        const long double z = extremes ? 0 : random_between(random, 0, 1);
        for (int end = 0; end < 2; end++) {
            if (cap_point(swept, end, direction, point)) {
                must_contain(swept, box, point, "cap");
                grow(point, reached);
            }
            if (swept->swallower < 0 && side_point(swept, end == 0 ? z : 1 - z, direction, point)) {
                must_contain(swept, box, point, "side");
                grow(point, reached);
            }
        }
    }
}

enum manner {
    ORDINARY,
    FAR_AWAY,
    LONG,
    FLAT,
    NEARLY_SWALLOWED,
    SWALLOWED,
    TINY,
    HUGE_ONE,
    ANY_EXPONENT,
    POINTED,
    MANNERS
};

static float any_float(struct random *random)
{
    return ldexpf((float)random_between(random, -1, 1), (int)(random_next(random) % 240) - 140);
}

static struct swept random_shape(struct random *random, enum manner manner)
{
    struct swept swept = {.caps = (unsigned)random_next(random) % 4};
    for (int end = 0; end < 2; end++) {
        for (int k = 0; k < 3; k++)
            swept.ends[end][k] = (float)random_between(random, -1, 1);
        swept.ends[end][3] = (float)random_between(random, 0, 0.5);
    }
    float *a = swept.ends[0], *b = swept.ends[1];
    for (int k = 0; k < 3 && manner == FAR_AWAY; k++)
        a[k] += 1e6f, b[k] += 1e6f;
    if (manner == LONG)
        a[3] *= 1e-3f, b[3] *= 1e-3f;
    if (manner == FLAT)
        b[0] = a[0], b[1] = random_next(random) % 2 ? a[1] : b[1];
    if (manner == NEARLY_SWALLOWED || manner == SWALLOWED) {
        double square = 0;
        for (int k = 0; k < 3; k++)
            square += ((double)b[k] - a[k]) * ((double)b[k] - a[k]);
        const double factor = 1 + (manner == SWALLOWED ? 1 : -1) * ldexp(1, -(int)(random_next(random) % 50));
        const int larger = (int)(random_next(random) % 2);
        swept.ends[larger][3] = (float)(swept.ends[1 - larger][3] + sqrt(square) * factor);
    }
    for (int k = 0; k < 8 && (manner == TINY || manner == HUGE_ONE); k++)
        swept.ends[k / 4][k % 4] *= manner == TINY ? 1e-42f : 1.7e38f;
    for (int k = 0; k < 8 && manner == ANY_EXPONENT; k++)
        swept.ends[k / 4][k % 4] = k % 4 == 3 ? fabsf(any_float(random)) : any_float(random);
    if (manner == POINTED)
        swept.ends[random_next(random) % 2][3] = 0;
    reference_init(&swept);
    return swept;
}

/* Boxes contain all samples; those of ordinary shapes exceed the extremes by less than a millionth. */
static void boxes_contain_the_surface(void **state)
{
    (void)state;
    struct random random = {5};
    unsigned tight = 0, swallowed = 0;
    for (int i = 0; i < SHAPES; i++) {
        const enum manner manner = (enum manner)(i % MANNERS);
        const struct swept swept = random_shape(&random, manner);
        const struct box box = swept_shape_box(swept.ends[0], swept.ends[1], swept.caps);
        long double reached[6] = {INFINITY, INFINITY, INFINITY, -INFINITY, -INFINITY, -INFINITY};
        assert_false(box_is_empty(&box));
        if (swept.length > 0) {
            sample(&swept, &random, &box, false, reached);
            sample(&swept, &random, &box, true, reached);
        }
        const bool is_nothing = swept_shape_is_nothing(swept.ends[0], swept.ends[1], swept.caps);
        if (is_nothing && reached[0] < INFINITY && swept.ends[0][3] + swept.ends[1][3] > 0)
            fail_msg("shape %d has a surface", i);
        swallowed += swept.swallower >= 0;
        const bool is_sheer = manner == NEARLY_SWALLOWED || manner == SWALLOWED || fabsl(swept.slope) > 0.999L;
        if (is_sheer || manner == HUGE_ONE || manner == ANY_EXPONENT || reached[0] == INFINITY)
            continue;
        const long double scale = magnitude(swept.ends[0]) + magnitude(swept.ends[1]), most = scale * 1e-6L + 1e-44L;
        for (int k = 0; k < 3; k++)
            if (reached[k] - box.min[k] > most || box.max[k] - reached[3 + k] > most)
                fail_msg("shape %d on axis %d: %.9g to %.9g is more than %.9Lg to %.9Lg", i, k, (double)box.min[k],
                         (double)box.max[k], reached[k], reached[3 + k]);
        tight++;
    }
    assert_true(tight > SHAPES / 2 && swallowed > SHAPES / MANNERS / 2);
}

/* One sphere inside the other leaves the larger one, if it has a cap, and a point otherwise. */
static void swallowed_ends_vanish(void **state)
{
    (void)state;
    static const float large[4] = {1, 2, 3, 4}, small[4] = {2, 2, 3, 0.5f}, equal[4] = {1, 2, 3, 4};
    const struct box sphere = swept_shape_sphere(large);
    for (unsigned caps = 0; caps < 4; caps++)
        for (int is_second = 0; is_second < 2; is_second++) {
            const float *first = is_second ? small : large, *second = is_second ? large : small;
            const bool has_cap = caps & 1u << is_second;
            const struct box box = swept_shape_box(first, second, caps);
            assert_int_equal(swept_shape_is_nothing(first, second, caps), !has_cap);
            for (int k = 0; k < 3; k++) {
                assert_true(box.min[k] == (has_cap ? sphere.min[k] : large[k]));
                assert_true(box.max[k] == (has_cap ? sphere.max[k] : large[k]));
            }
            /* Of equal ends the first one counts. */
            assert_int_equal(swept_shape_is_nothing(large, equal, caps), !(caps & SWEPT_SHAPE_CAP_FIRST));
        }
    static const float thread[2][4] = {{0, 0, 0, 0}, {1, 0, 0, 0}};
    assert_true(swept_shape_is_nothing(thread[0], thread[1], SWEPT_SHAPE_CAPS));
}

/* A sphere has the smallest box, also where a double does not hold the sum of centre and radius. */
static void spheres_have_the_smallest_box(void **state)
{
    (void)state;
    static const struct {
        float centre, radius, low, high;
    } cases[] = {
        {0, 0, 0, 0},
        {1, 2, -1, 3},
        {-8, 0.5f, -8.5f, -7.5f},
        {1, 0x1p-60f, 0x1.fffffep-1f, 0x1.000002p0f},
        {-1, 0x1p-149f, -0x1.000002p0f, -0x1.fffffep-1f},
        {0x1p-149f, 1, -1, 0x1.000002p0f},
        {1, 0x1.000002p-24f, 0x1.fffffcp-1f, 0x1.000002p0f},
        {FLT_MAX, FLT_MAX, 0, FLT_MAX},
        {-FLT_MAX, 1, -FLT_MAX, -0x1.fffffcp127f},
        {INFINITY, 0, FLT_MAX, FLT_MAX},
        {0, INFINITY, -FLT_MAX, FLT_MAX},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const float sphere[4] = {cases[i].centre, 0, cases[i].centre, cases[i].radius};
        const struct box box = swept_shape_sphere(sphere), both = swept_shape_box(sphere, sphere, SWEPT_SHAPE_CAPS);
        if (box.min[0] != cases[i].low || box.max[0] != cases[i].high)
            fail_msg("case %zu: %a to %a", i, (double)box.min[0], (double)box.max[0]);
        assert_memory_equal(&box, &both, sizeof box);
        assert_true(box.min[2] == box.min[0] && box.max[2] == box.max[0] && box.min[1] == -box.max[1]);
    }
}

/* An infinite end counts as one as far away as floats reach. */
static void infinite_ends_are_clamped(void **state)
{
    (void)state;
    static const float ends[][4] = {{INFINITY, -INFINITY, 0, 1},
                                    {0, 0, 0, INFINITY},
                                    {FLT_MAX, FLT_MAX, -FLT_MAX, FLT_MAX},
                                    {1, 2, 3, 1},
                                    {0, 0, 0, 0}};
    for (int a = 0; a < 5; a++)
        for (int b = 0; b < 5; b++)
            for (unsigned caps = 0; caps < 4; caps++) {
                const struct box box = swept_shape_box(ends[a], ends[b], caps);
                assert_false(box_is_empty(&box));
                for (int k = 0; k < 3; k++)
                    assert_true(isfinite(box.min[k]) && isfinite(box.max[k]));
            }
}

/* Without caps the box of a thick, straight piece ends where its circles do. */
static void missing_caps_make_boxes_smaller(void **state)
{
    (void)state;
    static const float first[4] = {0, 0, 0, 1}, second[4] = {4, 0, 0, 1};
    static const float reach[4][2] = {{0, 4}, {-1, 4}, {0, 5}, {-1, 5}};
    for (unsigned caps = 0; caps < 4; caps++) {
        const struct box box = swept_shape_box(first, second, caps);
        assert_true(fabsf(box.min[0] - reach[caps][0]) < 1e-6f && fabsf(box.max[0] - reach[caps][1]) < 1e-6f);
        assert_true(fabsf(box.min[1] + 1) < 1e-6f && fabsf(box.max[2] - 1) < 1e-6f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_contain_the_surface),       cmocka_unit_test(swallowed_ends_vanish),
        cmocka_unit_test(spheres_have_the_smallest_box),   cmocka_unit_test(infinite_ends_are_clamped),
        cmocka_unit_test(missing_caps_make_boxes_smaller),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_triangle.c - tests that the triangle test is exact and watertight, at every magnitude and in both versions. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/random.h"
#include "builder/traverse/triangle.h"
#include "builder/traverse/triangle_avx2.h"

__extension__ typedef __int128 wide_integer;

static int64_t random_integer(struct random *random, int64_t limit)
{
    return (int64_t)random_between(random, (double)-limit, (double)limit + 1);
}

/* Returns d . (a x b), exactly. */
static wide_integer volume(const int64_t d[3], const int64_t a[3], const int64_t b[3])
{
    return (wide_integer)d[0] * (a[1] * b[2] - a[2] * b[1]) + (wide_integer)d[1] * (a[2] * b[0] - a[0] * b[2]) +
           (wide_integer)d[2] * (a[0] * b[1] - a[1] * b[0]);
}

static struct triangle_ray make_ray(const double origin[3], const double direction[3])
{
    struct triangle_ray ray;
    triangle_ray_init(origin, direction, &ray);
    return ray;
}

/*
 * With small integers, points that are not exactly on an edge are far enough from it for double, and exact volumes tell
 * the side.
 */
static void test_integers(void **state)
{
    (void)state;
    struct random random = {1};
    int hits = 0, misses = 0;
    for (int i = 0; i < 200000; i++) {
        int64_t origin[3], direction[3], corners[3][3], from_origin[3][3];
        double o[3], d[3];
        float v[3][3];
        for (int axis = 0; axis < 3; axis++) {
            o[axis] = (double)(origin[axis] = random_integer(&random, 8));
            d[axis] = (double)(direction[axis] = random_integer(&random, 100));
            for (int k = 0; k < 3; k++) {
                v[k][axis] = (float)(corners[k][axis] = random_integer(&random, i % 2 ? 400 : 20));
                from_origin[k][axis] = corners[k][axis] - origin[axis];
            }
        }
        if (d[0] == 0 && d[1] == 0 && d[2] == 0)
            continue;
        wide_integer sides[3], sum = 0;
        for (int k = 0; k < 3; k++)
            sum += sides[k] = volume(direction, from_origin[(k + 1) % 3], from_origin[(k + 2) % 3]);
        if (sides[0] == 0 || sides[1] == 0 || sides[2] == 0)
            continue;
        bool expected = (sides[0] > 0) == (sides[1] > 0) && (sides[1] > 0) == (sides[2] > 0);
        struct triangle_ray ray = make_ray(o, d);
        struct triangle_hit hit;
        assert_int_equal(triangle_intersect(&ray, v[0], v[1], v[2], &hit), expected);
        hits += expected;
        misses += !expected;
        if (!expected)
            continue;
        assert_int_equal(hit.front, sum < 0);
        double u = (double)sides[1] / (double)sum, w = (double)sides[2] / (double)sum;
        assert_true(fabs(hit.u - u) < 1e-12 && fabs(hit.v - w) < 1e-12);
        for (int axis = 0; axis < 3; axis++) {
            double point = (1 - u - w) * v[0][axis] + u * v[1][axis] + w * v[2][axis];
            assert_true(fabs(o[axis] + hit.t * d[axis] - point) < 1e-8);
        }
    }
    assert_true(hits > 10000 && misses > 10000);
}

/* Vertices that are counterclockwise around a normal that points against the ray are a front face. */
static void test_facing(void **state)
{
    (void)state;
    const float a[3] = {0, 0, 0}, b[3] = {1, 0, 0}, c[3] = {0, 1, 0};
    for (int axis = 0; axis < 3; axis++)
        for (int sign = -1; sign <= 1; sign += 2) {
            float rotated[3][3];
            const float *corners[3] = {a, b, c};
            double origin[3], direction[3] = {0.1, 0.1, 0.1};
            for (int k = 0; k < 3; k++)
                for (int i = 0; i < 3; i++)
                    rotated[k][(i + axis + 1) % 3] = corners[k][i];
            direction[axis] = sign;
            for (int i = 0; i < 3; i++)
                origin[i] = (i == axis ? 0 : 0.25) - 2 * direction[i];
            struct triangle_ray ray = make_ray(origin, direction);
            struct triangle_hit hit;
            assert_true(triangle_intersect(&ray, rotated[0], rotated[1], rotated[2], &hit));
            assert_int_equal(hit.front, sign < 0);
            assert_true(fabs(hit.t - 2) < 1e-15);
            assert_true(triangle_intersect(&ray, rotated[0], rotated[2], rotated[1], &hit));
            assert_int_equal(hit.front, sign > 0);
        }
}

enum { FAN_MAX = 24 };

struct fan {
    float centre[3];
    float rim[FAN_MAX][3];
    int count;
};

/* Makes a closed fan around a centre that faces along `axis`. */
static void make_fan(struct random *random, int axis, double offset, double size, struct fan *ret_fan)
{
    ret_fan->count = 3 + (int)random_between(random, 0, FAN_MAX - 3);
    double centre[3];
    random_point(random, centre);
    for (int i = 0; i < 3; i++)
        ret_fan->centre[i] = (float)(offset * centre[i]);
    for (int k = 0; k < ret_fan->count; k++) {
        double angle = 2 * M_PI * (k + random_between(random, 0.01, 0.5)) / ret_fan->count,
               radius = random_between(random, 0.2, 1);
        double at[3] = {radius * cos(angle), radius * sin(angle), random_between(random, -0.1, 0.1)};
        for (int i = 0; i < 3; i++)
            ret_fan->rim[k][(i + axis + 1) % 3] = (float)(ret_fan->centre[(i + axis + 1) % 3] + size * at[i]);
    }
}

static int count_fan_hits(const struct fan *fan, const struct triangle_ray *ray)
{
    int hits = 0;
    for (int k = 0; k < fan->count; k++) {
        struct triangle_hit hit;
        const float *a = fan->centre, *b = fan->rim[k], *c = fan->rim[(k + 1) % fan->count];
        const float *orders[3][3] = {{a, b, c}, {b, c, a}, {c, a, b}};
        const float **order = orders[k % 3];
        hits += triangle_intersect(ray, order[0], order[1], order[2], &hit);
    }
    return hits;
}

/*
 * Rays exactly through shared vertices and points of shared edges hit one triangle of the fan each time, whatever the
 * rounding.
 */
static void test_closed_fans(void **state)
{
    (void)state;
    struct random random = {2};
    for (int i = 0; i < 30000; i++) {
        struct fan fan;
        int axis = i % 3;
        make_fan(&random, axis, i % 4 ? 1 : 1000, i % 5 ? 1 : 0.01, &fan);
        double target[3], direction[3], origin[3], along = i % 2 ? 0 : random_between(&random, 0, 0.9);
        int spoke = (int)random_between(&random, 0, fan.count);
        random_point(&random, direction);
        for (int k = 0; k < 3; k++)
            target[k] = (float)(fan.centre[k] + along * ((double)fan.rim[spoke][k] - fan.centre[k]));
        for (int k = 0; k < 3; k++)
            direction[k] = k == axis ? (i % 7 ? 1 : -1) : (i % 11 ? direction[k] * 0.3 : 0);
        for (int k = 0; k < 3; k++)
            origin[k] = i % 3 ? (float)(target[k] - 10 * direction[k]) : target[k] - 10 * direction[k];
        struct triangle_ray ray = make_ray(origin, direction);
        assert_int_equal(count_fan_hits(&fan, &ray), 1);
    }
}

/*
 * Rays in the plane of two axes through a lattice, where edge functions of many triangles are exactly 0. Each cell is
 * hit once.
 */
static void test_lattice(void **state)
{
    (void)state;
    enum { SIDE = 6 };
    for (int axis = 0; axis < 3; axis++)
        for (int x = 1; x < 2 * SIDE; x++)
            for (int y = 1; y < 2 * SIDE; y++) {
                double origin[3], direction[3] = {0, 0, 0};
                int hits = 0;
                direction[axis] = x % 2 ? -1 : 1;
                origin[axis] = -3 * direction[axis];
                origin[(axis + 1) % 3] = x * 0.5;
                origin[(axis + 2) % 3] = y * 0.5;
                struct triangle_ray ray = make_ray(origin, direction);
                for (int cell = 0; cell < SIDE * SIDE; cell++) {
                    float corners[4][3];
                    for (int k = 0; k < 4; k++) {
                        corners[k][axis] = 0;
                        corners[k][(axis + 1) % 3] = (float)(cell % SIDE + (k & 1));
                        corners[k][(axis + 2) % 3] = (float)(cell / SIDE + (k >> 1));
                    }
                    struct triangle_hit hit;
                    hits += triangle_intersect(&ray, corners[0], corners[1], corners[3], &hit);
                    hits += triangle_intersect(&ray, corners[0], corners[3], corners[2], &hit);
                }
                assert_int_equal(hits, 1);
            }
}

/*
 * Any whole line enters a closed surface as often as it leaves it. The surface is a crumpled torus of random vertices;
 * the lines pass through vertices, points of edges, and arbitrary points. Counting front and back hits finds every leak
 * and every double hit.
 */
static void test_closed_surface(void **state)
{
    (void)state;
    enum { SIDE = 12 };
    struct random random = {3};
    float vertices[SIDE * SIDE][3];
    for (int round = 0; round < 150; round++) {
        for (int i = 0; i < SIDE * SIDE; i++)
            for (int axis = 0; axis < 3; axis++)
                vertices[i][axis] =
                    (float)(round % 3 ? random_between(&random, -1, 1) : floor(random_between(&random, -4, 4)));
        for (int i = 0; i < 20; i++) {
            const float *a = vertices[(int)random_between(&random, 0, SIDE * SIDE)];
            const float *b = vertices[(int)random_between(&random, 0, SIDE * SIDE)];
            double origin[3], direction[3];
            random_point(&random, origin);
            for (int axis = 0; axis < 3; axis++) {
                origin[axis] = i % 3 == 0   ? (float)(4 * origin[axis])
                               : i % 3 == 1 ? b[axis]
                                            : (float)(0.5 * (a[axis] + b[axis]));
                direction[axis] = i % 4 ? a[axis] - origin[axis] : random_between(&random, -1, 1);
            }
            if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
                continue;
            struct triangle_ray ray = make_ray(origin, direction);
            int balance = 0, hits = 0;
            for (int x = 0; x < SIDE; x++)
                for (int y = 0; y < SIDE; y++) {
                    const float *q[4];
                    struct triangle_hit hit;
                    for (int k = 0; k < 4; k++)
                        q[k] = vertices[(x + (k & 1)) % SIDE + SIDE * ((y + (k >> 1)) % SIDE)];
                    if (triangle_intersect(&ray, q[0], q[1], q[3], &hit))
                        hits++, balance += hit.front ? 1 : -1;
                    if (triangle_intersect(&ray, q[0], q[3], q[2], &hit))
                        hits++, balance += hit.front ? 1 : -1;
                }
            assert_int_equal(balance, 0);
            assert_int_equal(hits % 2, 0);
        }
    }
}

/* The answers are the same at every power of two that float has, up to the scale. */
static void test_magnitudes(void **state)
{
    (void)state;
    struct random random = {4};
    for (int i = 0; i < 2000; i++) {
        double origin[3], direction[3];
        float corners[3][3];
        for (int axis = 0; axis < 3; axis++) {
            origin[axis] = floor(random_between(&random, -128, 128));
            direction[axis] = floor(random_between(&random, -128, 128));
            for (int k = 0; k < 3; k++)
                corners[k][axis] = floorf((float)random_between(&random, -128, 128));
        }
        direction[i % 3] = 200;
        struct triangle_ray ray = make_ray(origin, direction);
        struct triangle_hit expected, hit;
        bool is_hit = triangle_intersect(&ray, corners[0], corners[1], corners[2], &expected);
        for (int exponent = -149; exponent <= 119; exponent += 4) {
            double scaled_origin[3];
            float scaled[3][3];
            for (int axis = 0; axis < 3; axis++) {
                scaled_origin[axis] = ldexp(origin[axis], exponent);
                for (int k = 0; k < 3; k++)
                    scaled[k][axis] = ldexpf(corners[k][axis], exponent);
            }
            ray = make_ray(scaled_origin, direction);
            assert_int_equal(triangle_intersect(&ray, scaled[0], scaled[1], scaled[2], &hit), is_hit);
            if (is_hit)
                assert_true(hit.t == ldexp(expected.t, exponent) && hit.u == expected.u && hit.v == expected.v);
        }
    }
}

/* Triangles without area or seen edge-on are never hit, nor are those with NaN or infinite corners. */
static void test_degenerate(void **state)
{
    (void)state;
    const float a[3] = {0, 0, 0}, b[3] = {1, 1, 1}, c[3] = {2, 2, 2}, d[3] = {1, 0, 0}, e[3] = {0, 1, 0};
    const float nan[3] = {NAN, 0, 0}, inf[3] = {0, INFINITY, 0}, big[3] = {FLT_MAX, -FLT_MAX, FLT_MAX};
    const float *const triangles[][3] = {{a, a, a},   {a, b, b},   {a, b, c},   {b, a, b},
                                         {nan, d, e}, {a, nan, e}, {a, d, inf}, {inf, inf, e}};
    struct random random = {5};
    struct triangle_hit hit;
    for (int i = 0; i < 2000; i++) {
        double origin[3], direction[3];
        random_point(&random, origin);
        for (int k = 0; k < 3; k++)
            direction[k] = i % 2 ? 0.5 - origin[k] : random_between(&random, -1, 1);
        struct triangle_ray ray = make_ray(origin, direction);
        for (size_t k = 0; k < sizeof triangles / sizeof *triangles; k++)
            assert_false(triangle_intersect(&ray, triangles[k][0], triangles[k][1], triangles[k][2], &hit));
        triangle_intersect(&ray, big, d, e, &hit);
    }
    struct triangle_ray in_plane = make_ray((double[]){-1, 0.25, 0}, (double[]){1, 0, 0});
    assert_false(triangle_intersect(&in_plane, a, d, e, &hit));
}

/* For slivers that are nearly edge-on, every reported hit is a point of the triangle. */
static void test_slivers(void **state)
{
    (void)state;
    struct random random = {6};
    int hits = 0;
    for (int i = 0; i < 100000; i++) {
        double a[3], b[3], direction[3], origin[3], thin = pow(10, random_between(&random, -9, -3));
        float corners[3][3];
        random_point(&random, a);
        random_point(&random, b);
        for (int axis = 0; axis < 3; axis++) {
            corners[0][axis] = (float)a[axis];
            corners[1][axis] = (float)b[axis];
            corners[2][axis] = (float)(0.3 * a[axis] + 0.7 * b[axis] + thin * random_between(&random, -1, 1));
        }
        random_point(&random, origin);
        for (int axis = 0; axis < 3; axis++) {
            double point = ((double)corners[0][axis] + corners[1][axis] + corners[2][axis]) / 3;
            direction[axis] = i % 2 ? point - origin[axis] : (double)corners[1][axis] - corners[0][axis];
            origin[axis] = i % 2 ? origin[axis] : point - 2 * direction[axis];
        }
        struct triangle_ray ray = make_ray(origin, direction);
        struct triangle_hit hit;
        if (!triangle_intersect(&ray, corners[0], corners[1], corners[2], &hit))
            continue;
        hits++;
        assert_true(hit.u >= 0 && hit.v >= 0 && hit.u + hit.v <= 1 + 1e-15);
        for (int axis = 0; axis < 3; axis++) {
            double point = corners[0][axis] + hit.u * ((double)corners[1][axis] - corners[0][axis]) +
                           hit.v * ((double)corners[2][axis] - corners[0][axis]);
            assert_true(fabs(origin[axis] + hit.t * direction[axis] - point) < 1e-14);
        }
    }
    assert_true(hits > 10000);
}

#ifdef BOXTEST_AVX2

static BOXTEST_AVX2 bool intersect_avx2(const struct triangle_ray *ray, const float corners[3][4],
                                        struct triangle_hit *ret_hit)
{
    const float *const vertices[3] = {corners[0], corners[1], corners[2]};
    struct triangle_avx2_ray wide;
    triangle_avx2_spread(ray, &wide);
    return triangle_avx2_intersect(&wide, ray, vertices, ret_hit);
}

/* Stores the result of triangle_avx2_init() for a ray in float. */
static BOXTEST_AVX2 void init_avx2(const float origin[4], const float direction[4], struct triangle_ray *ret_ray,
                                   double ret_spread[2][3][4])
{
    struct triangle_avx2_ray wide;
    triangle_avx2_init(_mm_loadu_ps(origin), _mm_loadu_ps(direction), ret_ray, &wide);
    for (int k = 0; k < 3; k++) {
        _mm256_storeu_pd(ret_spread[0][k], wide.origin[k]);
        _mm256_storeu_pd(ret_spread[1][k], wide.shear[k]);
    }
    assert_memory_equal(&wide.order, ret_ray->axis, sizeof wide.order);
}

/*
 * Returns one of few numbers, so that edges are met and areas vanish; or any number, from the smallest to the largest,
 * sometimes not finite.
 */
static double draw(struct random *random, int kind)
{
    static const double special[] = {0, -0.0, 1, -1, 0x1p-149, FLT_MAX, -FLT_MAX, INFINITY, NAN};
    if (kind == 0)
        return floor(random_between(random, -3, 4));
    if (kind == 1)
        return random_between(random, -1, 1);
    if (kind == 2)
        return ldexp(random_between(random, -1, 1), (int)random_between(random, -149, 127));
    return special[random_next(random) % (sizeof special / sizeof *special)];
}

/* The AVX2 version gives the same bits. */
static void test_avx2(void **state)
{
    (void)state;
    struct random random = {7};
    int hits = 0;
    for (int i = 0; i < 1000000 && boxtest_has_avx2(); i++) {
        int kind = i % 16 == 0 ? 3 : i % 8 == 1 ? 2 : i % 2;
        double origin[3], direction[3];
        float corners[3][4];
        struct triangle_hit wide = {.t = 0}, hit = {.t = 0};
        for (int axis = 0; axis < 3; axis++) {
            origin[axis] = (float)draw(&random, kind);
            direction[axis] = kind == 3 ? random_between(&random, -1, 1) : draw(&random, kind);
            for (int k = 0; k < 3; k++)
                corners[k][axis] = (float)draw(&random, kind);
        }
        corners[i % 3][3] = corners[(i + 1) % 3][3] = corners[(i + 2) % 3][3] = NAN;
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
            continue;
        struct triangle_ray ray = make_ray(origin, direction);
        bool is_hit = triangle_intersect(&ray, corners[0], corners[1], corners[2], &hit);
        assert_int_equal(intersect_avx2(&ray, (const float(*)[4])corners, &wide), is_hit);
        hits += is_hit;
        if (is_hit && isfinite(hit.t))
            assert_true(wide.t == hit.t && wide.u == hit.u && wide.v == hit.v && wide.front == hit.front);
    }
    assert_true(hits > 50000 || !boxtest_has_avx2());
}

/* A ray that is known in float gives the same numbers in both ways. */
static void test_avx2_init(void **state)
{
    (void)state;
    struct random random = {8};
    for (int i = 0; i < 200000 && boxtest_has_avx2(); i++) {
        float origin[4] = {0, 0, 0, NAN}, direction[4] = {0, 0, 0, INFINITY};
        double wide_origin[3], wide_direction[3], spread[2][3][4];
        struct triangle_ray wide;
        for (int axis = 0; axis < 3; axis++) {
            wide_origin[axis] = origin[axis] = (float)draw(&random, i % 3);
            wide_direction[axis] = direction[axis] = (float)draw(&random, i % 3);
        }
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
            continue;
        struct triangle_ray ray = make_ray(wide_origin, wide_direction);
        init_avx2(origin, direction, &wide, spread);
        assert_memory_equal(wide.axis, ray.axis, sizeof ray.axis);
        for (int k = 0; k < 3; k++) {
            assert_true(wide.origin[k] == ray.origin[k] && wide.shear[k] == ray.shear[k]);
            for (int lane = 0; lane < 4; lane++)
                assert_true(spread[0][k][lane] == ray.origin[k] && spread[1][k][lane] == ray.shear[k]);
        }
    }
}

#else

static void test_avx2_init(void **state)
{
    (void)state;
}

static void test_avx2(void **state)
{
    (void)state;
    skip();
}

#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_integers),   cmocka_unit_test(test_facing),         cmocka_unit_test(test_closed_fans),
        cmocka_unit_test(test_lattice),    cmocka_unit_test(test_closed_surface), cmocka_unit_test(test_magnitudes),
        cmocka_unit_test(test_degenerate), cmocka_unit_test(test_slivers),        cmocka_unit_test(test_avx2),
        cmocka_unit_test(test_avx2_init),
    };
    return cmocka_run_group_tests_name("triangle", tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_sphere.c - tests the test of spheres against quadratic equations in quadruple precision and in integers. */
#include "tests/support/unit.h"

#include "builder/traverse/sphere.h"
#include "tests/support/builder/round_judge.h"
#include "tests/support/random.h"

static double magnitude(struct random *random, double low, double high)
{
    return pow(10, random_between(random, low, high));
}

static bool meets(const double origin[3], const double direction[3], double tmin, const float sphere[4], double *ret_t)
{
    struct round_ray ray;
    round_ray_init(origin, direction, tmin, &ray);
    return sphere_intersect(&ray, sphere, ret_t) && *ret_t > tmin;
}

static void test_random(void **state)
{
    (void)state;
    enum { ATTEMPTS = 1000000, MANNERS = 8 };
    struct random random = {3};
    unsigned sure = 0, hits = 0;
    for (unsigned i = 0; i < ATTEMPTS; i++) {
        const unsigned manner = i % MANNERS;
        const double scale = manner == 1   ? 1e30
                             : manner == 2 ? magnitude(&random, -25, 25)
                                           : 1,
                     away = manner == 3   ? magnitude(&random, 1, 15)
                            : manner == 4 ? 1.0001
                                          : 3,
                     speed = manner == 5 ? magnitude(&random, -25, 25) : 1;
        double centre[3], from[3], to[3], origin[3], direction[3], t = 0;
        float sphere[4];
        random_point(&random, centre);
        random_point(&random, from);
        random_point(&random, to);
        const double radius = manner == 6 ? magnitude(&random, -20, 0) : random_between(&random, 0.1, 2),
                     length = sqrt(from[0] * from[0] + from[1] * from[1] + from[2] * from[2]);
        sphere[3] = (float)(scale * radius);
        for (int k = 0; k < 3; k++) {
            sphere[k] = (float)(scale * centre[k]);
            origin[k] = sphere[k] + scale * (manner == 4 ? radius / length : 1) * away * from[k];
            direction[k] = speed * ((sphere[k] - origin[k]) / scale + 1.2 * radius * to[k]);
        }
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
            continue;
        const double tmin = i / MANNERS % 4 == 0 ? -INFINITY : 0;
        const struct round_answer answer = round_judge_sphere(origin, direction, tmin, INFINITY, sphere);
        if (answer.is_doubtful)
            continue;
        sure++;
        const bool is_hit = meets(origin, direction, tmin, sphere, &t);
        if (is_hit != answer.is_hit)
            fail_msg("attempt %u: %d instead of %d at %g", i, is_hit, answer.is_hit, (double)answer.t);
        if (is_hit && round_judge_size(t - answer.t) > (quad)round_distance_error * round_judge_size(answer.t))
            fail_msg("attempt %u: %.17g instead of %.17g", i, t, (double)answer.t);
        hits += is_hit;
    }
    print_message("%u certain, %u hits\n", sure, hits);
    assert_true(sure > ATTEMPTS / 1000 * 990 && hits > ATTEMPTS / 4);
}

static int64_t integer(struct random *random, int limit)
{
    return (int64_t)floor(random_between(random, -limit, limit + 1));
}

/* Small integers make many tangent rays, which hit, and many that begin on the surface, where t is 0. */
static void test_integers(void **state)
{
    (void)state;
    enum { ATTEMPTS = 1000000 };
    struct random random = {9};
    unsigned tangent = 0, on_surface = 0;
    for (unsigned i = 0; i < ATTEMPTS; i++) {
        int64_t f[3], d[3], ff = 0, fd = 0, dd = 0, far = i % 2 ? 1 << 20 : 0;
        double origin[3], direction[3], t = 1;
        const float sphere[4] = {(float)far, 1, -2, (float)(1 + random_next(&random) % 6)};
        for (int k = 0; k < 3; k++) {
            f[k] = integer(&random, 7);
            d[k] = integer(&random, 3);
            origin[k] = sphere[k] - (double)f[k];
            direction[k] = (double)d[k];
            ff += f[k] * f[k];
            fd += f[k] * d[k];
            dd += d[k] * d[k];
        }
        if (dd == 0)
            continue;
        const int64_t r = (int64_t)sphere[3], discriminant = fd * fd - dd * (ff - r * r);
        assert_int_equal(meets(origin, direction, -INFINITY, sphere, &t), discriminant >= 0);
        if (discriminant < 0)
            continue;
        const double root = ((double)fd - sqrt((double)discriminant)) / (double)dd;
        assert_true(fabs(t - root) <= 1e-12);
        tangent += discriminant == 0;
        if (ff == r * r && fd >= 0) {
            assert_true(t == 0);
            on_surface++;
        }
    }
    assert_true(tangent > 1000 && on_surface > 1000);
}

/* Spheres of no size or no place, and infinite ones, are never met, by rays that point at their centres either. */
static void test_degenerate(void **state)
{
    (void)state;
    const float spheres[][4] = {{0, 0, 0, 0},
                                {0, 0, 0, -1},
                                {0, 0, 0, NAN},
                                {NAN, 0, 0, 1},
                                {0, 0, 0, INFINITY},
                                {INFINITY, 0, 0, 1},
                                {0, -INFINITY, 0, INFINITY}};
    const double origin[3] = {-3, 0, 0}, direction[3] = {1, 0, 0};
    for (size_t i = 0; i < sizeof spheres / sizeof *spheres; i++) {
        double t;
        assert_false(meets(origin, direction, 0, spheres[i], &t));
        assert_false(meets(origin, direction, -INFINITY, spheres[i], &t));
    }
    const float sphere[4] = {0, 0, 0, 1};
    double t;
    assert_true(meets(origin, direction, 0, sphere, &t) && t == 2);
    assert_false(meets((double[3]){0.5, 0, 0}, direction, 0, sphere, &t)); /* from inside */
    assert_false(meets((double[3]){-1, 0, 0}, direction, 0, sphere, &t)); /* from the surface, where t is 0 */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random),
        cmocka_unit_test(test_integers),
        cmocka_unit_test(test_degenerate),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

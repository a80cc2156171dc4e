/* SPDX-License-Identifier: Apache-2.0 */
/* test_swept_sphere.c - tests the test of linear swept spheres against their definition, in quadruple precision. */
#include "tests/support/unit.h"

#include "builder/traverse/swept_sphere.h"
#include "tests/support/builder/round_judge.h"
#include "tests/support/random.h"

/* A shape and a ray. */
struct attempt {
    float ends[2][4];
    unsigned caps;
    double origin[3], direction[3], tmin;
};

/* Returns 10 to a random power. */
static double magnitude(struct random *random, double low, double high)
{
    return pow(10, random_between(random, low, high));
}

/* Makes a shape of some kind: ordinary, tiny, huge, flat, swallowed, pointed, a ball, of integers. */
static void make_shape(struct random *random, unsigned kind, struct attempt *attempt)
{
    double centre[3], way[3], radius = random_between(random, 0.1, 1), taper = random_between(random, -1, 1), scale = 1,
                              length = 0;
    random_point(random, centre);
    random_point(random, way);
    if (kind == 1)
        radius *= magnitude(random, -12, 0);
    if (kind == 2)
        scale = 1e30;
    if (kind == 3)
        scale = magnitude(random, -25, 25);
    for (int k = 0; k < 3; k++)
        length += way[k] * way[k];
    length = sqrt(length);
    double second = radius * (1 + 0.9 * taper);
    if (kind == 4) /* the side is nearly flat */
        second = radius + (taper > 0 ? 1 : -1) * length * (1 - magnitude(random, -6, -1));
    if (kind == 5)
        second = radius + 2 * length * taper; /* one end often swallows the other */
    if (kind == 6)
        *(taper > 0 ? &second : &radius) = 0;
    if (second < 0) {
        radius -= second;
        second = 0;
    }
    for (int k = 0; k < 3; k++) {
        attempt->ends[0][k] = (float)(scale * centre[k]);
        attempt->ends[1][k] = (float)(scale * (centre[k] + (kind == 7 ? 0 : way[k])));
    }
    attempt->ends[0][3] = (float)(scale * radius);
    attempt->ends[1][3] = (float)(scale * second);
    attempt->caps = (unsigned)random_next(random) % 4;
    if (kind == 8)
        for (int end = 0; end < 2; end++)
            for (int k = 0; k < 4; k++)
                attempt->ends[end][k] = (float)floor(random_between(random, k == 3 ? 0 : -9, 9.9));
}

/* Returns the radius of the whole shape around the middle. */
static double find_middle(const struct attempt *attempt, double ret_middle[3])
{
    double squared = 0;
    for (int k = 0; k < 3; k++) {
        const double half = ((double)attempt->ends[1][k] - attempt->ends[0][k]) / 2;
        ret_middle[k] = attempt->ends[0][k] + half;
        squared += half * half;
    }
    return sqrt(squared) + fmax(attempt->ends[0][3], attempt->ends[1][3]);
}

/* Aims a ray at the shape: from near, from far, along its axis, from inside, from an integer. */
static void make_ray(struct random *random, unsigned kind, struct attempt *attempt)
{
    double middle[3], from[3], to[3];
    const double size = find_middle(attempt, middle),
                 away = kind == 1   ? magnitude(random, 3, 9)
                        : kind == 2 ? 0.5
                                    : random_between(random, 1, 10),
                 speed = kind == 3 ? magnitude(random, -20, 20) : 1, near = random_next(random) % 4 == 0 ? 0.01 : 1;
    random_point(random, from);
    random_point(random, to);
    for (int k = 0; k < 3; k++) {
        attempt->origin[k] = middle[k] + size * away * from[k];
        const double target = middle[k] + size * near * to[k];
        attempt->direction[k] = speed * (target - attempt->origin[k]) / size;
        if (kind == 4) /* along the axis */
            attempt->direction[k] = (attempt->ends[1][k] - attempt->ends[0][k]) / size + 1e-3 * to[k] * near;
        if (kind == 5) {
            attempt->origin[k] = floor(random_between(random, -20, 20.9));
            attempt->direction[k] = floor(random_between(random, -9, 9.9));
        }
        if (kind == 6)
            attempt->direction[k] *= random_next(random) % 2; /* often parallel to an axis */
    }
    if (attempt->direction[0] == 0 && attempt->direction[1] == 0 && attempt->direction[2] == 0)
        attempt->direction[0] = 1;
    attempt->tmin = random_next(random) % 4 == 0 ? -INFINITY : 0;
}

static void fail_attempt(const struct attempt *a, const struct round_answer *answer, bool is_hit, double t, double u)
{
    for (int end = 0; end < 2; end++)
        print_error("end %a %a %a radius %a\n", (double)a->ends[end][0], (double)a->ends[end][1],
                    (double)a->ends[end][2], (double)a->ends[end][3]);
    print_error("caps %u, origin %a %a %a, direction %a %a %a, tmin %g\n", a->caps, a->origin[0], a->origin[1],
                a->origin[2], a->direction[0], a->direction[1], a->direction[2], a->tmin);
    fail_msg("expected %d t %.17g u %g, but %d t %.17g u %g", answer->is_hit, (double)answer->t, (double)answer->u,
             is_hit, t, u);
}

/* Returns whether the judge was certain. */
static bool check(const struct attempt *attempt, unsigned *hits)
{
    struct round_ray ray;
    struct swept_sphere_hit hit = {0, 0};
    const struct round_answer answer = round_judge_swept(attempt->origin, attempt->direction, attempt->tmin, INFINITY,
                                                         attempt->ends[0], attempt->ends[1], attempt->caps);
    if (answer.is_doubtful)
        return false;
    round_ray_init(attempt->origin, attempt->direction, attempt->tmin, &ray);
    bool is_hit =
        swept_sphere_intersect(&ray, attempt->ends[0], attempt->ends[1], attempt->caps, &hit) && hit.t > attempt->tmin;
    const quad limit = (quad)round_distance_error;
    if (is_hit != answer.is_hit ||
        (is_hit && (round_judge_size(hit.t - answer.t) > limit * round_judge_size(answer.t) ||
                    !(round_judge_size(hit.u - answer.u) < 1e-6L))))
        fail_attempt(attempt, &answer, is_hit, hit.t, hit.u);
    *hits += is_hit;
    return true;
}

static void test_random(void **state)
{
    (void)state;
    enum { ATTEMPTS = 1000000, SHAPES = 9, RAYS = 7 };
    struct random random = {5};
    unsigned sure = 0, hits = 0;
    for (unsigned i = 0; i < ATTEMPTS; i++) {
        struct attempt attempt;
        make_shape(&random, i % SHAPES, &attempt);
        make_ray(&random, i / SHAPES % RAYS, &attempt);
        sure += check(&attempt, &hits);
    }
    print_message("%u certain, %u hits\n", sure, hits);
    assert_true(sure > ATTEMPTS / 1000 * 985 && hits > ATTEMPTS / 6);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

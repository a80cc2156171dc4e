/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_oracle_round.c - tests the oracle's bounds for rays and round bodies against many copies with moved inputs, and
 * against cases whose answers are known.
 */
#include "tests/support/unit.h"

#include <float.h>

#include "client/bvhctl/oracle/oracle_filter.h"
#include "client/bvhctl/oracle/oracle_kind.h"
#include "proto/base/parallel.h"
#include "tests/support/builder/moved_round.h"

/* ---- bounds ---- */

struct specimen {
    float centres[2][3], radii[2], matrix[12];
    uint8_t caps;
    bool transformed, is_sphere;
    struct ray ray;
};

static double signed_unit(uint64_t *state)
{
    return 2 * rays_uniform(state) - 1;
}

/* Returns a point near the boundary of a part of the body, in its own space. */
static void aim(const struct specimen *s, uint64_t *state, double ret_point[3])
{
    double z = (double)(rays_random(state) % 3) / 2, beside[3], size = 0, radius;
    if (rays_random(state) % 2)
        z = 1.4 * rays_uniform(state) - 0.2;
    radius = (1 - z) * s->radii[0] + z * s->radii[1];
    for (int axis = 0; axis < 3; axis++) {
        beside[axis] = signed_unit(state);
        size += beside[axis] * beside[axis];
    }
    double reach = rays_random(state) % 2 ? 1 + 1e-7 * signed_unit(state) : 1.2 * rays_uniform(state);
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] =
            (1 - z) * s->centres[0][axis] + z * s->centres[1][axis] + reach * fabs(radius) * beside[axis] / sqrt(size);
}

/*
 * Makes a body of any shape, and a ray that is likely to pass near one of its boundaries: a silhouette, a circle where
 * a cap begins, or, as one sphere is often nearly in the other, where the side vanishes.
 */
static struct specimen make_specimen(double scale, double offset, uint64_t *state)
{
    struct specimen s = {.transformed = rays_random(state) % 3 == 0,
                         .is_sphere = rays_random(state) % 4 == 0,
                         .caps = (uint8_t)(rays_random(state) % 4)};
    double length = 0, towards[3], point[3], world[3];
    for (int k = 0; k < 12; k++)
        s.matrix[k] = (float)(signed_unit(state) + (k % 5 == 0 ? 2 : 0));
    for (int axis = 0; axis < 3; axis++) {
        s.centres[0][axis] = (float)(offset + scale * signed_unit(state));
        s.centres[1][axis] = (float)(offset + scale * signed_unit(state));
        length += pow((double)s.centres[1][axis] - s.centres[0][axis], 2);
    }
    double thick = pow(10, -4 * rays_uniform(state));
    for (int end = 0; end < 2; end++)
        s.radii[end] = (float)(scale * thick * rays_uniform(state));
    if (rays_random(state) % 4 == 0)
        s.radii[1] = (float)(s.radii[0] + sqrt(length) * (1 + 0.2 * signed_unit(state)));
    if (rays_random(state) % 8 == 0)
        s.radii[rays_random(state) % 2] = 0;
    aim(&s, state, point);
    for (int row = 0; row < 3; row++) {
        world[row] = s.transformed ? s.matrix[4 * row + 3] : point[row];
        for (int column = 0; s.transformed && column < 3; column++)
            world[row] += (double)s.matrix[4 * row + column] * point[column];
    }
    s.ray = (struct ray){.tmax = FLT_MAX};
    length = 0;
    for (int axis = 0; axis < 3; axis++) {
        s.ray.origin[axis] = (float)(offset + 5 * scale * signed_unit(state));
        towards[axis] = world[axis] - s.ray.origin[axis];
        length += towards[axis] * towards[axis];
    }
    for (int axis = 0; axis < 3; axis++)
        s.ray.direction[axis] = (float)(towards[axis] / sqrt(length));
    return s;
}

static const struct oracle_kind *kind_of(const struct specimen *s)
{
    return s->is_sphere ? &oracle_spheres : &oracle_swept_spheres;
}

static bool oracle_view(const struct specimen *s, union oracle_subject *ret_subject)
{
    const struct oracle_mesh mesh = {.positions = s->centres[0],
                                     .radii = s->radii,
                                     .caps = &s->caps,
                                     .primitive_count = 1,
                                     .transform = s->transformed ? s->matrix : NULL};
    return kind_of(s)->fetch(&mesh, 0, ret_subject);
}

/* Moves all inputs, and transforms the ray into the space of the body. */
static struct moved_round move(const struct specimen *s, uint64_t *state)
{
    struct moved_round m = {
        .caps = {s->is_sphere || s->caps & ORACLE_CAP_FIRST, s->is_sphere || s->caps & ORACLE_CAP_SECOND}};
    long double matrix[12], inverse[3][3], det = 0, origin[3], direction[3];
    for (int k = 0; k < 12; k++)
        matrix[k] = moved_value(s->matrix[k], state);
    for (int end = 0; end < 2; end++) {
        m.radii[end] = fmaxl(moved_value(s->radii[s->is_sphere ? 0 : end], state), 0);
        for (int axis = 0; axis < 3; axis++)
            m.centres[end][axis] = moved_value(s->centres[s->is_sphere ? 0 : end][axis], state);
    }
    if (s->is_sphere) {
        m.radii[1] = m.radii[0];
        memcpy(m.centres[1], m.centres[0], sizeof m.centres[1]);
    }
    for (int axis = 0; axis < 3; axis++) {
        m.origin[axis] = moved_value(s->ray.origin[axis], state);
        m.direction[axis] = moved_value(s->ray.direction[axis], state);
        origin[axis] = m.origin[axis] - matrix[4 * axis + 3];
        direction[axis] = m.direction[axis];
    }
    if (!s->transformed)
        return m;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            int a = (column + 1) % 3, b = (column + 2) % 3, c = (row + 1) % 3, d = (row + 2) % 3;
            inverse[row][column] = matrix[4 * a + c] * matrix[4 * b + d] - matrix[4 * a + d] * matrix[4 * b + c];
        }
    for (int k = 0; k < 3; k++)
        det += matrix[k] * inverse[k][0];
    for (int row = 0; row < 3; row++) {
        m.origin[row] = moved_dot(inverse[row], origin) / det;
        m.direction[row] = moved_dot(inverse[row], direction) / det;
    }
    return m;
}

/* Pairs of a scale and an offset; in the last ones an ulp is large compared with the bodies. */
static const double magnitudes[][2] = {{1, 0}, {1, 1000}, {1e-20, 0}, {1e30, 0}, {5e36, 0}, {1e-41, 0}, {1, 100000}};

enum { MAGNITUDES = sizeof magnitudes / sizeof magnitudes[0], SPECIMENS = 3000, MOVES = 12 };

static void presence_and_distance_hold_for_moved_inputs(void **state)
{
    (void)state;
    uint64_t random = 7;
    int counts[3] = {0, 0, 0};
    for (int i = 0; i < MAGNITUDES * SPECIMENS; i++) {
        struct specimen specimen = make_specimen(magnitudes[i % MAGNITUDES][0], magnitudes[i % MAGNITUDES][1], &random);
        union oracle_subject subject;
        struct oracle_ray ray;
        struct oracle_crossing crossing = {0};
        struct oracle_outline outline;
        if (!oracle_view(&specimen, &subject))
            continue;
        assert_int_equal(oracle_ray_init(&ray, &specimen.ray), ORACLE_RAY_GOOD);
        enum oracle_presence presence = kind_of(&specimen)->meet(&ray, &subject, &crossing, &outline);
        counts[presence]++;
        for (int k = 0; k < MOVES; k++) {
            struct moved_round moved = move(&specimen, &random);
            long double t = 0;
            bool hit = moved_round_meet(&moved, &t) && t > 0 && t < FLT_MAX;
            assert_false(presence == ORACLE_ABSENT && hit);
            assert_false(presence == ORACLE_SURE && !hit);
            if (hit) {
                assert_true(t >= crossing.low - crossing.shift && t <= crossing.high + crossing.shift);
                assert_true(crossing.t >= crossing.low && crossing.t <= crossing.high);
            }
        }
    }
    for (int presence = 0; presence < 3; presence++)
        assert_true(counts[presence] > MAGNITUDES * SPECIMENS / 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(presence_and_distance_hold_for_moved_inputs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

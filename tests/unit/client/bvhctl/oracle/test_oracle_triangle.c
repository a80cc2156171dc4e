/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/unit.h"

#include <float.h>

#include "tests/support/builder/moved.h"
#include "client/bvhctl/oracle/oracle_filter.h"
#include "client/bvhctl/oracle/oracle_kind.h"

/*
 * test_oracle_triangle.c - tests the oracle's bounds for a ray and a triangle against many copies with moved inputs,
 * which are computed in extended precision.
 */

struct specimen {
    float corners[3][3], matrix[12];
    bool transformed;
    struct ray ray;
};

/* Makes a triangle of any shape, and a ray that is likely to pass near one of its edges. */
static struct specimen make_specimen(double scale, double offset, uint64_t *state)
{
    struct specimen s = {.transformed = rays_random(state) % 2};
    double point[3] = {0, 0, 0}, weights[3] = {rays_uniform(state), rays_uniform(state), rays_uniform(state)};
    double thin = pow(10, -8 * rays_uniform(state)), sum = weights[0] + weights[1] + weights[2];
    int pinned = (int)(rays_random(state) % 6);
    for (int k = 0; k < 12; k++)
        s.matrix[k] = (float)(2 * rays_uniform(state) - 1);
    for (int k = 0; k < 3; k++) {
        double world[3], weight = pinned == k ? 1e-7 * (rays_uniform(state) - 0.5) : weights[k] / sum;
        for (int axis = 0; axis < 3; axis++)
            s.corners[k][axis] = (float)(offset + scale * (2 * rays_uniform(state) - 1) * (axis == 1 ? thin : 1));
        for (int row = 0; row < 3; row++) {
            world[row] = s.transformed ? s.matrix[4 * row + 3] : s.corners[k][row];
            for (int column = 0; s.transformed && column < 3; column++)
                world[row] += (double)s.matrix[4 * row + column] * s.corners[k][column];
            point[row] += weight * world[row];
        }
    }
    s.ray = (struct ray){.tmax = FLT_MAX};
    double towards[3], length = 0;
    for (int axis = 0; axis < 3; axis++) {
        s.ray.origin[axis] = (float)(offset + 3 * scale * (2 * rays_uniform(state) - 1));
        towards[axis] = point[axis] - s.ray.origin[axis];
        length += towards[axis] * towards[axis];
    }
    for (int axis = 0; axis < 3; axis++)
        s.ray.direction[axis] = (float)(towards[axis] / sqrt(length));
    return s;
}

static union oracle_subject oracle_view(const struct specimen *s)
{
    const struct oracle_mesh mesh = {
        .positions = s->corners[0], .primitive_count = 1, .transform = s->transformed ? s->matrix : NULL};
    struct oracle_moment moment;
    union oracle_subject subject;
    assert_true(oracle_moment_make(&mesh, 0, &moment));
    assert_true(oracle_triangles.fetch(&moment, 0, &subject));
    return subject;
}

static struct moved move(const struct specimen *s, uint64_t *state)
{
    struct moved moved;
    long double matrix[12];
    for (int k = 0; k < 12; k++)
        matrix[k] = moved_value(s->matrix[k], state);
    for (int k = 0; k < 3; k++) {
        long double corner[3];
        for (int axis = 0; axis < 3; axis++)
            corner[axis] = moved_value(s->corners[k][axis], state);
        for (int row = 0; row < 3; row++)
            moved.corners[k][row] =
                s->transformed ? moved_dot(matrix + 4 * row, corner) + matrix[4 * row + 3] : corner[row];
    }
    for (int axis = 0; axis < 3; axis++) {
        moved.origin[axis] = moved_value(s->ray.origin[axis], state);
        moved.direction[axis] = moved_value(s->ray.direction[axis], state);
    }
    return moved;
}

/* Pairs of a scale and an offset; in the last ones an ulp is large compared with the triangles. */
static const double magnitudes[][2] = {{1, 0}, {1, 1000}, {1e-20, 0}, {1e30, 0}, {5e36, 0}, {1e-42, 0}, {1, 100000}};

enum { MAGNITUDES = sizeof magnitudes / sizeof magnitudes[0], SPECIMENS = 3000, MOVES = 12 };

static void presence_and_distance_hold_for_moved_inputs(void **state)
{
    (void)state;
    uint64_t random = 7;
    int counts[3] = {0, 0, 0};
    for (int i = 0; i < MAGNITUDES * SPECIMENS; i++) {
        struct specimen specimen = make_specimen(magnitudes[i % MAGNITUDES][0], magnitudes[i % MAGNITUDES][1], &random);
        union oracle_subject subject = oracle_view(&specimen);
        struct oracle_ray ray;
        struct oracle_crossing crossing = {0};
        struct oracle_outline outline;
        assert_int_equal(oracle_ray_init(&ray, &specimen.ray), ORACLE_RAY_GOOD);
        enum oracle_presence presence = oracle_triangles.meet(&ray, &subject, &crossing, &outline);
        counts[presence]++;
        for (int k = 0; k < MOVES; k++) {
            struct moved moved = move(&specimen, &random);
            long double t = 0;
            bool hit = moved_meet(&moved, &t) && t > 0 && t < FLT_MAX;
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

static void the_filter_drops_nothing_that_may_be_met(void **state)
{
    (void)state;
    uint64_t random = 9;
    struct oracle_filter_block *block = malloc(sizeof *block);
    union oracle_subject *subjects = malloc(ORACLE_FILTER_BLOCK * sizeof *subjects);
    uint64_t kept = 0, met = 0, all = 0;
    for (int round = 0; round < 4 * MAGNITUDES; round++) {
        const double *magnitude = magnitudes[round % MAGNITUDES];
        struct specimen specimens[ORACLE_FILTER_BLOCK];
        uint32_t count = round % 2 ? ORACLE_FILTER_BLOCK : 1 + (uint32_t)(rays_random(&random) % ORACLE_FILTER_BLOCK);
        struct oracle_filter_ray filters[ORACLE_FILTER_BLOCK];
        double wobble = 0;
        for (uint32_t i = 0; i < count; i++) {
            specimens[i] = make_specimen(magnitude[0], magnitude[1], &random);
            subjects[i] = oracle_view(&specimens[i]);
            wobble = fmax(wobble, oracle_filter_ray_init(&filters[i], &specimens[i].ray));
        }
        oracle_filter_begin(block, wobble);
        for (uint32_t i = 0; i < count; i++) {
            double centre[3], radius;
            oracle_triangles.sphere(&subjects[i], centre, &radius);
            oracle_filter_add(block, centre, radius);
        }
        for (uint32_t i = 0; i < count; i++) {
            uint16_t near[ORACLE_FILTER_BLOCK];
            uint32_t near_count = oracle_filter_scan(block, &filters[i], near), at = 0;
            struct oracle_ray ray;
            oracle_ray_init(&ray, &specimens[i].ray);
            for (uint32_t k = 0; k < count; k++) {
                struct oracle_crossing crossing;
                struct oracle_outline outline;
                bool is_near = at < near_count && near[at] == k;
                bool is_met = oracle_triangles.meet(&ray, &subjects[k], &crossing, &outline) != ORACLE_ABSENT;
                assert_true(is_near || !is_met);
                at += is_near;
                kept += is_near;
                met += is_met;
                all++;
            }
            assert_int_equal(at, near_count);
        }
    }
    assert_true(met > 1000 && kept < all);
    free(block);
    free(subjects);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(presence_and_distance_hold_for_moved_inputs),
        cmocka_unit_test(the_filter_drops_nothing_that_may_be_met),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

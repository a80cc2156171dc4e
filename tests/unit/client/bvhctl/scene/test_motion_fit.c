/* SPDX-License-Identifier: Apache-2.0 */
/* test_motion_fit.c - tests that the motion is found from which a path was made, and how far others are from a path. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "client/bvhctl/scene/motion_fit.h"
#include "tests/support/random.h"

enum { STEPS = MOTION_FIT_STEPS };

/* A motion by the numbers of VkSRTDataNV, with names. */
struct srt {
    double upper[6], pivot[3], q[4], t[3];
};

static struct srt mix(const struct srt *a, const struct srt *b, double share)
{
    const double *from = (const double *)a, *to = (const double *)b;
    struct srt result;
    for (size_t i = 0; i < sizeof result / sizeof(double); i++)
        ((double *)&result)[i] = from[i] + share * (to[i] - from[i]);
    return result;
}

/* Moves a point: it is scaled, turned by two products of quaternions, and moved. */
static void move(const struct srt *srt, const double at[3], double ret[3])
{
    const double *u = srt->upper, *q = srt->q;
    const double p[3] = {u[0] * at[0] + u[1] * at[1] + u[2] * at[2] + srt->pivot[0],
                         u[3] * at[1] + u[4] * at[2] + srt->pivot[1], u[5] * at[2] + srt->pivot[2]};
    double c[3], square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    for (int i = 0; i < 3; i++)
        c[i] = q[(i + 1) % 3] * p[(i + 2) % 3] - q[(i + 2) % 3] * p[(i + 1) % 3] + q[3] * p[i];
    for (int i = 0; i < 3; i++)
        ret[i] = p[i] + 2 * (q[(i + 1) % 3] * c[(i + 2) % 3] - q[(i + 2) % 3] * c[(i + 1) % 3]) / square + srt->t[i];
}

/* Makes the matrix of a motion from where four points go. */
static struct gltf_matrix matrix_of(const struct srt *srt)
{
    struct gltf_matrix matrix;
    double origin[3], point[3];
    move(srt, (const double[3]){0, 0, 0}, origin);
    for (int column = 0; column < 4; column++) {
        const double unit[3] = {column == 0, column == 1, column == 2};
        move(srt, unit, point);
        for (int row = 0; row < 3; row++)
            matrix.at[4 * row + column] = column == 3 ? origin[row] : point[row] - origin[row];
    }
    return matrix;
}

static void make_path(const struct srt *start, const struct srt *end, struct motion_path *path)
{
    for (int i = 0; i <= STEPS; i++) {
        struct srt now = mix(start, end, (double)i / STEPS);
        path->at[i] = matrix_of(&now);
    }
}

static void make_box(struct random *random, struct motion_path *path)
{
    for (int i = 0; i < 3; i++) {
        path->low[i] = random_between(random, -2, 1);
        path->high[i] = path->low[i] + fabs(random_between(random, 0.5, 2));
    }
}

static struct srt make_srt(struct random *random, double angle, const double axis[3])
{
    struct srt srt = {
        .q = {axis[0] * sin(angle / 2), axis[1] * sin(angle / 2), axis[2] * sin(angle / 2), cos(angle / 2)}};
    for (int i = 0; i < 6; i++)
        srt.upper[i] = random_between(random, -0.4, 0.4) + (i == 0 || i == 3 || i == 5 ? 1.5 : 0);
    for (int i = 0; i < 3; i++)
        srt.t[i] = random_between(random, -3, 3);
    return srt;
}

static void make_axis(struct random *random, double ret[3])
{
    double length;
    do {
        for (int i = 0; i < 3; i++)
            ret[i] = random_between(random, -1, 1);
        length = sqrt(ret[0] * ret[0] + ret[1] * ret[1] + ret[2] * ret[2]);
    } while (length < 0.2);
    for (int i = 0; i < 3; i++)
        ret[i] /= length;
}

/* Measures a motion again: at each step, by random points of the box and by its corners. */
static double measure(struct random *random, const struct motion_path *path, const struct import_motion *motion)
{
    const float *a = motion->start, *b = motion->end;
    double greatest = 0;
    for (int n = 0; n < 40 * (STEPS + 1); n++) {
        double share = (double)(n % (STEPS + 1)) / STEPS, k[16], point[3], there[3], square = 0;
        for (int i = 0; i < 16; i++)
            k[i] = a[i] + share * ((double)b[i] - a[i]);
        for (int i = 0; i < 3; i++)
            point[i] = n / (STEPS + 1) < 8 ? (n / (STEPS + 1) >> i & 1 ? path->high[i] : path->low[i])
                                           : random_between(random, path->low[i], path->high[i]);
        const struct srt srt = {{k[0], k[1], k[2], k[4], k[5], k[7]},
                                {k[3], k[6], k[8]},
                                {k[9], k[10], k[11], k[12]},
                                {k[13], k[14], k[15]}};
        if (motion->kind == ORACLE_SRT)
            move(&srt, point, there);
        for (int row = 0; row < 3; row++) {
            const double *m = path->at[n % (STEPS + 1)].at + (ptrdiff_t)4 * row, *f = k + (ptrdiff_t)4 * row;
            if (motion->kind != ORACLE_SRT)
                there[row] = f[0] * point[0] + f[1] * point[1] + f[2] * point[2] + f[3];
            double off = m[0] * point[0] + m[1] * point[1] + m[2] * point[2] + m[3] - there[row];
            square += off * off;
        }
        greatest = fmax(greatest, sqrt(square));
    }
    return greatest;
}

static struct motion_fit fit(struct random *random, const struct motion_path *path)
{
    struct motion_fit found;
    assert_true(motion_fit(path, &found));
    assert_float_equal(found.distance, measure(random, path, &found.motion), 1e-9);
    assert_in_range(found.step, 0, STEPS);
    return found;
}

static void test_matrices(void **state)
{
    (void)state;
    struct random random = {5};
    for (int round = 0; round < 200; round++) {
        struct motion_path path;
        make_box(&random, &path);
        for (int i = 0; i < 12; i++) {
            path.at[0].at[i] = random_between(&random, -2, 2);
            path.at[STEPS].at[i] = random_between(&random, -2, 2);
            for (int k = 1; k < STEPS; k++)
                path.at[k].at[i] = path.at[0].at[i] + (path.at[STEPS].at[i] - path.at[0].at[i]) * k / STEPS;
        }
        struct motion_fit found = fit(&random, &path);
        assert_int_equal(found.motion.kind, ORACLE_MATRIX);
        assert_true(found.distance < 2e-6);
    }
}

/* What turns about any point, while it is scaled and moved, is found: mirrored or not, and either way round. */
static void test_turning(void **state)
{
    (void)state;
    struct random random = {6};
    for (int round = 0; round < 400; round++) {
        struct motion_path path;
        double axis[3], angle = random_between(&random, 0.3, round % 2 ? 3 : 1), pivot[3];
        make_box(&random, &path);
        make_axis(&random, axis);
        struct srt start = make_srt(&random, random_between(&random, -3, 3), axis), end = make_srt(&random, 0, axis);
        for (int i = 0; i < 3; i++)
            pivot[i] = random_between(&random, -9, 9) * (round % 4 > 1);
        memcpy(start.pivot, pivot, sizeof pivot);
        memcpy(end.pivot, pivot, sizeof pivot);
        const double turn[4] = {axis[0] * sin(angle / 2), axis[1] * sin(angle / 2), axis[2] * sin(angle / 2),
                                cos(angle / 2)};
        end.q[3] = start.q[3] * turn[3] - (start.q[0] * turn[0] + start.q[1] * turn[1] + start.q[2] * turn[2]);
        for (int i = 0; i < 3; i++)
            end.q[i] = start.q[3] * turn[i] + turn[3] * start.q[i]; /* about one axis, so that no product crosses */
        if (round % 8 > 5)
            start.upper[5] *= -1, end.upper[5] *= -1;
        for (int i = 0; i < 4 && round % 16 == 3; i++)
            end.q[i] = -end.q[i];
        make_path(&start, &end, &path);
        struct motion_fit found = fit(&random, &path);
        assert_int_equal(found.motion.kind, ORACLE_SRT);
        assert_true(found.distance < 2e-5);
    }
}

/* An even turn about a parent is nearly an SRT, and far from matrices. */
static void test_orbit(void **state)
{
    (void)state;
    struct random random = {7};
    struct motion_path path = {.low = {-1, -1, -1}, .high = {1, 1, 1}};
    for (int i = 0; i <= STEPS; i++) {
        const double angle = 0.7 * i / STEPS;
        path.at[i] = (struct gltf_matrix){
            {cos(angle), -sin(angle), 0, 10 * cos(angle), sin(angle), cos(angle), 0, 10 * sin(angle), 0, 0, 1, 3}};
    }
    struct motion_fit found = fit(&random, &path);
    assert_int_equal(found.motion.kind, ORACLE_SRT);
    assert_true(found.distance < 0.0155); /* the middle way between rotations is 0.00137 radians off; here at 11.05 */
    struct import_motion straight = {.kind = ORACLE_MATRIX};
    for (int i = 0; i < 12; i++) {
        straight.start[i] = (float)path.at[0].at[i];
        straight.end[i] = (float)path.at[STEPS].at[i];
    }
    assert_true(measure(&random, &path, &straight) > 0.5);
}

static void test_standing(void **state)
{
    (void)state;
    struct random random = {8};
    struct motion_path path = {.low = {0, 0, 0}, .high = {1, 1, 1}};
    for (int i = 0; i <= STEPS; i++)
        path.at[i] = gltf_matrix_identity;
    struct motion_fit found = fit(&random, &path);
    assert_int_equal(found.motion.kind, ORACLE_STILL);
    assert_true(found.distance == 0);
    path.at[5].at[7] = 2; /* there and back */
    found = fit(&random, &path);
    assert_int_equal(found.motion.kind, ORACLE_STILL);
    assert_float_equal(found.distance, 2, 1e-12);
    assert_int_equal(found.step, 5);
}

/* A scale that is 0 at one end is only possible as SRT; one that is 0 at both ends is not there. */
static void test_singular(void **state)
{
    (void)state;
    struct random random = {9};
    static const double axis[3] = {0, 0.6, 0.8};
    for (int round = 0; round < 24; round++) {
        struct motion_path path;
        make_box(&random, &path);
        struct srt start = make_srt(&random, 0.8, axis), end = make_srt(&random, 0.8, axis);
        for (int i = 0; i < 6; i++)
            if (round % 3 == 0 || (round % 3 == 1 && i < 3) || (round % 3 == 2 && i == 5))
                start.upper[i] = 0;
        if (round % 3 == 2)
            start.upper[2] = start.upper[4] = 0;
        struct srt first = round & 4 ? end : start, last = round & 4 ? start : end;
        make_path(&first, &last, &path);
        struct motion_fit found = fit(&random, &path);
        assert_int_equal(found.motion.kind, ORACLE_SRT);
        assert_true(found.distance < 1e-5);
        path.at[0] = path.at[STEPS];
        path.at[0].at[0] = path.at[0].at[4] = path.at[0].at[8] = 0;
        path.at[STEPS] = path.at[0];
        assert_false(motion_fit(&path, &found));
    }
}

/* A path that goes through what is no number has no SRT, and none of matrices if a scale is 0 at one end. */
static void test_not_there(void **state)
{
    (void)state;
    struct motion_path path = {.low = {0, 0, 0}, .high = {1, 1, 1}};
    struct motion_fit found;
    for (int end = 0; end <= STEPS; end += STEPS) {
        for (int i = 0; i <= STEPS; i++)
            path.at[i] = gltf_matrix_identity;
        path.at[end].at[5] = 0;
        assert_true(motion_fit(&path, &found));
        path.at[7].at[5] = NAN;
        assert_false(motion_fit(&path, &found));
    }
}

static void test_not_finite(void **state)
{
    (void)state;
    struct motion_path path = {.low = {0, 0, 0}, .high = {1, 1, 1}};
    struct motion_fit found;
    static const double wrong[] = {NAN, INFINITY, 1e300};
    for (int which = 0; which < 3; which++)
        for (int step = 0; step <= STEPS; step++) {
            for (int i = 0; i <= STEPS; i++)
                path.at[i] = gltf_matrix_identity;
            path.at[STEPS] = (struct gltf_matrix){{0, -1, 0, 1, 1, 0, 0, 0, 0, 0, 1, 0}};
            path.at[step].at[which] = wrong[which];
            bool is_end = step == 0 || step == STEPS;
            assert_int_equal(motion_fit(&path, &found), !is_end);
            if (!is_end) {
                assert_true(found.distance <= DBL_MAX && found.distance > 1e200);
                assert_int_equal(found.step, step);
            }
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_matrices),  cmocka_unit_test(test_turning),  cmocka_unit_test(test_orbit),
        cmocka_unit_test(test_standing),  cmocka_unit_test(test_singular), cmocka_unit_test(test_not_finite),
        cmocka_unit_test(test_not_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

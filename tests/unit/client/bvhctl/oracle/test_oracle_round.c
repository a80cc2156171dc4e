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
    static struct oracle_moment moment; /* of one subject at a time */
    return oracle_moment_make(&mesh, 0, &moment) && kind_of(s)->fetch(&moment, 0, ret_subject);
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

/* A transform that is almost singular can leave the kind in doubt about a ray that the filter has dropped. */
static void the_filter_drops_nothing_that_may_be_met(void **state)
{
    (void)state;
    uint64_t random = 9, met = 0, dropped = 0;
    struct oracle_filter_block *block = malloc(sizeof *block);
    for (int i = 0; i < MAGNITUDES * SPECIMENS; i++) {
        struct specimen specimen = make_specimen(magnitudes[i % MAGNITUDES][0], magnitudes[i % MAGNITUDES][1], &random);
        union oracle_subject subject;
        struct oracle_filter_ray filter;
        double centre[3], radius;
        uint16_t near[ORACLE_FILTER_BLOCK];
        if (!oracle_view(&specimen, &subject))
            continue;
        for (int axis = 0; i % 4 == 0 && axis < 3; axis++)
            specimen.ray.direction[axis] = (float)signed_unit(&random);
        oracle_filter_begin(block, oracle_filter_ray_init(&filter, &specimen.ray));
        kind_of(&specimen)->sphere(&subject, centre, &radius);
        oracle_filter_add(block, centre, radius);
        bool is_near = oracle_filter_scan(block, &filter, near) == 1;
        dropped += !is_near;
        for (int k = 0; k < MOVES; k++) {
            struct moved_round moved = move(&specimen, &random);
            long double t;
            bool is_met = moved_round_meet(&moved, &t);
            assert_true(is_near || !is_met);
            met += is_met;
        }
    }
    assert_true(met > MAGNITUDES * SPECIMENS && dropped > SPECIMENS / 2);
    free(block);
}

/* ---- known answers ---- */

/* Rays along an axis, which the bodies below are at right angles to or on. */
static struct ray along(int axis, float from, float x, float y, float z)
{
    struct ray ray = {.origin = {x, y, z}, .tmax = FLT_MAX, .cull_mask = 0xff};
    ray.origin[axis] = from;
    ray.direction[axis] = from < 0 ? 1 : -1;
    return ray;
}

static struct oracle_answer ask(const struct oracle_mesh *meshes, uint32_t count, struct ray ray)
{
    struct memory memory;
    struct oracle_answer answer, copy;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(oracle_trace(meshes, count, &ray, 1, &memory, &parallel_serial, NULL, NULL, &answer, NULL),
                     BVHD_OK);
    copy = answer;
    oracle_finish(&answer, 1, &memory);
    return copy;
}

static void assert_hit(const struct oracle_mesh *mesh, struct ray ray, double t)
{
    struct oracle_answer answer = ask(mesh, 1, ray);
    assert_int_equal(answer.outcome, ORACLE_HIT);
    assert_float_equal(answer.t, t, 1e-9);
    assert_true(answer.t_low <= t && answer.t_high >= t && answer.t_high - answer.t_low < 1e-4);
}

static void assert_outcome(const struct oracle_mesh *mesh, struct ray ray, enum oracle_outcome outcome)
{
    assert_int_equal(ask(mesh, 1, ray).outcome, outcome);
}

static struct oracle_mesh sphere_of(const float centre[3], const float *radius)
{
    return (struct oracle_mesh){.shape = ORACLE_SPHERES, .positions = centre, .radii = radius, .primitive_count = 1};
}

static void spheres_are_hit_from_outside(void **state)
{
    (void)state;
    static const float centre[3] = {1, 2, 3}, radius = 2, squeeze[12] = {3, 0, 0, 10, 0, 0.5f, 0, 0, 0, 0, 1, -3};
    struct oracle_mesh mesh = sphere_of(centre, &radius);
    assert_hit(&mesh, along(0, -10, 0, 2, 3), 9);
    assert_hit(&mesh, along(0, -10, 0, 3, 3), 11 - sqrt(3));
    assert_hit(&mesh, along(2, 20, 1, 2, 0), 15);
    assert_outcome(&mesh, along(0, -10, 0, 4.001f, 3), ORACLE_MISS);
    assert_outcome(&mesh, along(0, -10, 0, 4, 3), ORACLE_UNCERTAIN); /* a tangent */
    assert_outcome(&mesh, along(0, -0.5f, 0, 2, 3), ORACLE_MISS); /* from inside */
    assert_outcome(&mesh, along(0, 4, 0, 2, 3), ORACLE_HIT);
    assert_outcome(&mesh, along(0, 2.5f, 0, 2, 3), ORACLE_MISS);
    struct ray ray = along(0, -10, 0, 2, 3);
    ray.tmin = 9.5f; /* the exit is no hit */
    assert_outcome(&mesh, ray, ORACLE_MISS);
    ray.tmin = 9;
    assert_outcome(&mesh, ray, ORACLE_UNCERTAIN);
    ray.tmin = 0;
    ray.tmax = 8.9f;
    assert_outcome(&mesh, ray, ORACLE_MISS);
    ray.tmax = 10;
    ray.flags = RAY_CULL_FRONT_FACING; /* for triangles only */
    assert_outcome(&mesh, ray, ORACLE_HIT);
    mesh.transform = squeeze; /* an ellipsoid with its centre at 13 1 0 and radii of 6, 1 and 2 */
    assert_hit(&mesh, along(0, -10, 0, 1, 0), 17);
    assert_hit(&mesh, along(1, 10, 13, 0, 0), 8);
    assert_hit(&mesh, along(1, 10, 13, 0, 1), 9 - sqrt(0.75));
    assert_outcome(&mesh, along(1, 10, 19.01f, 0, 0), ORACLE_MISS);
}

static void what_cannot_be_hit_is_missed(void **state)
{
    (void)state;
    const float odd[] = {NAN, INFINITY, -INFINITY};
    for (int which = 0; which < 3; which++)
        for (int component = 0; component < 4; component++) {
            float values[8] = {0, 0, 0, 1, 1, 1, 1, 1}, radii[2];
            values[component] = odd[which];
            radii[0] = values[3];
            radii[1] = 1;
            float centres[6] = {values[0], values[1], values[2], 1, 0, 0};
            struct oracle_mesh mesh = sphere_of(centres, radii);
            assert_outcome(&mesh, along(0, -10, 0, 0.1f, 0), ORACLE_MISS);
            mesh.shape = ORACLE_SWEPT_SPHERES;
            assert_outcome(&mesh, along(0, -10, 0, 0.1f, 0), ORACLE_MISS);
        }
    static const float centres[6] = {0, 0, 0, 1, 0, 0}, none[2] = {0, -0.0f};
    struct oracle_mesh mesh = sphere_of(centres, none);
    assert_outcome(&mesh, along(0, -10, 0, 0, 0), ORACLE_MISS);
    mesh.shape = ORACLE_SWEPT_SPHERES;
    assert_outcome(&mesh, along(1, -10, 0.5f, 0, 0), ORACLE_MISS);
}

static struct oracle_mesh swept_of(const float centres[6], const float radii[2], const uint8_t *caps)
{
    return (struct oracle_mesh){
        .shape = ORACLE_SWEPT_SPHERES, .positions = centres, .radii = radii, .caps = caps, .primitive_count = 1};
}

static void swept_spheres_have_a_side_and_the_caps_that_they_have(void **state)
{
    (void)state;
    static const float centres[6] = {-2, 0, 0, 2, 0, 0}, equal[2] = {1, 1}, cone[2] = {2, 0};
    for (uint8_t caps = 0; caps < 4; caps++) {
        struct oracle_mesh mesh = swept_of(centres, equal, &caps);
        const enum oracle_outcome first = caps & ORACLE_CAP_FIRST ? ORACLE_HIT : ORACLE_MISS,
                                  second = caps & ORACLE_CAP_SECOND ? ORACLE_HIT : ORACLE_MISS;
        assert_hit(&mesh, along(1, 10, 1.5f, 0, 0), 9);
        assert_hit(&mesh, along(2, -10, -1.99f, 0.5f, 0), 10 - sqrt(0.75));
        assert_outcome(&mesh, along(1, 10, -2.01f, 0, 0), first);
        assert_outcome(&mesh, along(1, 10, 2.01f, 0, 0), second);
        assert_outcome(&mesh, along(1, 10, 3.01f, 0, 0), ORACLE_MISS);
        /* Through a missing cap the inner face is not hit, nor is the other cap from inside. */
        assert_outcome(&mesh, along(0, -10, 0, 0.5f, 0), first);
        assert_outcome(&mesh, along(0, 10, 0, 0.5f, 0), second);
        assert_outcome(&mesh, along(0, -10, 0, 1.01f, 0), ORACLE_MISS);
        assert_outcome(&mesh, along(1, 0.5f, 0, 0.5f, 0), ORACLE_MISS); /* from inside */
        if (caps == 3) {
            assert_hit(&mesh, along(0, -10, 0, 0.5f, 0), 8 - sqrt(0.75));
            assert_hit(&mesh, along(1, 10, 2, 0, 0), 9); /* where the side ends, and the cap begins */
        } else if (caps == 0) {
            assert_outcome(&mesh, along(1, 10, 2, 0, 0), ORACLE_UNCERTAIN);
        }
        /* The sine of the cone's angle is 1/2: it touches the first sphere at x = -1, and ends in a point. */
        mesh.radii = cone;
        assert_hit(&mesh, along(1, 10, 0, 0, 0), 10 - 2 / sqrt(3));
        assert_hit(&mesh, along(1, 10, -0.99f, 0, 0), 10 - 2.99 / sqrt(3));
        assert_outcome(&mesh, along(1, 10, -1.01f, 0, 0), first);
        assert_outcome(&mesh, along(1, 10, 2.01f, 0, 0), ORACLE_MISS);
        assert_outcome(&mesh, along(0, -10, 0, 0.5f, 0), first);
        assert_outcome(&mesh, along(0, 10, 0, 0.5f, 0), ORACLE_HIT);
    }
}

static void a_swallowed_end_leaves_one_sphere(void **state)
{
    (void)state;
    static const float apart[6] = {0, 0, 0, 1, 0, 0}, together[6] = {3, 4, 5, 3, 4, 5};
    static const float falling[2] = {3, 1}, rising[2] = {1, 3}, equal[2] = {1, 1};
    for (uint8_t caps = 0; caps < 4; caps++) {
        const enum oracle_outcome first = caps & ORACLE_CAP_FIRST ? ORACLE_HIT : ORACLE_MISS,
                                  second = caps & ORACLE_CAP_SECOND ? ORACLE_HIT : ORACLE_MISS;
        struct oracle_mesh mesh = swept_of(apart, falling, &caps);
        for (int axis = 0; axis < 3; axis++) {
            assert_outcome(&mesh, along(axis, 10, 0.5f, 0.5f, 0.5f), first);
            assert_outcome(&mesh, along(axis, -10, 0.5f, 0.5f, 0.5f), first);
        }
        mesh.radii = rising;
        assert_outcome(&mesh, along(1, 10, 3.5f, 0, 0), second);
        assert_outcome(&mesh, along(1, 10, -2.1f, 0, 0), ORACLE_MISS);
        mesh.positions = together;
        mesh.radii = equal;
        assert_outcome(&mesh, along(0, 10, 0, 4.5f, 5), first);
        mesh.radii = rising;
        assert_outcome(&mesh, along(0, 10, 0, 4.5f, 5), second);
    }
}

static void kinds_stand_in_one_scene(void **state)
{
    (void)state;
    static const float corners[9] = {-1, -1, 5, 1, -1, 5, 0, 2, 5}, centre[3] = {0, 0, 0}, radii[2] = {1, 1};
    static const float ends[6] = {-3, 0, -4, 3, 0, -4};
    const struct oracle_mesh meshes[3] = {
        {.positions = corners, .primitive_count = 1},
        {.shape = ORACLE_SPHERES, .positions = centre, .radii = radii, .primitive_count = 1, .geometry = 1},
        {.shape = ORACLE_SWEPT_SPHERES, .positions = ends, .radii = radii, .primitive_count = 1, .geometry = 2}};
    struct ray ray = along(2, 10, 0, 0, 0);
    for (int k = 0; k < 3; k++) {
        static const float starts[3] = {10, 4, -2};
        ray.origin[2] = starts[k];
        struct memory memory;
        struct oracle_answer answer;
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(oracle_trace(meshes, 3, &ray, 1, &memory, &parallel_serial, NULL, NULL, &answer, NULL),
                         BVHD_OK);
        assert_int_equal(answer.outcome, ORACLE_HIT);
        assert_int_equal(answer.tied_count, 1);
        assert_int_equal(answer.tied[0].geometry, k);
        oracle_finish(&answer, 1, &memory);
        assert_int_equal(memory.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(presence_and_distance_hold_for_moved_inputs),
        cmocka_unit_test(the_filter_drops_nothing_that_may_be_met),
        cmocka_unit_test(spheres_are_hit_from_outside),
        cmocka_unit_test(what_cannot_be_hit_is_missed),
        cmocka_unit_test(swept_spheres_have_a_side_and_the_caps_that_they_have),
        cmocka_unit_test(a_swallowed_end_leaves_one_sphere),
        cmocka_unit_test(kinds_stand_in_one_scene),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

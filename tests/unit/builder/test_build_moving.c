/* SPDX-License-Identifier: Apache-2.0 */
/* test_build_moving.c - tests that rays meet what moves in built structures as they meet it in the canonical copies. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/traverse/motion.h"
#include "builder/traverse/traverse.h"
#include "builder/traverse/triangle.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/test_ir.h"

enum { TRIANGLES = 150, INSTANCES = 40, REFERENCES = 3, RAYS = 200 };

static struct memory memory;
static const struct build_context serial = {.memory = &memory, .parallel = &parallel_serial};

/* A structure, and what it was built from. */
struct level {
    struct test_model model;
    unsigned char *blob;
    struct build_stats stats;
    struct portable_view view;
};

static void build_level(const struct build_options *options, struct level *level)
{
    struct bvhd_error error;
    assert_int_equal(build(&level->model.canonical, options, &serial, &level->blob, &level->stats, NULL), BVHD_OK);
    const struct bytes blob = {level->blob, level->stats.sizes.total};
    if (portable_open(blob, &memory, &level->view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

/* The ends are as likely as any quarter between them, so that they are tested, too. */
static float time_of(struct random *random)
{
    const uint64_t choice = random_next(random) % 8;
    return choice == 0 ? 0 : choice == 1 ? 1 : (float)random_between(random, 0, 1);
}

static struct ray ray_towards(struct random *random, const struct box *bounds)
{
    struct ray ray = {.tmax = INFINITY, .cull_mask = 0xff, .time = time_of(random)};
    for (int axis = 0; axis < 3; axis++) {
        const double side = (double)bounds->max[axis] - bounds->min[axis];
        ray.origin[axis] = (float)(bounds->min[axis] + side * random_between(random, -0.5, 1.5));
        ray.direction[axis] = (float)(bounds->min[axis] + side * random_between(random, 0, 1)) - ray.origin[axis];
    }
    return ray;
}

/* Returns the least t at which a ray meets the triangles at its time, or infinity. Grazing hits do not count. */
static double closest(const struct canonical *canonical, const double origin[3], const double direction[3], float time,
                      double edge)
{
    struct triangle_ray ray;
    double t = INFINITY;
    triangle_ray_init(origin, direction, &ray);
    for (uint32_t g = 0; g < canonical->geometry_count; g++)
        for (uint32_t i = 0; i < canonical->geometries[g].primitive_count; i++) {
            float keys[2][3][3];
            struct triangle_hit hit;
            for (int key = 0; key < 2; key++)
                canonical_triangle_at(&canonical->geometries[g], i, key, keys[key]);
            for (int k = 0; k < 9; k++)
                keys[0][k / 3][k % 3] =
                    motion_number(keys[0][k / 3][k % 3], keys[1][k / 3][k % 3], motion_weights_at(time));
            if (triangle_intersect(&ray, keys[0][0], keys[0][1], keys[0][2], &hit) && hit.t > 0 && hit.t < t &&
                hit.u >= edge && hit.v >= edge && hit.u + hit.v <= 1 - edge)
                t = hit.t;
        }
    return t;
}

static void check_bottom(const struct level *bottom, struct random *random)
{
    const struct portable_view *views[1] = {&bottom->view};
    const struct scene scene = {.bottoms = views, .bottom_count = 1};
    uint32_t hits = 0;
    for (int i = 0; i < RAYS; i++) {
        const struct ray ray = ray_towards(random, &bottom->stats.bounds);
        const double origin[3] = {ray.origin[0], ray.origin[1], ray.origin[2]};
        const double direction[3] = {ray.direction[0], ray.direction[1], ray.direction[2]};
        const double expected = closest(&bottom->model.canonical, origin, direction, ray.time, 0);
        struct ray_hit hit = {.t = INFINITY};
        assert_int_equal(traverse(&scene, &ray, NULL, &hit, NULL), expected < INFINITY);
        assert_true(hit.t == (float)expected);
        hits += expected < INFINITY;
    }
    assert_in_range(hits, RAYS / 40, RAYS - 1);
}

/* Brings a ray into the space of an instance at its time. Returns false if the matrix has no inverse worth the name. */
static bool bring(const float m[12], const struct ray *ray, double ret_origin[3], double ret_direction[3])
{
    double inverse[3][3], determinant = 0, size = 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (k + 1) % 3, d = (k + 2) % 3;
            inverse[k][i] = (double)m[4 * a + c] * m[4 * b + d] - (double)m[4 * a + d] * m[4 * b + c];
            size = fmax(size, fabs((double)m[4 * i + k]));
        }
    for (int k = 0; k < 3; k++)
        determinant += m[k] * inverse[k][0];
    for (int k = 0; k < 3; k++) {
        ret_origin[k] = ret_direction[k] = 0;
        for (int i = 0; i < 3; i++) {
            ret_origin[k] += inverse[k][i] / determinant * ((double)ray->origin[i] - m[4 * i + 3]);
            ret_direction[k] += inverse[k][i] / determinant * ray->direction[i];
        }
    }
    return fabs(determinant) > 1e-3 * size * size * size;
}

/* No hit of any instance is missed; hits near edges, where the arithmetic of the traversal may differ, do not count. */
static void check_top(const struct level *top, const struct level *bottom, struct random *random)
{
    const struct portable_view *views[REFERENCES] = {&bottom->view, &bottom->view, &bottom->view};
    const struct scene scene = {.top = &top->view, .bottoms = views, .bottom_count = REFERENCES};
    uint32_t hits = 0;
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = ray_towards(random, &top->stats.bounds);
        struct ray_hit hit = {.t = INFINITY};
        double expected = INFINITY;
        for (uint32_t k = 0; k < INSTANCES; k++) {
            const struct canonical_motion motion = canonical_motion(top->model.canonical.geometries, k);
            struct portable_moving_instance instance = {.motion = motion.type};
            double origin[3], direction[3];
            float matrix[12];
            memcpy(instance.start, motion.start, sizeof instance.start);
            memcpy(instance.end, motion.end, sizeof instance.end);
            if (!(canonical_instance(top->model.canonical.geometries, k).mask & ray.cull_mask) ||
                !motion_matrix(&instance, ray.time, matrix) || !bring(matrix, &ray, origin, direction))
                continue;
            expected = fmin(expected, closest(&bottom->model.canonical, origin, direction, ray.time, 1e-3));
        }
        traverse(&scene, &ray, NULL, &hit, NULL);
        if (expected < INFINITY)
            assert_true(hit.t <= expected * (1 + 1e-4));
        hits += expected < INFINITY;
    }
    assert_true(hits > RAYS / 80);
}

static void finish(struct level *level)
{
    memory_free(&memory, level->blob);
    test_model_finish(&level->model);
}

static void check_builds(enum build_builder builder)
{
    struct random random = {11};
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        const struct build_options options = {.quality = quality, .target = TARGET_PORTABLE, .builder = builder};
        const struct test_shape triangles = {
            .type = GEOMETRY_MOVING_TRIANGLES, .geometries = 3, .primitives = TRIANGLES, .size = 2, .detail = 0.1};
        const struct test_shape instances = {
            .type = GEOMETRY_MOVING_INSTANCES, .geometries = 1, .primitives = INSTANCES, .size = 10, .detail = 0.1};
        struct level bottom, top;
        test_model_make(&triangles, quality, &bottom.model);
        test_model_make(&instances, quality, &top.model);
        build_level(&options, &bottom);
        for (int i = 0; i < REFERENCES; i++)
            top.model.canonical.references[i] = (struct canonical_reference){
                .kind = REFERENCE_BLAS, .bounds = bottom.stats.bounds, .slabs = bottom.stats.slabs};
        build_level(&options, &top);
        check_bottom(&bottom, &random);
        check_top(&top, &bottom, &random);
        finish(&top);
        finish(&bottom);
    }
    assert_int_equal(memory.live, 0);
}

static void rays_meet_what_moves(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    BUILDERS_FOR(builder)
    check_builds(builder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_meet_what_moves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

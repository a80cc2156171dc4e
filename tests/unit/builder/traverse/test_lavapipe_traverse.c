/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_lavapipe_traverse.c - tests that rays give the same answers through the lavapipe layout as through the portable
 * one.
 *
 * The portable layout has its own tests against brute force.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/random.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/test_scene.h"

/* Makes triangles with sides of about `detail` in the cube [-1, 1)^3. Many have no area or are not finite. */
static float (*make_soup(uint64_t seed, uint32_t count, double detail))[3][3]
{
    struct random random = {seed};
    float(*corners)[3][3] = calloc(count + 1, sizeof *corners);
    assert_non_null(corners);
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], offset[3];
        random_point(&random, centre);
        for (int k = 0; k < 3; k++) {
            random_point(&random, offset);
            for (int axis = 0; axis < 3; axis++)
                corners[i][k][axis] = (float)(centre[axis] + detail * offset[axis]);
        }
        if (i % 11 == 10)
            memcpy(corners[i][1], corners[i][0], sizeof corners[i][1]);
        if (i % 13 == 12)
            corners[i][0][i % 3] = i % 2 ? NAN : INFINITY;
    }
    return corners;
}

static float (*make_boxes(uint64_t seed, uint32_t count, double detail))[6]
{
    struct random random = {seed};
    float(*boxes)[6] = calloc(count + 1, sizeof *boxes);
    assert_non_null(boxes);
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], extent[3];
        random_point(&random, centre);
        random_point(&random, extent);
        for (int axis = 0; axis < 3; axis++) {
            boxes[i][axis] = (float)(centre[axis] - detail * fabs(extent[axis]));
            boxes[i][3 + axis] = (float)(centre[axis] + detail * fabs(extent[axis]));
        }
        if (i % 13 == 12)
            boxes[i][0] = NAN;
    }
    return boxes;
}

/*
 * Makes a ray from outside into the cube, along an axis, or from inside; some have a limited interval. `target` may be
 * NULL.
 */
static struct ray make_ray(struct random *random, const float *target)
{
    struct ray ray = {.tmax = random_next(random) % 4 ? FLT_MAX : (float)random_between(random, 0, 2),
                      .cull_mask = 0xff};
    double from[3], to[3];
    unsigned kind = random_next(random) % 8;
    random_point(random, from);
    random_point(random, to);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)(from[axis] * (kind % 2 ? 3 : 1));
        ray.direction[axis] = (float)((target ? target[axis] : to[axis]) - ray.origin[axis]);
        if (kind == 6)
            ray.direction[axis] = axis == 1 ? 1 : 0;
    }
    if (random_next(random) % 8 == 0)
        ray.tmin = (float)random_between(random, 0, 1);
    return ray;
}

static void assert_same_corners(const struct test_scene *scene, const struct ray_hit *portable,
                                const struct ray_hit *native)
{
    float a[3][3], b[3][3];
    traverse_positions(&scene->scene, portable, a);
    lavapipe_positions(&scene->native, native, b);
    for (int i = 0; i < 9; i++)
        assert_true(a[i / 3][i % 3] == b[i / 3][i % 3]);
}

/* Traces both targets in both orders. Returns whether something was hit. */
static bool check_ray(const struct test_scene *scene, const struct ray *ray, const struct traverse_options *options)
{
    struct ray_hit portable, native;
    struct traverse_options given = options ? *options : (struct traverse_options){0};
    bool is_hit = traverse(&scene->scene, ray, options, &portable, NULL);
    for (int flip = 0; flip < 2; flip++) {
        given.flip_order = flip;
        assert_int_equal(lavapipe_traverse(&scene->native, ray, &given, &native, NULL), is_hit);
        bool any = ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
        if (is_hit && !any)
            assert_true(test_scene_same_hit(&portable, &native));
        if (is_hit && !any && !native.is_aabb)
            assert_same_corners(scene, &portable, &native);
    }
    return is_hit;
}

/* An any-hit callback that records its candidates, independently of their order, and decides by the primitive alone. */
struct verdicts {
    uint64_t sum;
    uint32_t count;
    /*
     * True: sums up all calls, and ignores the candidates. False: sums up nothing, because split primitives are offered
     * more than once, and accepts some candidates.
     */
    bool once;
};

static enum candidate_verdict decide(void *context, const struct ray *ray, const struct candidate_space *space,
                                     struct ray_hit *hit)
{
    struct verdicts *verdicts = context;
    uint64_t name = ((uint64_t)(hit->instance + 1) * 8191 + hit->geometry) * 8191 + hit->primitive;
    struct random random = {name};
    (void)ray;
    (void)space;
    if (verdicts->once) {
        verdicts->sum += random_next(&random) ^ hit->front_face;
        verdicts->count++;
    }
    uint64_t decision = random_next(&random);
    if (hit->is_aabb && decision % 4 == 0)
        hit->t += 0.25f;
    return verdicts->once || decision % 3 == 0 ? CANDIDATE_IGNORE : CANDIDATE_ACCEPT;
}

static const uint32_t opacity_flags[] = {0, RAY_OPAQUE, RAY_NO_OPAQUE, RAY_CULL_OPAQUE, RAY_CULL_NO_OPAQUE};
static const uint32_t kind_flags[] = {0, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING, RAY_SKIP_TRIANGLES,
                                      RAY_SKIP_AABBS};

/*
 * Traces one ray with a pair of flags: closest hit, any hit, with a callback that accepts some candidates, and with one
 * that sees them all.
 */
static int check_ways(const struct test_scene *scene, struct ray *ray, bool is_split)
{
    struct verdicts verdicts[3] = {{0}, {.once = true}, {.once = true}};
    struct traverse_options some = {.candidate = decide, .context = &verdicts[0]};
    int hits = check_ray(scene, ray, NULL);
    check_ray(scene, ray, &some);
    if (!is_split) {
        struct traverse_options all = {.candidate = decide, .context = &verdicts[1]};
        struct ray_hit hit;
        bool is_hit = traverse(&scene->scene, ray, &all, &hit, NULL);
        all.context = &verdicts[2];
        /* Opaque primitives are not offered, and can hide more or fewer of the others, depending on the order. */
        bool hides = is_hit;
        assert_int_equal(lavapipe_traverse(&scene->native, ray, &all, &hit, NULL), is_hit);
        assert_true(hides || (verdicts[1].sum == verdicts[2].sum && verdicts[1].count == verdicts[2].count));
    }
    ray->flags |= RAY_TERMINATE_ON_FIRST_HIT;
    check_ray(scene, ray, NULL);
    return hits;
}

static void shoot(const struct test_scene *scene, uint64_t seed, int rays, const float (*targets)[3][3],
                  uint32_t target_count, int least_hits)
{
    struct random random = {seed};
    int hits = 0;
    for (int i = 0; i < rays; i++) {
        const float *target =
            i % 4 == 0 && target_count ? targets[random_next(&random) % target_count][i / 4 % 3] : NULL;
        struct ray ray = make_ray(&random, target);
        ray.cull_mask = i % 3 ? 0xff : (uint8_t)random_next(&random);
        ray.flags = opacity_flags[i % 5] | kind_flags[i / 5 % 5];
        hits += check_ways(scene, &ray, scene->quality == QUALITY_HIGH);
    }
    assert_in_range(hits, least_hits, rays);
}

static void test_triangles(void **state)
{
    (void)state;
    enum { COUNT = 700, RAYS = 1500 };
    static const enum build_quality qualities[] = {QUALITY_FAST, QUALITY_BALANCED, QUALITY_HIGH};
    for (int i = 0; i < 6; i++) {
        struct test_scene scene;
        float(*corners)[3][3] = make_soup(1 + (uint64_t)i, COUNT, i % 2 ? 0.4 : 0.1);
        const float(*first)[3][3] = (const float(*)[3][3])corners;
        struct geometry geometries[4] = {test_scene_triangles(first, COUNT / 3, 0), test_scene_triangles(first, 0, 0),
                                         test_scene_triangles(first + COUNT / 3, COUNT / 2, GEOMETRY_OPAQUE),
                                         test_scene_triangles(first + COUNT / 3, 1, GEOMETRY_NO_DUPLICATE_ANY_HIT)};
        test_scene_init_native(&scene, i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN);
        scene.quality = qualities[i / 2];
        test_scene_add(&scene, geometries, 4, 0);
        shoot(&scene, 40 + (uint64_t)i, RAYS, first, COUNT, RAYS / 12);
        test_scene_finish(&scene);
        free(corners);
    }
}

static void test_aabbs(void **state)
{
    (void)state;
    enum { COUNT = 400, RAYS = 2000 };
    float(*boxes)[6] = make_boxes(9, COUNT, 0.1);
    const float(*first)[6] = (const float(*)[6])boxes;
    struct geometry geometries[2] = {test_scene_aabbs(first, COUNT / 2, 0),
                                     test_scene_aabbs(first + COUNT / 2, COUNT / 2, GEOMETRY_OPAQUE)};
    for (int variant = LAVAPIPE_PLAIN; variant <= LAVAPIPE_COMPACTED; variant++) {
        struct test_scene scene;
        test_scene_init_native(&scene, (enum lavapipe_variant)variant);
        test_scene_add(&scene, geometries, 2, 0);
        shoot(&scene, 50, RAYS, NULL, 0, RAYS / 12);
        test_scene_finish(&scene);
    }
    free(boxes);
}

/*
 * Makes instances of triangles, of boxes and of nothing, with all flags. Some cannot be hit, because they are inactive
 * or have an empty mask.
 */
static void make_instances(struct random *random, struct test_instance *ret_instances, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        struct test_instance *instance = &ret_instances[i];
        *instance = (struct test_instance){
            .custom_index = 0xabc000 + i,
            .mask = i % 5 ? 0xff : 1u << (i % 8),
            .sbt_offset = 0x123000 + i,
            .flags = (uint32_t)random_next(random) % 16,
            .bottom = i % 3,
        };
        uint32_t both = INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE;
        if ((instance->flags & both) == both)
            instance->flags &= ~(uint32_t)INSTANCE_FORCE_OPAQUE;
        test_scene_transform(random, 0.3, 1, instance->transform);
        if (i % 19 == 18)
            instance->bottom = TEST_SCENE_INACTIVE;
        if (i % 23 == 22)
            instance->mask = 0;
    }
}

static void test_instances(void **state)
{
    (void)state;
    enum { COUNT = 80, INSTANCES = 60, RAYS = 3000 };
    float(*corners)[3][3] = make_soup(3, COUNT, 0.4);
    float(*boxes)[6] = make_boxes(4, COUNT, 0.1);
    for (int variant = LAVAPIPE_PLAIN; variant <= LAVAPIPE_COMPACTED; variant++) {
        struct random random = {11};
        struct test_scene scene;
        struct test_instance instances[INSTANCES];
        const float(*first)[3][3] = (const float(*)[3][3])corners;
        struct geometry triangles[2] = {test_scene_triangles(first, COUNT / 2, GEOMETRY_OPAQUE),
                                        test_scene_triangles(first + COUNT / 2, COUNT / 2, 0)};
        struct geometry aabbs = test_scene_aabbs((const float(*)[6])boxes, COUNT, 0),
                        nothing = test_scene_triangles(first, 0, 0);
        test_scene_init_native(&scene, (enum lavapipe_variant)variant);
        test_scene_add(&scene, triangles, 2, 0);
        test_scene_add(&scene, &aabbs, 1, 0);
        test_scene_add(&scene, &nothing, 1, 0);
        make_instances(&random, instances, INSTANCES);
        test_scene_add_top(&scene, instances, INSTANCES);
        shoot(&scene, 60, RAYS, NULL, 0, RAYS / 12);
        test_scene_finish(&scene);
    }
    free(corners);
    free(boxes);
}

/* Scenes range from subnormal to nearly infinite. */
static void test_magnitudes(void **state)
{
    (void)state;
    enum { COUNT = 200, RAYS = 200 };
    static const int exponents[] = {-143, -120, -62, -40, 40, 63, 90, 120};
    float(*corners)[3][3] = make_soup(4, COUNT, 0.3), (*scaled)[3][3] = calloc(COUNT, sizeof *scaled);
    assert_non_null(scaled);
    for (unsigned e = 0; e < sizeof exponents / sizeof *exponents; e++) {
        struct test_scene scene;
        struct random random = {13};
        int hits = 0;
        for (uint32_t i = 0; i < COUNT * 9; i++)
            (&scaled[0][0][0])[i] = ldexpf((&corners[0][0][0])[i], exponents[e]);
        struct geometry geometry = test_scene_triangles((const float(*)[3][3])scaled, COUNT, 0);
        test_scene_init_native(&scene, LAVAPIPE_PLAIN);
        test_scene_add(&scene, &geometry, 1, 0);
        for (int i = 0; i < RAYS; i++) {
            struct ray ray = make_ray(&random, NULL);
            ray.tmin = 0;
            ray.tmax = INFINITY;
            for (int axis = 0; axis < 3; axis++)
                ray.origin[axis] = ldexpf(ray.origin[axis], exponents[e]);
            hits += check_ray(&scene, &ray, NULL);
        }
        assert_true(hits > RAYS / 8);
        test_scene_finish(&scene);
    }
    free(scaled);
    free(corners);
}

/* Each triangle is half as far away as the previous one, so that trees become as deep as allowed. */
static void test_deep(void **state)
{
    (void)state;
    enum { COUNT = 120 };
    float corners[COUNT][3][3];
    for (int i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++)
                corners[i][k][axis] = ldexpf(axis == k ? 1.0f : 0.9f, i - COUNT / 2);
    struct test_scene scene;
    struct geometry geometry = test_scene_triangles((const float(*)[3][3])corners, COUNT, 0);
    test_scene_init_native(&scene, LAVAPIPE_PLAIN);
    test_scene_add(&scene, &geometry, 1, 0);
    struct test_instance instance = {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 1};
    for (int level = 0; level < 2; level++) {
        if (builders_asked() == BUILDER_OWN) /* Embree's trees are less deep by themselves */
            assert_int_equal(scene.native_views[0].levels, LAVAPIPE_MAX_LEVELS);
        assert_true(scene.native_views[0].levels <= LAVAPIPE_MAX_LEVELS);
        for (int i = 0; i < COUNT; i++) {
            float size = ldexpf(1, i - COUNT / 2);
            struct ray ray = {
                .origin = {0.94f * size, 0.93f * size, 0}, .direction = {0, 0, 1}, .tmax = INFINITY, .cull_mask = 1};
            struct ray_hit hit;
            assert_true(check_ray(&scene, &ray, NULL));
            assert_true(lavapipe_traverse(&scene.native, &ray, NULL, &hit, NULL));
            assert_int_equal(hit.primitive, i);
        }
        if (level == 0)
            test_scene_add_top(&scene, &instance, 1);
    }
    test_scene_finish(&scene);
}

/* Invalid scenes and invalid rays hit nothing. */
static void test_nothing_to_hit(void **state)
{
    (void)state;
    struct test_scene scene;
    struct ray_hit hit = {.t = -1};
    struct ray ray = {.direction = {0, 0, 1}, .tmax = FLT_MAX, .cull_mask = 0xff};
    const float corners[1][3][3] = {{{-1, -1, 2}, {1, -1, 2}, {0, 1, 2}}};
    struct geometry full = test_scene_triangles(corners, 1, 0), empty = test_scene_triangles(corners, 0, 0);
    struct test_instance instances[2] = {{.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 1},
                                         {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 1, .bottom = 1}};
    assert_false(lavapipe_traverse(&(struct lavapipe_scene){0}, &ray, NULL, &hit, NULL));
    test_scene_init_native(&scene, LAVAPIPE_PLAIN);
    test_scene_add(&scene, &empty, 1, 0);
    assert_false(lavapipe_traverse(&scene.native, &ray, NULL, &hit, NULL));
    test_scene_add(&scene, &full, 1, 0);
    test_scene_add_top(&scene, instances, 2);
    assert_true(lavapipe_traverse(&scene.native, &ray, NULL, &hit, NULL));
    assert_int_equal(hit.instance, 1);
    assert_int_equal(hit.handle, 1);

    const struct lavapipe_view *without[2] = {scene.native_bottoms[0], NULL},
                               *nested[2] = {scene.native.top, scene.native.top};
    const struct lavapipe_scene broken[] = {{scene.native.top, without, 2, NULL},
                                            {scene.native.top, without, 1, NULL},
                                            {scene.native.top, nested, 2, NULL},
                                            {scene.native_bottoms[1], scene.native_bottoms, 2, NULL},
                                            {NULL, nested, 2, NULL},
                                            {NULL, without + 1, 1, NULL}};
    for (unsigned i = 0; i < sizeof broken / sizeof *broken; i++)
        assert_false(lavapipe_traverse(&broken[i], &ray, NULL, &hit, NULL));
    for (int i = 0; i < 6; i++) {
        struct ray bad = ray;
        bad.origin[2] = i == 0 ? NAN : i == 1 ? INFINITY : 0;
        bad.direction[2] = i == 2 ? 0 : i == 3 ? -INFINITY : 1;
        bad.tmin = i == 4 ? NAN : i == 5 ? 3 : 0;
        bad.tmax = i == 5 ? 2.5f : FLT_MAX;
        assert_false(lavapipe_traverse(&scene.native, &bad, NULL, &hit, NULL));
    }
    test_scene_finish(&scene);
}

/* Counters are added to, and any hit costs less than the closest hit. */
static void test_counters(void **state)
{
    (void)state;
    enum { COUNT = 500, RAYS = 200 };
    struct test_scene scene;
    float(*corners)[3][3] = make_soup(5, COUNT, 0.3);
    struct geometry geometry = test_scene_triangles((const float(*)[3][3])corners, COUNT, GEOMETRY_OPAQUE);
    struct test_instance instance = {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 1};
    test_scene_init_native(&scene, LAVAPIPE_PLAIN);
    test_scene_add(&scene, &geometry, 1, 0);
    test_scene_add_top(&scene, &instance, 1);
    struct traverse_counters closest = {0}, any = {.nodes = 1000000};
    struct random random = {21};
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random, NULL);
        struct ray_hit hit;
        lavapipe_traverse(&scene.native, &ray, NULL, &hit, &closest);
        ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
        lavapipe_traverse(&scene.native, &ray, NULL, &hit, &any);
    }
    assert_true(any.nodes > 1000000 && any.nodes - 1000000 < closest.nodes);
    assert_true(closest.instances > RAYS / 4 && closest.instances <= RAYS);
    assert_true(closest.triangles > 0 && closest.triangles < RAYS * COUNT / 4 && any.triangles < closest.triangles);
    test_scene_finish(&scene);
    free(corners);
}

static void test_instance_flags(void **state)
{
    (void)state;
    assert_int_equal(lavapipe_instance_flags(LAVAPIPE_NOT_FORCE_NO_OPAQUE), 0);
    assert_int_equal(lavapipe_instance_flags(0), INSTANCE_FORCE_NO_OPAQUE);
    assert_int_equal(lavapipe_instance_flags(LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_FORCE_OPAQUE | 0xffffff),
                     INSTANCE_FORCE_OPAQUE);
    assert_int_equal(lavapipe_instance_flags(LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_CULL_DISABLE),
                     INSTANCE_CULL_DISABLE);
    assert_int_equal(lavapipe_instance_flags(LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_FLIP_FACING),
                     INSTANCE_FLIP_FACING);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_triangles),  cmocka_unit_test(test_aabbs),          cmocka_unit_test(test_instances),
        cmocka_unit_test(test_magnitudes), cmocka_unit_test(test_deep),           cmocka_unit_test(test_nothing_to_hit),
        cmocka_unit_test(test_counters),   cmocka_unit_test(test_instance_flags),
    };
    return cmocka_run_group_tests_name("lavapipe_traverse", tests, NULL, NULL);
}

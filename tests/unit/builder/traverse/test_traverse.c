/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_traverse.c - tests traversal against brute force: closest and any hit, instances, watertightness, ties, flags,
 * callbacks.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/random.h"
#include "tests/support/builder/test_scene.h"

/* Makes triangles in the cube [-size, size)^3 whose sides are about `detail` times that; every seventh one is thin. */
static float (*make_soup(uint64_t seed, uint32_t count, double size, double detail))[3][3]
{
    struct random random = {seed};
    float(*corners)[3][3] = calloc(count, sizeof *corners);
    assert_non_null(corners);
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], offset[3];
        random_point(&random, centre);
        for (int k = 0; k < 3; k++) {
            random_point(&random, offset);
            for (int axis = 0; axis < 3; axis++)
                corners[i][k][axis] =
                    (float)(size * (centre[axis] + detail * (i % 7 == 0 && axis == 0 ? 1e-4 : 1) * offset[axis]));
        }
    }
    return corners;
}

/* Makes a ray from outside into the cube, from inside in any direction, and sometimes along an axis. */
static struct ray make_ray(struct random *random, double size)
{
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff};
    double from[3], to[3];
    bool outside = random_next(random) % 2;
    int axis = (int)(random_next(random) % 6);
    random_point(random, from);
    random_point(random, to);
    for (int i = 0; i < 3; i++) {
        ray.origin[i] = (float)(size * (outside ? 3 : 1) * from[i]);
        ray.direction[i] = (float)(size * to[i] - (outside ? ray.origin[i] : 0));
        if (axis < 3)
            ray.direction[i] = i == axis ? -ray.origin[i] : 0;
    }
    return ray;
}

/* Traverses the scene with all options, which must give the same answer. */
static bool traverse_all_ways(const struct scene *scene, const struct ray *ray, struct ray_hit *ret_hit)
{
    bool is_hit = traverse(scene, ray, NULL, ret_hit, NULL);
    for (int way = 1; way < 8; way++) {
        struct traverse_options options = {.flip_order = way & 1, .baseline_only = way & 2, .exact_only = way & 4};
        struct ray_hit hit;
        assert_int_equal(traverse(scene, ray, &options, &hit, NULL), is_hit);
        if (is_hit)
            assert_true(test_scene_same_hit(&hit, ret_hit));
    }
    return is_hit;
}

/* Returns whether brute force was certain of its answer. */
static bool check_against_brute_force(const struct test_scene *scene, const struct ray *ray, int *hits)
{
    struct ray_hit hit;
    bool is_hit = traverse_all_ways(&scene->scene, ray, &hit);
    struct test_answer answer = test_scene_brute_force(scene, ray);
    if (answer.is_doubtful)
        return false;
    assert_int_equal(is_hit, answer.is_hit);
    if (!is_hit)
        return true;
    *hits += 1;
    assert_true(fabs(hit.t - answer.t) <= 1.2e-7 * fabs(answer.t));
    assert_int_equal(hit.instance, answer.instance);
    assert_int_equal(hit.geometry, answer.geometry);
    assert_int_equal(hit.primitive, answer.primitive);
    return true;
}

/* Two geometries, both kinds of records, closest hits within an interval. */
static void test_one_level(void **state)
{
    (void)state;
    enum { COUNT = 600, RAYS = 1200 };
    for (uint32_t flags = 0; flags <= PORTABLE_FAST_TRIANGLES; flags += PORTABLE_FAST_TRIANGLES)
        for (int coarse = 0; coarse < 2; coarse++) {
            struct test_scene scene;
            float(*corners)[3][3] = make_soup(1 + (uint64_t)coarse, COUNT, 10, coarse ? 0.5 : 0.15);
            const float(*first)[3][3] = (const float(*)[3][3])corners;
            struct geometry geometries[2] = {
                test_scene_triangles(first, COUNT / 3, 0),
                test_scene_triangles(first + COUNT / 3, COUNT - COUNT / 3, GEOMETRY_OPAQUE)};
            test_scene_init(&scene);
            test_scene_add(&scene, geometries, 2, flags);
            struct random random = {7};
            int hits = 0, sure = 0;
            for (int i = 0; i < RAYS; i++) {
                struct ray ray = make_ray(&random, 10);
                if (i % 4 == 0) {
                    ray.tmin = (float)random_between(&random, 0, 0.5);
                    ray.tmax = ray.tmin + (float)random_between(&random, 0, 0.5);
                }
                sure += check_against_brute_force(&scene, &ray, &hits);
            }
            assert_true(hits > RAYS / 5 && sure > RAYS - 10);
            test_scene_finish(&scene);
            free(corners);
        }
}

static void test_instances(void **state)
{
    (void)state;
    enum { COUNT = 60, INSTANCES = 50, RAYS = 2500 };
    struct random random = {11};
    struct test_scene scene;
    struct test_instance instances[INSTANCES];
    float(*corners)[3][3] = make_soup(3, 3 * COUNT, 5, 0.5);
    const float(*first)[3][3] = (const float(*)[3][3])corners;
    test_scene_init(&scene);
    for (int i = 0; i < 3; i++) {
        struct geometry geometry = test_scene_triangles(first + i * COUNT, COUNT, GEOMETRY_OPAQUE);
        test_scene_add(&scene, &geometry, 1, i == 1 ? PORTABLE_FAST_TRIANGLES : 0);
    }
    for (uint32_t i = 0; i < INSTANCES; i++) {
        instances[i] = (struct test_instance){
            .custom_index = 0xabc000 + i,
            .mask = i % 5 ? 0xff : 1u << (i % 8),
            .sbt_offset = 0x123000 + i,
            .flags = (uint32_t)random_next(&random) & (INSTANCE_CULL_DISABLE | INSTANCE_FLIP_FACING),
            .bottom = i % 3,
        };
        test_scene_transform(&random, 0.6, 20, instances[i].transform);
    }
    test_scene_add_top(&scene, instances, INSTANCES);
    int hits = 0, sure = 0;
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random, 20), turned = ray;
        ray.cull_mask = i % 3 ? 0xff : (uint8_t)random_next(&random);
        ray.flags = i % 4 == 1 ? RAY_CULL_BACK_FACING : i % 4 == 2 ? RAY_CULL_FRONT_FACING : 0;
        sure += check_against_brute_force(&scene, &ray, &hits);
        struct ray_hit hit;
        if (!traverse(&scene.scene, &turned, NULL, &hit, NULL))
            continue;
        assert_int_equal(hit.custom_index, instances[hit.instance].custom_index);
        assert_int_equal(hit.sbt_offset, instances[hit.instance].sbt_offset);
        assert_int_equal(hit.handle, instances[hit.instance].bottom);
    }
    assert_true(hits > RAYS / 5 && sure > RAYS - 20);
    test_scene_finish(&scene);
    free(corners);
}

/* Scenes that are scaled by powers of two, from subnormal to nearly infinite, give the same answers. */
static void test_magnitudes(void **state)
{
    (void)state;
    enum { COUNT = 300, RAYS = 300 };
    static const int exponents[] = {-146, -120, -90, -62, -40, 0, 40, 57, 63, 90, 123};
    float(*corners)[3][3] = make_soup(4, COUNT, 8, 0.2), (*scaled)[3][3] = calloc(COUNT, sizeof *scaled);
    assert_non_null(scaled);
    for (uint32_t i = 0; i < COUNT * 9; i++)
        (&corners[0][0][0])[i] = roundf((&corners[0][0][0])[i] * 64) / 64;
    struct ray_hit expected[RAYS];
    bool is_hit[RAYS];
    for (int round = -1; round < (int)(sizeof exponents / sizeof *exponents); round++) {
        /* The finest coordinate is 2^-6, so that the smallest subnormal can represent it after scaling. */
        int exponent = round < 0 ? 0 : exponents[round] < -143 ? -143 : exponents[round];
        struct test_scene scene;
        for (uint32_t i = 0; i < COUNT * 9; i++)
            (&scaled[0][0][0])[i] = ldexpf((&corners[0][0][0])[i], exponent);
        struct geometry geometry = test_scene_triangles((const float(*)[3][3])scaled, COUNT, 0);
        test_scene_init(&scene);
        test_scene_add(&scene, &geometry, 1, 0);
        struct random random = {13};
        int hits = 0;
        for (int i = 0; i < RAYS; i++) {
            struct ray ray = make_ray(&random, 8);
            struct ray_hit hit;
            for (int axis = 0; axis < 3; axis++) {
                ray.origin[axis] = ldexpf(roundf(ray.origin[axis] * 64) / 64, exponent);
                ray.direction[axis] =
                    ldexpf(ray.direction[axis], i % 2 && exponent < 100 && exponent > -100 ? exponent : 0);
            }
            int t_exponent = i % 2 && exponent < 100 && exponent > -100 ? 0 : exponent;
            ray.tmax = INFINITY;
            bool found = traverse_all_ways(&scene.scene, &ray, &hit);
            hits += found;
            if (round < 0) {
                is_hit[i] = found;
                expected[i] = hit;
                continue;
            }
            assert_int_equal(found, is_hit[i]);
            if (!found)
                continue;
            assert_int_equal(hit.primitive, expected[i].primitive);
            assert_true(hit.t == ldexpf(expected[i].t, t_exponent));
            assert_true(hit.u == expected[i].u && hit.v == expected[i].v);
        }
        assert_true(hits > RAYS / 4);
        test_scene_finish(&scene);
    }
    free(scaled);
    free(corners);
}

struct counting {
    uint32_t seen;
    enum candidate_verdict verdict;
    float t; /* for AABBs */
};

static enum candidate_verdict count_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                              struct ray_hit *hit)
{
    struct counting *counting = context;
    (void)ray;
    (void)space;
    counting->seen++;
    if (hit->is_aabb && counting->t > 0)
        hit->t = counting->t;
    return counting->verdict;
}

enum { SPHERE_MAX = 20 << 8 };

/* Makes an icosahedron whose triangles are split into four `levels` times, with vertices moved out to the sphere. */
static uint32_t make_sphere(int levels, float corners[SPHERE_MAX][3][3])
{
    const double g = (1 + sqrt(5)) / 2;
    const double points[12][3] = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                  {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    static const int faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                     {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                     {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                     {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    uint32_t count = 20;
    for (int f = 0; f < 20; f++)
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++)
                corners[f][k][axis] = (float)(points[faces[f][k]][axis] / sqrt(1 + g * g));
    for (int level = 0; level < levels; level++, count *= 4)
        for (uint32_t f = 0; f < count; f++) {
            float middle[3][3], old[3][3];
            memcpy(old, corners[f], sizeof old);
            for (int k = 0; k < 3; k++) {
                const float *a = old[k], *b = old[(k + 1) % 3];
                double sum[3] = {(double)a[0] + b[0], (double)a[1] + b[1], (double)a[2] + b[2]};
                double length = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
                for (int axis = 0; axis < 3; axis++)
                    middle[k][axis] = (float)(sum[axis] / length);
            }
            for (uint32_t k = 0; k < 3; k++) {
                float *child = corners[count + 3 * f + k][0];
                memcpy(child, old[k], 12);
                memcpy(child + 3, middle[k], 12);
                memcpy(child + 6, middle[(k + 2) % 3], 12);
            }
            memcpy(corners[f], middle, sizeof middle);
        }
    return count;
}

/*
 * Traces rays from inside a closed mesh towards vertices, points of edges, and arbitrary points: each hits it exactly
 * once.
 */
static void shoot_at_sphere(const struct test_scene *scene, const float (*corners)[3][3], uint32_t count,
                            const float *transform, double radius, int rays)
{
    struct random random = {17};
    for (int i = 0; i < rays; i++) {
        const float(*triangle)[3] = corners[random_next(&random) % count];
        double from[3], at[3], along = i % 3 == 0 ? 0 : random_between(&random, 0, 1);
        struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff, .flags = RAY_NO_OPAQUE};
        random_point(&random, from);
        for (int axis = 0; axis < 3; axis++) {
            at[axis] = triangle[0][axis] + along * ((double)triangle[1][axis] - triangle[0][axis]);
            from[axis] *= i % 5 == 0 ? 0 : 0.4;
        }
        for (int axis = 0; axis < 3; axis++) {
            const float *m = transform + 4 * axis;
            ray.origin[axis] = (float)(m[0] * from[0] + m[1] * from[1] + m[2] * from[2] + m[3]);
            ray.direction[axis] = (float)(m[0] * at[0] + m[1] * at[1] + m[2] * at[2] + m[3] - ray.origin[axis]);
        }
        struct counting counting = {.verdict = CANDIDATE_IGNORE};
        struct traverse_options options = {.candidate = count_candidate, .context = &counting, .flip_order = i % 2};
        struct ray_hit hit;
        assert_false(traverse(&scene->scene, &ray, &options, &hit, NULL));
        assert_int_equal(counting.seen, 1);
        assert_true(traverse(&scene->scene, &ray, NULL, &hit, NULL));
        assert_true(hit.t * radius < 4 * radius);
    }
}

static void test_watertight(void **state)
{
    (void)state;
    static float corners[SPHERE_MAX][3][3];
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    uint32_t count = make_sphere(4, corners);
    struct test_scene scene;
    struct geometry geometry = test_scene_triangles((const float(*)[3][3])corners, count, 0);
    test_scene_init(&scene);
    test_scene_add(&scene, &geometry, 1, 0);
    shoot_at_sphere(&scene, (const float(*)[3][3])corners, count, identity, 1, 100000);
    test_scene_finish(&scene);

    struct test_instance instance = {.mask = 0xff,
                                     .transform = {0.3f, -4, 0.2f, 1000, 2, 0.1f, 0, -500, 0, 0.7f, 0.01f, 3}};
    test_scene_init(&scene);
    test_scene_add(&scene, &geometry, 1, 0);
    test_scene_add_top(&scene, &instance, 1);
    shoot_at_sphere(&scene, (const float(*)[3][3])corners, count, instance.transform, 4, 30000);
    test_scene_finish(&scene);
}

/* Of hits with equal t the lowest instance wins, then the lowest geometry, then the lowest primitive. */
static void test_ties(void **state)
{
    (void)state;
    enum { COPIES = 7 };
    float corners[COPIES][3][3];
    struct test_instance instances[3];
    struct test_scene scene;
    for (int i = 0; i < COPIES; i++)
        memcpy(corners[i], (float[3][3]){{-1, -1, 2}, {1, -1, 2}, {0, 1, 2}}, sizeof corners[i]);
    struct geometry one = test_scene_triangles((const float(*)[3][3])corners, 0, 0),
                    many = test_scene_triangles((const float(*)[3][3])corners, COPIES, 0);
    struct geometry geometries[4] = {one, many, many, one};
    for (int i = 0; i < 3; i++)
        instances[i] = (struct test_instance){.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = i ? 3 : 2};
    test_scene_init(&scene);
    test_scene_add(&scene, geometries, 4, 0);
    struct ray ray = {.direction = {0, 0, 1}, .tmax = 10, .cull_mask = 1};
    struct ray_hit hit;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit));
    assert_true(hit.geometry == 1 && hit.primitive == 0 && hit.instance == RAY_NO_INSTANCE);
    test_scene_add_top(&scene, instances, 3);
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit));
    assert_true(hit.geometry == 1 && hit.primitive == 0 && hit.instance == 1);
    ray.cull_mask = 2;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit));
    assert_int_equal(hit.instance, 0);
    ray.cull_mask = 4;
    assert_false(traverse_all_ways(&scene.scene, &ray, &hit));
    test_scene_finish(&scene);
}

/* One triangle, front or back facing, opaque or not, under every instance flag and ray flag. */
static void test_flags(void **state)
{
    (void)state;
    float corners[2][3][3] = {{{-1, -1, 2}, {0, 1, 2}, {1, -1, 2}}, {{-1, -1, 2}, {1, -1, 2}, {0, 1, 2}}};
    static const uint32_t cullings[] = {0, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING, RAY_SKIP_TRIANGLES,
                                        RAY_SKIP_AABBS};
    static const uint32_t opacities[] = {0, RAY_OPAQUE, RAY_NO_OPAQUE, RAY_CULL_OPAQUE, RAY_CULL_NO_OPAQUE};
    struct random random = {19};
    int hits = 0;
    for (uint32_t kind = 0; kind < 64; kind++) {
        bool front = kind & 1, opaque_geometry = kind & 2;
        uint32_t flags = kind >> 2;
        if ((flags & INSTANCE_FORCE_OPAQUE) && (flags & INSTANCE_FORCE_NO_OPAQUE))
            continue;
        struct test_scene scene;
        struct geometry geometry = test_scene_triangles((const float(*)[3][3])(front ? corners : corners + 1), 1,
                                                        opaque_geometry ? GEOMETRY_OPAQUE : 0);
        /* Mirroring instances do not change the facing. */
        struct test_instance instance = {
            .transform = {random_next(&random) % 2 ? -1 : 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
            .mask = 1,
            .flags = flags};
        test_scene_init(&scene);
        test_scene_add(&scene, &geometry, 1, 0);
        test_scene_add_top(&scene, &instance, 1);
        for (int c = 0; c < 5; c++)
            for (int o = 0; o < 5; o++) {
                struct ray ray = {
                    .direction = {0, 0, 1}, .tmax = 10, .cull_mask = 1, .flags = cullings[c] | opacities[o]};
                struct counting counting = {.verdict = CANDIDATE_ACCEPT};
                struct traverse_options options = {.candidate = count_candidate, .context = &counting};
                struct ray_hit hit;
                bool faces = front != ((flags & INSTANCE_FLIP_FACING) != 0), opaque = opaque_geometry;
                opaque = flags & INSTANCE_FORCE_OPAQUE ? true : flags & INSTANCE_FORCE_NO_OPAQUE ? false : opaque;
                opaque = ray.flags & RAY_OPAQUE ? true : ray.flags & RAY_NO_OPAQUE ? false : opaque;
                bool culled = !(flags & INSTANCE_CULL_DISABLE) &&
                              ray.flags & (faces ? (uint32_t)RAY_CULL_FRONT_FACING : (uint32_t)RAY_CULL_BACK_FACING);
                culled = culled || (ray.flags & RAY_SKIP_TRIANGLES) ||
                         (ray.flags & (opaque ? (uint32_t)RAY_CULL_OPAQUE : (uint32_t)RAY_CULL_NO_OPAQUE));
                assert_int_equal(traverse(&scene.scene, &ray, &options, &hit, NULL), !culled);
                assert_int_equal(counting.seen, !culled && !opaque);
                if (!culled)
                    assert_true(hit.front_face == faces && hit.t == 2);
                hits += !culled;
            }
        test_scene_finish(&scene);
    }
    assert_true(hits > 100);
}

/*
 * Closed intervals, starts inside, the callback's decisions, and boxes in rotated instances against points inside them.
 */
static void test_aabbs(void **state)
{
    (void)state;
    const float boxes[3][6] = {{1, -1, -1, 2, 1, 1}, {4, -1, -1, 6, 1, 1}, {8, 0, 0, 8, 0, 0}};
    struct geometry geometry = test_scene_aabbs(boxes, 3, 0);
    struct test_scene scene;
    struct ray ray = {.direction = {1, 0, 0}, .tmax = 10, .cull_mask = 1};
    struct ray_hit hit;
    test_scene_init(&scene);
    test_scene_add(&scene, &geometry, 1, 0);
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 1 && hit.primitive == 0 && hit.is_aabb);
    ray.tmin = 2;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 2 && hit.primitive == 0);
    ray.tmin = 3;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 4 && hit.primitive == 1);
    ray.tmin = 5;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 5 && hit.primitive == 1);
    ray.tmin = 7;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 8 && hit.primitive == 2);
    ray.tmax = 8;
    assert_true(traverse_all_ways(&scene.scene, &ray, &hit) && hit.t == 8);
    ray.tmax = nextafterf(8, 0);
    assert_false(traverse_all_ways(&scene.scene, &ray, &hit));
    ray = (struct ray){.direction = {1, 0, 0}, .tmax = 10, .cull_mask = 1};
    struct counting counting = {.verdict = CANDIDATE_ACCEPT, .t = 5.5f};
    struct traverse_options options = {.candidate = count_candidate, .context = &counting};
    assert_true(traverse(&scene.scene, &ray, &options, &hit, NULL) && hit.t == 5.5f && hit.primitive == 0);
    assert_int_equal(counting.seen, 2);
    counting = (struct counting){.verdict = CANDIDATE_ACCEPT, .t = 11};
    assert_false(traverse(&scene.scene, &ray, &options, &hit, NULL));
    counting = (struct counting){.verdict = CANDIDATE_IGNORE};
    assert_false(traverse(&scene.scene, &ray, &options, &hit, NULL));
    assert_int_equal(counting.seen, 3);
    counting = (struct counting){.verdict = CANDIDATE_ACCEPT_AND_END};
    assert_true(traverse(&scene.scene, &ray, &options, &hit, NULL));
    assert_int_equal(counting.seen, 1);
    ray.flags = RAY_SKIP_AABBS;
    assert_false(traverse(&scene.scene, &ray, &options, &hit, NULL));
    test_scene_finish(&scene);
}

static void test_aabb_instances(void **state)
{
    (void)state;
    enum { COUNT = 40 };
    struct random random = {23};
    float boxes[COUNT][6];
    struct test_instance instances[4];
    struct test_scene scene;
    for (int i = 0; i < COUNT; i++)
        for (int axis = 0; axis < 3; axis++) {
            boxes[i][axis] = (float)random_between(&random, -5, 5);
            boxes[i][3 + axis] = boxes[i][axis] + (i % 4 ? (float)random_between(&random, 0, 1) : 0);
        }
    struct geometry geometry = test_scene_aabbs((const float(*)[6])boxes, COUNT, 0);
    test_scene_init(&scene);
    test_scene_add(&scene, &geometry, 1, 0);
    for (int i = 0; i < 4; i++) {
        instances[i] = (struct test_instance){.mask = 1};
        test_scene_transform(&random, 0.6, 20, instances[i].transform);
    }
    test_scene_add_top(&scene, instances, 4);
    for (int i = 0; i < 4000; i++) {
        const float *m = instances[i % 4].transform, *box = boxes[random_next(&random) % COUNT];
        double inside[3];
        struct ray ray = {.tmax = 2, .cull_mask = 1};
        for (int axis = 0; axis < 3; axis++)
            inside[axis] = box[axis] + random_between(&random, 0.1, 0.9) * ((double)box[3 + axis] - box[axis]);
        if (box[0] == box[3])
            continue;
        for (int axis = 0; axis < 3; axis++) {
            ray.origin[axis] = (float)random_between(&random, -30, 30);
            ray.direction[axis] = (float)(m[4 * axis] * inside[0] + m[4 * axis + 1] * inside[1] +
                                          m[4 * axis + 2] * inside[2] + m[4 * axis + 3] - ray.origin[axis]);
        }
        struct ray_hit hit;
        assert_true(traverse_all_ways(&scene.scene, &ray, &hit));
        assert_true(hit.t <= 1.001f && hit.is_aabb);
    }
    test_scene_finish(&scene);
}

/* There is an any hit exactly if there is a closest hit, and it is no nearer. */
static void test_any_hit(void **state)
{
    (void)state;
    enum { COUNT = 500 };
    float(*corners)[3][3] = make_soup(5, COUNT, 10, 0.3);
    struct geometry geometries[2] = {test_scene_triangles((const float(*)[3][3])corners, COUNT / 2, GEOMETRY_OPAQUE),
                                     test_scene_triangles((const float(*)[3][3])corners + COUNT / 2, COUNT / 2, 0)};
    struct test_scene scene;
    struct random random = {29};
    test_scene_init(&scene);
    test_scene_add(&scene, geometries, 2, 0);
    uint64_t cost_any = 0, cost_closest = 0;
    for (int i = 0; i < 3000; i++) {
        struct ray ray = make_ray(&random, 10);
        struct ray_hit closest, any;
        struct traverse_counters counters = {0};
        bool is_hit = traverse(&scene.scene, &ray, NULL, &closest, &counters);
        cost_closest += counters.triangles;
        memset(&counters, 0, sizeof counters);
        ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
        assert_int_equal(traverse(&scene.scene, &ray, NULL, &any, &counters), is_hit);
        assert_true(!is_hit || any.t >= closest.t);
        cost_any += counters.triangles;
        struct counting counting = {.verdict = CANDIDATE_IGNORE};
        struct traverse_options options = {.candidate = count_candidate, .context = &counting};
        if (traverse(&scene.scene, &ray, &options, &any, NULL))
            assert_int_equal(any.geometry, 0);
        ray.flags = RAY_OPAQUE;
        counting.seen = 0;
        assert_int_equal(traverse(&scene.scene, &ray, &options, &any, NULL), is_hit);
        assert_int_equal(counting.seen, 0);
    }
    assert_true(cost_any < cost_closest);
    test_scene_finish(&scene);
    free(corners);
}

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
    assert_false(traverse(&(struct scene){0}, &ray, NULL, &hit, NULL));
    test_scene_init(&scene);
    test_scene_add(&scene, &empty, 1, 0);
    assert_false(traverse(&scene.scene, &ray, NULL, &hit, NULL));
    test_scene_add(&scene, &full, 1, 0);
    test_scene_add_top(&scene, instances, 2);
    assert_true(traverse(&scene.scene, &ray, NULL, &hit, NULL));
    assert_int_equal(hit.instance, 1);
    float positions[3][3];
    traverse_positions(&scene.scene, &hit, positions);
    assert_memory_equal(positions, corners, sizeof positions);

    const struct portable_view *without[2] = {scene.bottoms[0], NULL}, *nested[2] = {scene.scene.top, scene.scene.top};
    struct scene broken = scene.scene;
    broken.bottoms = without;
    assert_false(traverse(&broken, &ray, NULL, &hit, NULL));
    broken.bottom_count = 1;
    assert_false(traverse(&broken, &ray, NULL, &hit, NULL));
    broken = (struct scene){.top = scene.scene.top, .bottoms = nested, .bottom_count = 2};
    assert_false(traverse(&broken, &ray, NULL, &hit, NULL));
    broken = (struct scene){.top = scene.bottoms[1], .bottoms = scene.bottoms, .bottom_count = 2};
    assert_false(traverse(&broken, &ray, NULL, &hit, NULL));

    hit.t = -1;
    for (int i = 0; i < 6; i++) {
        struct ray bad = ray;
        bad.origin[2] = i == 0 ? NAN : i == 1 ? INFINITY : 0;
        bad.direction[2] = i == 2 ? 0 : i == 3 ? -INFINITY : 1;
        bad.tmin = i == 4 ? NAN : i == 5 ? 3 : 0;
        bad.tmax = i == 5 ? 2.5f : FLT_MAX;
        assert_false(traverse(&scene.scene, &bad, NULL, &hit, NULL));
    }
    ray.tmin = 2;
    assert_false(traverse(&scene.scene, &ray, NULL, &hit, NULL));
    ray = (struct ray){.direction = {0, 0, 1}, .tmax = 2, .cull_mask = 0xff};
    assert_false(traverse(&scene.scene, &ray, NULL, &hit, NULL));
    ray.tmax = nextafterf(2, 3);
    assert_true(traverse(&scene.scene, &ray, NULL, &hit, NULL));
    test_scene_finish(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_level),      cmocka_unit_test(test_instances),      cmocka_unit_test(test_magnitudes),
        cmocka_unit_test(test_watertight),     cmocka_unit_test(test_ties),           cmocka_unit_test(test_flags),
        cmocka_unit_test(test_aabbs),          cmocka_unit_test(test_aabb_instances), cmocka_unit_test(test_any_hit),
        cmocka_unit_test(test_nothing_to_hit),
    };
    return cmocka_run_group_tests_name("traverse", tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_leaf_round.c - tests that rays through structures of spheres and of linear swept spheres, in every walk, have
 * the answers of brute force.
 */
#include "tests/support/unit.h"

#include <float.h>

#include "tests/support/builder/round_judge.h"
#include "tests/support/builder/test_scene.h"
#include "tests/support/random.h"

/* Vertices with radii, and what is made of them. */
struct matter {
    float (*centres)[3], *radii;
    uint32_t *indices;
    uint32_t count;
};

enum kind { BALLS, ROD_LIST, CHAIN, KINDS };

/*
 * Makes vertices in the cube [-size, size)^3, of which rods and chains join those that follow one another: they are
 * near each other. Every seventh is far larger than the others, every eleventh has radius 0.
 */
static struct matter make_matter(struct random *random, uint32_t count, double size, double detail, bool is_chain)
{
    struct matter matter = {calloc(count, sizeof *matter.centres), calloc(count, sizeof *matter.radii),
                            calloc(count, sizeof *matter.indices), count};
    assert_true(matter.centres && matter.radii && matter.indices);
    double at[3] = {0, 0, 0};
    for (uint32_t i = 0; i < count; i++) {
        double step[3];
        random_point(random, step);
        if (is_chain ? i % 20 == 0 : i % 2 == 0)
            random_point(random, at);
        else
            for (int k = 0; k < 3; k++)
                at[k] += 4 * detail * step[k];
        for (int k = 0; k < 3; k++)
            matter.centres[i][k] = (float)(size * at[k]);
        matter.radii[i] = (float)(size * detail * random_between(random, 0.1, 1) * (i % 7 == 0 ? 4 : i % 11 != 0));
        matter.indices[i] = i;
    }
    return matter;
}

static void finish_matter(struct matter *matter)
{
    free(matter->centres);
    free(matter->radii);
    free(matter->indices);
}

static struct geometry geometry_of(const struct matter *matter, enum kind kind, bool has_caps, uint32_t flags)
{
    struct geometry geometry =
        {
            .type = kind == BALLS ? GEOMETRY_SPHERES : GEOMETRY_SWEPT_SPHERES,
            .flags = flags,
            .swept_spheres =
                {
                    .ends = {.vertex_format = 106,
                             .radius_format = 100,
                             .index_type = kind == CHAIN ? INDEX_UINT32 : INDEX_NONE,
                             .vertex_stride = 12,
                             .radius_stride = 4,
                             .index_stride = kind == CHAIN ? 4 : 0,
                             .vertices = {(const unsigned char *)matter->centres, (uint64_t)12 * matter->count},
                             .radii = {(const unsigned char *)matter->radii, (uint64_t)4 * matter->count},
                             .indices = {kind == CHAIN ? (const unsigned char *)matter->indices : NULL,
                                         kind == CHAIN ? (uint64_t)4 * matter->count : 0}},
                    .indexing_mode = kind == CHAIN ? SWEPT_SUCCESSIVE : SWEPT_LIST,
                    .end_caps_mode = has_caps ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE,
                },
            .range.primitive_count = kind == BALLS   ? matter->count
                                     : kind == CHAIN ? matter->count - 1
                                                     : matter->count / 2,
        };
    if (kind == BALLS) {
        const struct geometry_spheres ends = geometry.swept_spheres.ends;
        geometry.spheres = ends;
    }
    return geometry;
}

/* The answer of brute force. */
struct expected {
    struct round_answer answer;
    uint32_t geometry, primitive;
};

/* Tests all records of a structure, whose ids and vertices tests of the layout have checked. */
static struct expected find_expected(const struct portable_view *view, const double origin[3],
                                     const double direction[3], const struct ray *ray)
{
    const struct portable_round *records = view->records;
    struct expected expected = {.answer.is_hit = false};
    bool is_doubtful = false;
    uint32_t best = UINT32_MAX;
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const float *vertex = view->vertices + 4 * (size_t)records[i].vertex;
        const uint32_t id = records[i].id;
        const struct round_answer answer =
            view->header->content == PORTABLE_SPHERES
                ? round_judge_sphere(origin, direction, ray->tmin, ray->tmax, vertex)
                : round_judge_swept(origin, direction, ray->tmin, ray->tmax, vertex, vertex + 4, id >> 29 & 3);
        is_doubtful |= answer.is_doubtful;
        if (!answer.is_hit)
            continue;
        const quad apart = expected.answer.is_hit ? round_judge_size(answer.t - expected.answer.t) : answer.t;
        if (apart <= 1e-9L * answer.t)
            is_doubtful = true; /* the ids decide, if they are equal to 32 bits */
        if (!expected.answer.is_hit || answer.t < expected.answer.t) {
            expected.answer = answer;
            best = id & PORTABLE_ID_MASK;
        }
    }
    expected.answer.is_doubtful = is_doubtful;
    if (expected.answer.is_hit) {
        expected.geometry = portable_geometry_of(view, best);
        expected.primitive = best - view->geometries[expected.geometry].first_primitive;
    }
    return expected;
}

static struct ray make_ray(struct random *random, double size)
{
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff};
    double from[3], to[3];
    const bool is_outside = random_next(random) % 2;
    const int axis = (int)(random_next(random) % 12);
    random_point(random, from);
    random_point(random, to);
    for (int i = 0; i < 3; i++) {
        ray.origin[i] = (float)(size * (is_outside ? 3 : 1) * from[i]);
        ray.direction[i] = (float)(size * to[i] - (is_outside ? ray.origin[i] : 0));
        if (axis < 3)
            ray.direction[i] = i == axis ? -ray.origin[i] : 0;
    }
    if (random_next(random) % 4 == 0) {
        ray.tmin = (float)random_between(random, 0, 0.5);
        ray.tmax = ray.tmin + (float)random_between(random, 0, 0.5);
    }
    return ray;
}

/* A scene, and the same with unpacked nodes. */
struct bed {
    struct test_scene scene;
    struct scene unpacked;
    struct unpacked_node *nodes[TEST_SCENE_BOTTOMS];
};

static void unpack(struct bed *bed)
{
    bed->unpacked = bed->scene.scene;
    for (uint32_t i = 0; i < bed->scene.scene.bottom_count; i++) {
        const struct portable_view *view = bed->scene.bottoms[i];
        bed->nodes[i] = NULL;
        if (view->header->content < PORTABLE_SPHERES)
            continue;
        assert_true(unpacked_takes(view->header->content));
        bed->nodes[i] = calloc(view->header->node_count + 1, sizeof *bed->nodes[i]);
        assert_non_null(bed->nodes[i]);
        unpacked_fill(view, bed->nodes[i]);
    }
    bed->unpacked.unpacked = (const struct unpacked_node *const *)bed->nodes;
}

static void finish_bed(struct bed *bed)
{
    for (uint32_t i = 0; i < bed->scene.scene.bottom_count; i++)
        free(bed->nodes[i]);
    test_scene_finish(&bed->scene);
}

/* Traces in every way; the answers must be the same to the last bit. */
static bool trace_all_ways(const struct bed *bed, const struct ray *ray, struct ray_hit *ret_hit)
{
    struct ray any = *ray;
    struct ray_hit hit;
    const bool is_hit = traverse(&bed->scene.scene, ray, NULL, ret_hit, NULL);
    for (int way = 1; way < 16; way++) {
        const struct traverse_options options = {
            .flip_order = way & 1, .baseline_only = way & 2, .exact_only = way & 4};
        const struct scene *scene = way & 8 ? &bed->unpacked : &bed->scene.scene;
        assert_int_equal(traverse(scene, ray, &options, &hit, NULL), is_hit);
        if (is_hit)
            assert_true(test_scene_same_hit(&hit, ret_hit));
    }
    any.flags |= RAY_TERMINATE_ON_FIRST_HIT;
    assert_int_equal(traverse(&bed->scene.scene, &any, NULL, &hit, NULL), is_hit);
    assert_int_equal(traverse(&bed->unpacked, &any, NULL, &hit, NULL), is_hit);
    return is_hit;
}

static void check_hit(const struct ray_hit *hit, const struct expected *expected)
{
    assert_true(round_judge_size(hit->t - expected->answer.t) <= 1.2e-7L * expected->answer.t);
    assert_true(round_judge_size(hit->u - expected->answer.u) <= 1e-6L);
    assert_true(hit->v == 0 && hit->front_face && !hit->is_aabb);
    assert_int_equal(hit->geometry, expected->geometry);
    assert_int_equal(hit->primitive, expected->primitive);
}

/* One level of two geometries. */
static void test_one_level(void **state)
{
    (void)state;
    enum { COUNT = 160, RAYS = 2000 };
    struct random random = {1};
    for (enum kind kind = BALLS; kind < KINDS; kind++)
        for (int manner = 0; manner < 4; manner++) {
            const double size = manner == 2 ? 1e12 : 10;
            struct matter matter = make_matter(&random, COUNT, size, manner % 2 ? 0.2 : 0.05, kind == CHAIN);
            const struct matter rest = {matter.centres + COUNT / 4 * 2, matter.radii + COUNT / 4 * 2, matter.indices,
                                        COUNT - COUNT / 4 * 2},
                                first = {matter.centres, matter.radii, matter.indices, COUNT / 4 * 2};
            const struct geometry geometries[2] = {geometry_of(&first, kind, manner != 1, 0),
                                                   geometry_of(&rest, kind, manner != 1, GEOMETRY_OPAQUE)};
            struct bed bed;
            int hits = 0, sure = 0;
            test_scene_init(&bed.scene);
            test_scene_add(&bed.scene, geometries, 2, 0);
            unpack(&bed);
            for (int i = 0; i < RAYS; i++) {
                const struct ray ray = make_ray(&random, size);
                double origin[3], direction[3];
                struct ray_hit hit;
                for (int k = 0; k < 3; k++) {
                    origin[k] = ray.origin[k];
                    direction[k] = ray.direction[k];
                }
                const struct expected expected = find_expected(bed.scene.bottoms[0], origin, direction, &ray);
                const bool is_hit = trace_all_ways(&bed, &ray, &hit);
                if (expected.answer.is_doubtful)
                    continue;
                sure++;
                assert_int_equal(is_hit, expected.answer.is_hit);
                hits += is_hit;
                if (is_hit)
                    check_hit(&hit, &expected);
            }
            assert_true(sure > RAYS - RAYS / 50 && hits > RAYS / 30);
            finish_bed(&bed);
            finish_matter(&matter);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_level),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

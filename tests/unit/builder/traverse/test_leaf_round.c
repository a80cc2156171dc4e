/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_leaf_round.c - tests that rays through structures of spheres and of linear swept spheres, in every walk, have
 * the answers of brute force; under instances beside triangles, with opacity, masks, skipped kinds and callbacks.
 */
#include "tests/support/unit.h"

#include <float.h>

#include "builder/traverse/traverse_group.h"
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
        bed->nodes[i] = calloc(1, unpacked_size(view->header) + 1);
        assert_non_null(bed->nodes[i]);
        unpacked_fill(view, bed->nodes[i]);
    }
    bed->unpacked.unpacked = (const struct unpacked_node *const *)bed->nodes;
    traverse_settle(&bed->unpacked);
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
    assert_int_equal(traverse(&bed->unpacked, ray, NULL, &hit, NULL), is_hit); /* the shorter way of plain rays */
    if (is_hit)
        assert_true(test_scene_same_hit(&hit, ret_hit));
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

enum { GROUPS = 24 };

/*
 * Makes the rays of a group: from one point to its neighbours; from there in one direction; away from a surface; or
 * from anywhere. Some have no part along an axis, or a tmin that packets do not take.
 */
static void make_group(struct random *random, const struct bed *bed, double size, uint32_t group,
                       struct ray ret_rays[TRAVERSE_GROUP])
{
    const struct ray first = make_ray(random, size);
    for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
        struct ray *ray = &ret_rays[i], other = make_ray(random, size);
        struct ray_hit hit;
        *ray = group % 4 == 3 ? other : first;
        if (group % 4 != 3)
            ray->tmax = i % 5 == 0 ? first.tmax : FLT_MAX;
        for (int k = 0; k < 3; k++) {
            ray->direction[k] += group % 4 == 0 ? 0.05f * other.direction[k] : 0;
            ray->origin[k] += group % 4 == 1 ? 0.03f * other.origin[k] : 0;
        }
        if (group % 4 == 2 && traverse(&bed->scene.scene, &other, NULL, &hit, NULL))
            for (int k = 0; k < 3; k++) {
                ray->origin[k] = other.origin[k] + hit.t * other.direction[k];
                ray->direction[k] = other.direction[(k + 1) % 3];
            }
        if (i % 32 == 7)
            ray->direction[i % 3] = 0;
        if (i % 32 == 9)
            ray->tmin = -0.5f;
        if (i % 32 == 11)
            ray->flags = RAY_CULL_OPAQUE;
    }
}

/* Traces groups of rays, most of them in packets. Returns how many hit. */
static int compare_groups(struct random *random, const struct bed *bed, double size, uint32_t flags)
{
    struct traverse_stream stream = {.scene = &bed->unpacked};
    struct ray rays[TRAVERSE_GROUP];
    struct ray_hit hits[TRAVERSE_GROUP], expected;
    int found = 0;
    for (uint32_t group = 0; group < GROUPS; group++) {
        const uint32_t count = group % 7 == 6 ? 5 : TRAVERSE_GROUP;
        make_group(random, bed, size, group, rays);
        for (uint32_t i = 0; i < count; i++)
            rays[i].flags |= flags;
        stream.alone = group % 8 == 7 ? count : 0;
        const uint64_t is_hit = traverse_group(&stream, rays, count, hits);
        for (uint32_t i = 0; i < count; i++) {
            const bool is_expected =
                traverse(flags ? &bed->unpacked : &bed->scene.scene, &rays[i], NULL, &expected, NULL);
            assert_int_equal(is_hit >> i & 1, is_expected);
            found += is_expected;
            if (is_expected)
                assert_true(test_scene_same_hit(&hits[i], &expected));
        }
    }
    return found;
}

/* Rays in groups have the answers of single rays, to the last bit. */
static void test_groups(void **state)
{
    (void)state;
    enum { COUNT = 3000 };
    struct random random = {3};
    for (enum kind kind = BALLS; kind < KINDS; kind++)
        for (int manner = 0; manner < 4; manner++) {
            const double size = manner == 2 ? 1e12 : 10;
            struct matter matter = make_matter(&random, COUNT, size, manner % 2 ? 0.05 : 0.01, kind == CHAIN);
            const struct geometry geometry = geometry_of(&matter, kind, manner != 1, manner == 3 ? GEOMETRY_OPAQUE : 0);
            struct bed bed;
            test_scene_init(&bed.scene);
            test_scene_add(&bed.scene, &geometry, 1, 0);
            unpack(&bed);
            const struct traverse_stream stream = {.scene = &bed.unpacked};
            assert_int_equal(traverse_groups_pay(&stream), boxtest_has_avx2());
            const int found = compare_groups(&random, &bed, size, 0);
            assert_true(found > GROUPS * TRAVERSE_GROUP / 20 && found < GROUPS * TRAVERSE_GROUP * 19 / 20);
            compare_groups(&random, &bed, size, RAY_TERMINATE_ON_FIRST_HIT);
            finish_bed(&bed);
            finish_matter(&matter);
        }
}

enum { INSTANCES = 6 };

/*
 * A top level over a sphere of radius 1, a rod with caps from x = -2 to 2 of radius 1, and a triangle. Their instances
 * stand along x, 10 apart and each kind twice, scaled by 2, the second of each kind with mask 2.
 */
struct row {
    struct bed bed;
    struct test_instance instances[INSTANCES];
};

static void make_row(struct row *row, uint32_t flags)
{
    static const float corners[1][3][3] = {{{0, -4, -4}, {0, 4, -4}, {0, 0, 4}}};
    float centres[2][3] = {{-2, 0, 0}, {2, 0, 0}}, radii[2] = {1, 1}, origin[1][3] = {{0, 0, 0}};
    const struct matter ball = {origin, radii, NULL, 1}, rod = {centres, radii, NULL, 2};
    const struct geometry geometries[3] = {geometry_of(&ball, BALLS, true, flags),
                                           geometry_of(&rod, ROD_LIST, true, flags),
                                           test_scene_triangles(corners, 1, flags)};
    test_scene_init(&row->bed.scene);
    for (int i = 0; i < 3; i++)
        test_scene_add(&row->bed.scene, &geometries[i], 1, 0);
    for (uint32_t i = 0; i < INSTANCES; i++)
        row->instances[i] = (struct test_instance){.transform = {2, 0, 0, 10.0f * (float)i, 0, 2, 0, 0, 0, 0, 2, 0},
                                                   .mask = i < 3 ? 1 : 2,
                                                   .custom_index = 100 + i,
                                                   .bottom = i % 3};
    test_scene_add_top(&row->bed.scene, row->instances, INSTANCES);
    unpack(&row->bed);
}

/* A ray along z from z = -20, through the middle of an instance or beside it, or along x through all. */
static struct ray ray_through(float x, float y)
{
    return (struct ray){.origin = {x, y, -20}, .direction = {0, 0, 1}, .tmax = FLT_MAX, .cull_mask = 0xff};
}

static void test_instances(void **state)
{
    (void)state;
    struct row row;
    struct ray_hit hit;
    make_row(&row, GEOMETRY_OPAQUE);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        if (i % 3 == 2)
            continue; /* a triangle, seen edge-on */
        struct ray ray = ray_through(10 * (float)i + 0.5f, 0);
        assert_true(trace_all_ways(&row.bed, &ray, &hit));
        assert_int_equal(hit.instance, i);
        assert_int_equal(hit.custom_index, 100 + i);
        assert_true(fabsf(hit.t - (i % 3 == 0 ? 20 - sqrtf(4 - 0.25f) : 18)) < 1e-5f); /* as in world space */
        assert_true(fabsf(hit.u - (i % 3 == 0 ? 0 : 0.5f + 0.5f / 8)) < 1e-6f);
        ray.cull_mask = i < 3 ? 2 : 1;
        assert_false(trace_all_ways(&row.bed, &ray, &hit));
        ray = ray_through(10 * (float)i, 2.01f); /* beside it */
        assert_false(trace_all_ways(&row.bed, &ray, &hit));
    }
    /* Along x the sphere comes first, from outside; from its inside the rod; without both the triangle. */
    struct ray ray = {.origin = {-20, 0, 0}, .direction = {1, 0, 0}, .tmax = FLT_MAX, .cull_mask = 1};
    assert_true(trace_all_ways(&row.bed, &ray, &hit) && hit.instance == 0 && hit.t == 18);
    ray.origin[0] = 0;
    assert_true(trace_all_ways(&row.bed, &ray, &hit) && hit.instance == 1 && hit.t == 4 && hit.u == 0);
    ray.origin[0] = 10;
    assert_true(trace_all_ways(&row.bed, &ray, &hit) && hit.instance == 2 && hit.t == 10);
    finish_bed(&row.bed);
}

/* Facing does not concern round shapes; SKIP_TRIANGLES skips them, SKIP_AABBS does not. */
static void test_flags(void **state)
{
    (void)state;
    static const struct {
        uint32_t flags;
        bool opaque_hits, other_hits; /* by whether the geometry is opaque */
    } cases[] = {
        {RAY_CULL_BACK_FACING, true, true},
        {RAY_CULL_FRONT_FACING, true, true},
        {RAY_SKIP_AABBS, true, true},
        {RAY_SKIP_TRIANGLES, false, false},
        {RAY_CULL_OPAQUE, false, true},
        {RAY_CULL_NO_OPAQUE, true, false},
        {RAY_OPAQUE | RAY_CULL_OPAQUE, false, false},
        {RAY_NO_OPAQUE | RAY_CULL_NO_OPAQUE, false, false},
    };
    for (int opaque = 0; opaque < 2; opaque++) {
        struct row row;
        make_row(&row, opaque ? GEOMETRY_OPAQUE : 0);
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
            for (float x = 0; x <= 10; x += 10) {
                struct ray ray = ray_through(x, 0.5f);
                struct ray_hit hit;
                ray.flags = cases[i].flags;
                assert_int_equal(trace_all_ways(&row.bed, &ray, &hit),
                                 opaque ? cases[i].opaque_hits : cases[i].other_hits);
            }
        finish_bed(&row.bed);
    }
}

/* The candidates of a ray. */
struct candidates {
    uint32_t count, seen; /* their instances, as bits */
    uint32_t accepted; /* the instance that is accepted */
};

static enum candidate_verdict judge(void *context, const struct ray *ray, const struct candidate_space *space,
                                    struct ray_hit *hit)
{
    struct candidates *candidates = context;
    (void)ray;
    assert_true(!space->is_opaque && !hit->is_aabb && (hit->instance % 3 == 2 || (hit->front_face && hit->v == 0)));
    assert_true(hit->t > 0 && hit->t < FLT_MAX && space->object_to_world);
    candidates->count++;
    candidates->seen |= 1u << hit->instance;
    return hit->instance == candidates->accepted ? CANDIDATE_ACCEPT : CANDIDATE_IGNORE;
}

/* Shapes that are not opaque are candidates with their distances; opaque ones are hits without a question. */
static void test_callback(void **state)
{
    (void)state;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct row row;
        make_row(&row, opaque ? GEOMETRY_OPAQUE : 0);
        for (uint32_t accepted = 0; accepted < INSTANCES; accepted++) {
            const struct ray ray = {
                .origin = {-20, 0.25f, 0}, .direction = {1, 0, 0}, .tmax = FLT_MAX, .cull_mask = 0xff};
            struct candidates candidates = {.accepted = accepted};
            const struct traverse_options options = {.candidate = judge, .context = &candidates};
            struct ray_hit hit;
            if (accepted % 3 == 2)
                continue;
            assert_true(traverse(&row.bed.unpacked, &ray, &options, &hit, NULL));
            assert_int_equal(hit.instance, opaque ? 0 : accepted);
            assert_true(opaque ? candidates.count == 0 : candidates.seen >> accepted & 1);
        }
        finish_bed(&row.bed);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_level), cmocka_unit_test(test_groups),   cmocka_unit_test(test_instances),
        cmocka_unit_test(test_flags),     cmocka_unit_test(test_callback),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_packet_times.c - tests that rays of different times through motion triangles have the same answers in groups, to
 * the last bit, as alone, and as through the portable nodes (of which rays that search any hit may find another one).
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/traverse_group.h"
#include "tests/support/builder/test_scene.h"
#include "tests/support/random.h"

enum { TRIANGLES = 600, RAYS = TRAVERSE_GROUP * 16 };

/* Where triangles are, and how they move. */
struct shape {
    const char *name;
    double size; /* of the scene */
    double detail; /* of triangles, relative to the scene */
    double speed; /* relative to the scene */
    double place; /* of the scene, relative to its size */
    bool is_shared; /* all move alike, else each corner moves by itself */
};

static const struct shape shapes[] = {
    {"slow", 10, 0.1, 0.02, 0, true},        {"fast", 10, 0.1, 1, 0, true},      {"torn", 10, 0.05, 0.3, 0, false},
    {"far away", 10, 0.1, 0.05, 1e4, false}, {"tiny", 1e-19, 0.1, 0.1, 0, true}, {"huge", 1e25, 0.1, 0.1, 0, false},
};

struct bed {
    struct test_scene scene;
    float keys[2][TRIANGLES][3][3];
    struct unpacked_moving_node *nodes;
    const struct unpacked_node *first;
    struct scene unpacked;
};

static void make_keys(struct bed *bed, const struct shape *shape, struct random *random)
{
    double all[3];
    random_point(random, all);
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        double centre[3];
        random_point(random, centre);
        for (int k = 0; k < 3; k++) {
            double offset[3], moved[3];
            random_point(random, offset);
            random_point(random, moved);
            for (int axis = 0; axis < 3; axis++) {
                const double start = shape->size * (centre[axis] + shape->detail * offset[axis] + shape->place),
                             way = shape->size * shape->speed * (shape->is_shared ? all[axis] : moved[axis]);
                bed->keys[0][i][k][axis] = (float)start;
                bed->keys[1][i][k][axis] = (float)(start + way);
            }
        }
    }
}

/* Builds a structure of the triangles that were made. */
static void bed_build(struct bed *bed)
{
    struct geometry geometry = test_scene_triangles((const float(*)[3][3])bed->keys[0], TRIANGLES, GEOMETRY_OPAQUE);
    geometry.type = GEOMETRY_MOVING_TRIANGLES;
    geometry.triangles.end_vertices = (struct bytes){(const unsigned char *)bed->keys[1], sizeof bed->keys[1]};
    test_scene_init(&bed->scene);
    bed->scene.flags = BUILD_MOTION;
    test_scene_add(&bed->scene, &geometry, 1, 0);
    const struct portable_view *view = bed->scene.bottoms[0];
    bed->nodes = malloc(unpacked_moving_size(view->header));
    assert_non_null(bed->nodes);
    unpacked_moving_fill(view, bed->nodes);
    bed->first = &bed->nodes->start;
    bed->unpacked = bed->scene.scene;
    bed->unpacked.unpacked = &bed->first;
    traverse_settle(&bed->unpacked);
}

static void bed_open(struct bed *bed, const struct shape *shape, struct random *random)
{
    make_keys(bed, shape, random);
    bed_build(bed);
}

static void bed_close(struct bed *bed)
{
    free(bed->nodes);
    test_scene_finish(&bed->scene);
}

/* Returns a time: some rays have that of their neighbours, and some an end of the interval. */
static float choose_time(struct random *random, uint32_t index)
{
    static const float ends[] = {0, 1, 0.5f, 0x1p-149f};
    if (index / TRAVERSE_GROUP % 4 == 3)
        return ends[index % 4];
    return (float)random_between(random, 0, 1);
}

/*
 * Rays of a group: side by side from one point outside, or from nearly one point inside into one octant or into all of
 * them.
 */
static void make_rays(const struct bed *bed, uint32_t flags, struct random *random, struct ray ret_rays[RAYS])
{
    const float *bounds = bed->scene.bottoms[0]->header->bounds;
    for (uint32_t i = 0; i < RAYS; i++) {
        const uint32_t group = i / TRAVERSE_GROUP, way = group % 3;
        struct ray *ray = &ret_rays[i];
        double turn[3];
        random_point(random, turn);
        *ray = (struct ray){.tmax = FLT_MAX, .cull_mask = 0xff, .flags = flags, .time = choose_time(random, i)};
        for (int axis = 0; axis < 3; axis++) {
            const double size = (double)bounds[3 + axis] - bounds[axis], middle = (double)bounds[axis] + 0.5 * size,
                         aim = middle + size * ((axis == 0   ? i % 8
                                                 : axis == 1 ? i / 8 % 8
                                                             : 0) /
                                                    64.0 -
                                                0.1);
            ray->origin[axis] =
                (float)(way == 0 ? middle - size * (axis == 2 ? 2 : 0.7) : middle + 0.2 * size / (1 + group));
            ray->direction[axis] = (float)(way == 0   ? aim - ray->origin[axis]
                                           : way == 1 ? size * (1.1 + turn[axis])
                                                      : size * turn[axis]);
        }
        if (group % 5 == 4)
            ray->tmax = (float)random_between(random, 0.2, 2);
    }
}

static void expect_same(bool is_hit, const struct ray_hit *hit, bool is_expected, const struct ray_hit *expected)
{
    assert_int_equal(is_hit, is_expected);
    if (is_expected)
        assert_true(test_scene_same_hit(hit, expected));
}

/* Returns how many rays hit, and adds how many visits were made in packets. */
static uint32_t compare(const struct bed *bed, const struct ray rays[RAYS], uint64_t *visits_together)
{
    uint32_t found = 0;
    for (uint32_t begin = 0; begin < RAYS; begin += TRAVERSE_GROUP) {
        struct traverse_stream stream = {.scene = &bed->unpacked};
        struct ray_hit hits[TRAVERSE_GROUP], turned[TRAVERSE_GROUP], alone, expected;
        uint64_t turns_hit = 0, turns = 0;
        const uint64_t is_hit = traverse_group(&stream, rays + begin, TRAVERSE_GROUP, hits);
        *visits_together += stream.visits_together;
        if (traverse_groups_pay(&stream))
            turns = turns_avx2_trace(&stream, rays + begin, UINT64_MAX, turned, &turns_hit);
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
            const bool is_expected = traverse(&bed->scene.scene, &rays[begin + i], NULL, &expected, NULL);
            const bool is_alone = traverse(&bed->unpacked, &rays[begin + i], NULL, &alone, NULL);
            if (rays[begin + i].flags & RAY_TERMINATE_ON_FIRST_HIT)
                assert_int_equal(is_alone, is_expected);
            else
                expect_same(is_alone, &alone, is_expected, &expected);
            expect_same(is_hit >> i & 1, &hits[i], is_alone, &alone);
            if (turns >> i & 1)
                expect_same(turns_hit >> i & 1, &turned[i], is_alone, &alone);
            found += is_expected;
        }
    }
    return found;
}

static void rays_have_the_answers_of_single_rays(void **state)
{
    static struct bed bed;
    static struct ray rays[RAYS];
    struct random random = {11};
    (void)state;
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++)
        for (uint32_t any = 0; any < 2; any++) {
            uint64_t visits = 0;
            bed_open(&bed, &shapes[i], &random);
            const struct traverse_stream stream = {.scene = &bed.unpacked};
            make_rays(&bed, any ? RAY_TERMINATE_ON_FIRST_HIT : 0, &random, rays);
            const uint32_t found = compare(&bed, rays, &visits);
            if (found < RAYS / 16 || found > RAYS - RAYS / 16)
                fail_msg("%s: %u of %d rays hit", shapes[i].name, found, RAYS);
            assert_true(!traverse_groups_pay(&stream) || visits > 0 || shapes[i].size > 1e20 || shapes[i].size < 1e-10);
            bed_close(&bed);
        }
}

/* A tile of rays whose times differ a little visits hardly more nodes than one whose rays have one time. */
static void near_times_cost_few_visits(void **state)
{
    static struct bed bed;
    static struct ray rays[RAYS];
    struct random random = {3};
    struct ray_hit hits[TRAVERSE_GROUP];
    uint64_t visits[2] = {0, 0};
    (void)state;
    bed_open(&bed, &shapes[0], &random);
    make_rays(&bed, 0, &random, rays);
    for (uint32_t differ = 0; differ < 2; differ++) {
        struct traverse_counters counters = {0, 0, 0};
        struct traverse_stream stream = {.scene = &bed.unpacked, .counters = &counters};
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++)
            rays[i].time = 0.5f + (differ ? 1e-3f * (float)(i % 7) : 0);
        traverse_group(&stream, rays, TRAVERSE_GROUP, hits);
        visits[differ] = counters.nodes;
    }
    assert_true(visits[0] > 0 && visits[1] < visits[0] + visits[0] / 8);
    bed_close(&bed);
}

/* A grid of squares, two triangles each, in a plane that moves by 8 along x. */
static void make_grid(struct bed *bed)
{
    static const int corner[2][3][2] = {{{0, 0}, {1, 0}, {1, 1}}, {{0, 0}, {1, 1}, {0, 1}}};
    for (uint32_t i = 0; i < TRIANGLES; i++)
        for (int key = 0; key < 2; key++)
            for (int k = 0; k < 3; k++) {
                float *at = bed->keys[key][i][k];
                at[0] = (float)((int)(i / 2 % 16) - 8 + corner[i % 2][k][0] + 8 * key);
                at[1] = (float)((int)(i / 32) - 8 + corner[i % 2][k][1]);
                at[2] = 1;
            }
}

/* Rays that meet edges and corners exactly, at times at which these have whole coordinates. */
static void edges_are_decided_as_by_single_rays(void **state)
{
    static struct bed bed;
    static struct ray rays[RAYS];
    struct random random = {5};
    uint64_t visits = 0;
    (void)state;
    make_grid(&bed);
    bed_build(&bed);
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i] = (struct ray){.origin = {(float)(i % 8) - 8, (float)(i / 8 % 8) - 8, -3},
                               .direction = {(float)(1 + i / 64 % 2), 1, 1},
                               .tmax = FLT_MAX,
                               .cull_mask = 0xff,
                               .time = (float)(random_next(&random) % 9) / 8};
    assert_true(compare(&bed, rays, &visits) > RAYS / 4);
    bed_close(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_have_the_answers_of_single_rays),
        cmocka_unit_test(edges_are_decided_as_by_single_rays),
        cmocka_unit_test(near_times_cost_few_visits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

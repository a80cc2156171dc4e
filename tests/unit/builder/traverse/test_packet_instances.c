/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_packet_instances.c - tests that rays through top levels of motion instances have the same answers in groups, to
 * the last bit, as alone, and as through the portable nodes (of which rays that search any hit may find another one).
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/format/srt.h"
#include "builder/traverse/traverse_group.h"
#include "tests/support/builder/test_scene.h"
#include "tests/support/random.h"

enum { TRIANGLES = 400, INSTANCES = 60, RAYS = TRAVERSE_GROUP * 24, RECORD_WORDS = MOTION_RECORD_STRIDE / 4 };

/* The bottom levels: triangles, triangles that move, boxes. */
enum { STILL, MOVING, BOXES, BOTTOMS };

union word {
    uint32_t number;
    float value;
};

struct bed {
    struct test_scene scene;
    float corners[2][TRIANGLES][3][3];
    float boxes[4][6];
    union word records[INSTANCES][RECORD_WORDS];
    struct portable_view views[BOTTOMS];
    const struct portable_view *bottoms[BOTTOMS];
    struct unpacked_node *still;
    struct unpacked_triangles *triangles;
    struct unpacked_moving_node *moving, *top;
    const struct unpacked_node *nodes[BOTTOMS];
    struct scene unpacked;
};

static void fill_corners(struct bed *bed, struct random *random)
{
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        double centre[3];
        random_point(random, centre);
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++) {
                const float at = (float)(centre[axis] + random_between(random, -0.2, 0.2));
                bed->corners[0][i][k][axis] = at;
                bed->corners[1][i][k][axis] = at + (float)random_between(random, -0.1, 0.1);
            }
    }
    for (uint32_t i = 0; i < 4; i++)
        for (int axis = 0; axis < 3; axis++) {
            bed->boxes[i][axis] = (float)random_between(random, -1, 0.5);
            bed->boxes[i][3 + axis] = bed->boxes[i][axis] + 0.3f;
        }
}

static void fill_matrix(struct random *random, double place, union word *to)
{
    float matrix[12];
    test_scene_transform(random, 1, place, matrix);
    for (int i = 0; i < 12; i++)
        to[i].value = matrix[i];
}

static void fill_srt(struct random *random, double place, bool turns_over, const union word *other, union word *to)
{
    static const int moves[3] = {SRT_TX, SRT_TY, SRT_TZ}, sizes[3] = {SRT_SX, SRT_SY, SRT_SZ};
    for (int i = 0; i < SRT_NUMBERS; i++)
        to[i].value = (float)random_between(random, -0.2, 0.2);
    for (int i = 0; i < 3; i++) {
        to[sizes[i]].value = (float)random_between(random, 0.5, 1.5);
        to[moves[i]].value = (float)random_between(random, -place, place);
    }
    for (int i = SRT_QX; i <= SRT_QW; i++)
        to[i].value = turns_over ? -other[i].value : (float)random_between(random, -1, 1);
}

/* Fills the records: all types of motion, masks, flags, quaternions that are zero at half time. */
static void fill_records(struct bed *bed, struct random *random, double place)
{
    static const uint32_t fields[] = {[MOTION_STATIC] = 14, [MOTION_MATRIX] = 26, [MOTION_SRT] = 34};
    memset(bed->records, 0, sizeof bed->records);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        union word *record = bed->records[i];
        const uint32_t type = i % 5 == 0 ? MOTION_STATIC : i % 5 < 3 ? MOTION_MATRIX : MOTION_SRT;
        record[0].number = type;
        if (type == MOTION_SRT) {
            fill_srt(random, place, false, NULL, record + 2);
            fill_srt(random, place, i % 10 == 3, record + 2, record + 18);
        } else {
            fill_matrix(random, place, record + 2);
            if (type == MOTION_MATRIX)
                fill_matrix(random, place, record + 14);
        }
        record[fields[type]].number = i | (i % 7 ? 0xffu : 1u << i % 8) << 24;
        record[fields[type] + 1].number = (i % 12) << 24;
        record[fields[type] + 2].number = 0x1000 + (i % 6 == 4 ? MOVING : i % 6 == 5 ? BOXES : STILL);
    }
}

static struct unpacked_moving_node *unpack_moving(const struct portable_view *view)
{
    struct unpacked_moving_node *nodes = malloc(unpacked_moving_size(view->header));
    assert_non_null(nodes);
    unpacked_moving_fill(view, nodes);
    return nodes;
}

static void unpack(struct bed *bed)
{
    const struct scene *scene = &bed->scene.scene;
    for (int i = 0; i < BOTTOMS; i++) {
        bed->views[i] = *bed->scene.bottoms[i];
        bed->bottoms[i] = &bed->views[i];
    }
    bed->still = calloc(bed->views[STILL].header->node_count, sizeof *bed->still);
    bed->triangles = malloc(unpacked_triangles_size(bed->views[STILL].header->record_count));
    assert_true(bed->still && bed->triangles);
    unpacked_fill(&bed->views[STILL], bed->still);
    unpacked_store_corners(&bed->views[STILL], bed->triangles);
    bed->moving = unpack_moving(&bed->views[MOVING]);
    bed->top = unpack_moving(scene->top);
    bed->nodes[STILL] = bed->still;
    bed->nodes[MOVING] = &bed->moving->start;
    bed->nodes[BOXES] = NULL;
    bed->unpacked = *scene;
    bed->unpacked.bottoms = bed->bottoms;
    bed->unpacked.unpacked = bed->nodes;
    bed->unpacked.unpacked_top = &bed->top->start;
    traverse_settle(&bed->unpacked);
}

static void bed_open(struct bed *bed, struct random *random, double place)
{
    fill_corners(bed, random);
    fill_records(bed, random, place);
    const struct geometry still = test_scene_triangles((const float(*)[3][3])bed->corners[0], TRIANGLES, 1),
                          boxes = test_scene_aabbs((const float(*)[6])bed->boxes, 4, 0);
    struct geometry moving = still;
    moving.type = GEOMETRY_MOVING_TRIANGLES;
    moving.triangles.end_vertices = (struct bytes){(const unsigned char *)bed->corners[1], sizeof bed->corners[1]};
    test_scene_init(&bed->scene);
    test_scene_add(&bed->scene, &still, 1, 0);
    bed->scene.flags = BUILD_MOTION;
    test_scene_add(&bed->scene, &moving, 1, 0);
    bed->scene.flags = 0;
    test_scene_add(&bed->scene, &boxes, 1, 0);
    bed->scene.flags = BUILD_MOTION;
    test_scene_add_motion_top(&bed->scene, (const unsigned char *)bed->records, INSTANCES);
    unpack(bed);
}

static void bed_close(struct bed *bed)
{
    free(bed->still);
    free(bed->triangles);
    free(bed->moving);
    free(bed->top);
    test_scene_finish(&bed->scene);
}

/* Rays side by side from outside, and from one point inside: of one time, of near times, of any times. */
static void make_rays(uint32_t flags, double place, struct random *random, struct ray ret_rays[RAYS])
{
    for (uint32_t i = 0; i < RAYS; i++) {
        const uint32_t group = i / TRAVERSE_GROUP, times = group % 3;
        const float time = (float)random_between(random, 0, 1), near = 0.3f + time / 64;
        struct ray *ray = &ret_rays[i];
        double turn[3];
        random_point(random, turn);
        *ray = (struct ray){.tmax = FLT_MAX, .cull_mask = 0xff, .flags = flags};
        ray->time = times == 0 ? (group % 2 ? 0.5f : 0.7f) : times == 1 ? near : time;
        for (int axis = 0; axis < 3; axis++) {
            const double aim = place * ((axis == 0 ? i % 8 : axis == 1 ? i / 8 % 8 : 0) / 16.0 - 0.3);
            ray->origin[axis] = (float)(group % 2 ? place * (axis == 2 ? -4 : -1) : 0.1 * place);
            ray->direction[axis] = (float)(group % 2   ? aim - ray->origin[axis]
                                           : group % 4 ? 1.1 + turn[axis]
                                                       : turn[axis]);
        }
        if (group % 5 == 4)
            ray->cull_mask = i % 2 ? 0x0f : 0xf1;
    }
}

static void expect_same(bool is_hit, const struct ray_hit *hit, bool is_expected, const struct ray_hit *expected)
{
    assert_int_equal(is_hit, is_expected);
    if (is_expected)
        assert_true(test_scene_same_hit(hit, expected));
}

/* Returns how many rays hit, and adds the visits that were made in packets. */
static uint32_t compare(const struct bed *bed, const struct ray rays[RAYS], uint64_t *visits_together)
{
    uint32_t found = 0;
    for (uint32_t begin = 0; begin < RAYS; begin += TRAVERSE_GROUP) {
        struct traverse_stream stream = {.scene = &bed->unpacked};
        struct ray_hit hits[TRAVERSE_GROUP], alone, expected;
        const uint64_t is_hit = traverse_group(&stream, rays + begin, TRAVERSE_GROUP, hits);
        *visits_together += stream.visits_together;
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
            const struct ray *ray = &rays[begin + i];
            const bool is_expected = traverse(&bed->scene.scene, ray, NULL, &expected, NULL);
            const bool is_alone = traverse(&bed->unpacked, ray, NULL, &alone, NULL);
            if (ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
                assert_int_equal(is_alone, is_expected);
            else
                expect_same(is_alone, &alone, is_expected, &expected);
            expect_same(is_hit >> i & 1, &hits[i], is_alone, &alone);
            found += is_expected;
        }
    }
    return found;
}

static void rays_have_the_answers_of_single_rays(void **state)
{
    static struct bed bed;
    static struct ray rays[RAYS];
    static const double places[] = {6, 12, 25};
    struct random random = {3};
    (void)state;
    for (size_t i = 0; i < sizeof places / sizeof *places; i++)
        for (uint32_t any = 0; any < 2; any++) {
            uint64_t visits = 0;
            bed_open(&bed, &random, places[i]);
            const struct traverse_stream stream = {.scene = &bed.unpacked};
            make_rays(any ? RAY_TERMINATE_ON_FIRST_HIT : 0, places[i], &random, rays);
            const uint32_t found = compare(&bed, rays, &visits);
            assert_true(found > RAYS / 50 && found < RAYS);
            assert_true(!traverse_groups_pay(&stream) || visits > 0);
            bed_close(&bed);
        }
}

/* The boxes of unpacked nodes hold those of portable ones at any time, and hardly more. */
static void boxes_hold_those_of_portable_nodes(void **state)
{
    static struct bed bed;
    struct random random = {8};
    (void)state;
    bed_open(&bed, &random, 5);
    const struct portable_view *view = bed.scene.scene.top;
    for (uint32_t index = 0; index < view->header->node_count; index++) {
        const struct portable_moving_node *from = (const struct portable_moving_node *)portable_node_at(view, index);
        const struct unpacked_moving_node *to = &bed.top[index];
        for (int slot = 0; slot < 8; slot++)
            for (int axis = 0; axis < 3; axis++) {
                const uint8_t exponent = from->start.exponent[axis];
                const double step = exponent ? ldexp(1, exponent - 127) : 0, origin = from->start.origin[axis];
                const double t = random_between(&random, 0, 1), off = 1e-5 * (fabs(origin) + 255 * step);
                const double low =
                                 origin + step * ((1 - t) * from->start.lo[axis][slot] + t * from->end_lo[axis][slot]),
                             high =
                                 origin + step * ((1 - t) * from->start.hi[axis][slot] + t * from->end_hi[axis][slot]);
                const double own_low = to->start.planes[axis][slot] + t * to->moved[axis][slot],
                             own_high = to->start.planes[3 + axis][slot] + t * to->moved[3 + axis][slot];
                if (from->start.meta[slot] == 0)
                    assert_true(own_low > own_high);
                else
                    assert_true(fabs(own_low - low) <= off && fabs(own_high - high) <= off);
            }
    }
    bed_close(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_have_the_answers_of_single_rays),
        cmocka_unit_test(boxes_hold_those_of_portable_nodes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

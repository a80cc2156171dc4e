/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_traverse_group.c - tests that rays through unpacked nodes, in groups, in turns and one by one, have the answers
 * of single rays through the portable nodes, to the last bit; and that unpacked boxes hold their triangles.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/traverse_group.h"
#include "tests/support/builder/test_scene.h"
#include "tests/support/random.h"

enum { TRIANGLES = 500, RAYS = TRAVERSE_GROUP * 24, KINDS_OF_RAYS = 6 };

/* A scene with the unpacked nodes of its bottom levels. */
struct bed {
    struct test_scene scene;
    float (*corners)[3][3];
    float (*boxes)[6];
    struct unpacked_node *nodes[TEST_SCENE_BOTTOMS], *top;
    struct portable_view views[TEST_SCENE_BOTTOMS]; /* of the unpacked structures */
    const struct portable_view *bottoms[TEST_SCENE_BOTTOMS];
    struct unpacked_triangles *triangles[TEST_SCENE_BOTTOMS];
    struct scene unpacked;
};

typedef void (*shape_function)(struct random *random, uint32_t index, float ret_corners[3][3]);

static void soup(struct random *random, uint32_t index, float ret_corners[3][3])
{
    double centre[3], offset[3];
    random_point(random, centre);
    for (int k = 0; k < 3; k++) {
        random_point(random, offset);
        for (int axis = 0; axis < 3; axis++)
            ret_corners[k][axis] =
                (float)(10 * (centre[axis] + 0.2 * (index % 7 == 0 && axis == 0 ? 1e-4 : 1) * offset[axis]));
    }
}

/* A flat grid of squares, two triangles each, whose edges and corners rays meet exactly. */
static void grid(struct random *random, uint32_t index, float ret_corners[3][3])
{
    static const int corner[2][3][2] = {{{0, 0}, {1, 0}, {1, 1}}, {{0, 0}, {1, 1}, {0, 1}}};
    (void)random;
    for (int k = 0; k < 3; k++) {
        ret_corners[k][0] = (float)((int)(index / 2 % 16) - 8 + corner[index % 2][k][0]);
        ret_corners[k][1] = (float)((int)(index / 32) - 8 + corner[index % 2][k][1]);
        ret_corners[k][2] = 1;
    }
}

/* Many triangles in one place, some of them equal: ties, which the lowest number wins. */
static void pile(struct random *random, uint32_t index, float ret_corners[3][3])
{
    (void)random;
    for (int k = 0; k < 3; k++) {
        ret_corners[k][0] = (float)(k == 1 ? 9 : -9);
        ret_corners[k][1] = (float)(k == 2 ? 9 : -9);
        ret_corners[k][2] = (float)(index % 5);
    }
}

/* Far from the origin, where a float has few digits left. */
static void far_away(struct random *random, uint32_t index, float ret_corners[3][3])
{
    soup(random, index, ret_corners);
    for (int k = 0; k < 3; k++)
        ret_corners[k][0] += 1e5f;
}

enum { FAR_OUT = 1 << 23 };

/* Small triangles at whole coordinates where floats are a unit apart. */
static void far_out(struct random *random, uint32_t index, float ret_corners[3][3])
{
    (void)random;
    for (int k = 0; k < 3; k++) {
        ret_corners[k][0] = (float)(FAR_OUT + (int)(index % 23) + (k == 1));
        ret_corners[k][1] = (float)((int)(index / 23) + (k == 2));
        ret_corners[k][2] = (float)(index % 3);
    }
}

static void tiny(struct random *random, uint32_t index, float ret_corners[3][3])
{
    soup(random, index, ret_corners);
    for (int k = 0; k < 9; k++)
        ret_corners[k / 3][k % 3] *= 1e-20f;
}

static void huge(struct random *random, uint32_t index, float ret_corners[3][3])
{
    soup(random, index, ret_corners);
    for (int k = 0; k < 9; k++)
        ret_corners[k / 3][k % 3] *= 1e25f;
}

static struct unpacked_node *unpack(const struct portable_view *view)
{
    struct unpacked_node *nodes = calloc(1, unpacked_size(view->header));
    assert_non_null(nodes);
    unpacked_fill(view, nodes);
    return nodes;
}

static void unpack_bottom(struct bed *bed, uint32_t index)
{
    struct portable_view *view = &bed->views[index];
    *view = *bed->scene.bottoms[index];
    bed->bottoms[index] = view;
    if (view->header->content == PORTABLE_AABBS)
        return;
    bed->nodes[index] = unpack(view);
    if (view->header->content == PORTABLE_TRIANGLES)
        return;
    bed->triangles[index] = malloc(unpacked_triangles_size(view->header->record_count));
    assert_non_null(bed->triangles[index]);
    unpacked_store_corners(view, bed->triangles[index]);
}

static void bed_unpack(struct bed *bed)
{
    const struct scene *scene = &bed->scene.scene;
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        unpack_bottom(bed, i);
    if (scene->top)
        bed->top = unpack(scene->top);
    bed->unpacked = *scene;
    bed->unpacked.bottoms = bed->bottoms;
    bed->unpacked.unpacked = (const struct unpacked_node *const *)bed->nodes;
    bed->unpacked.unpacked_top = bed->top;
    traverse_settle(&bed->unpacked);
}

static void bed_open(struct bed *bed, shape_function shape, uint32_t flags, enum build_quality quality)
{
    struct random random = {1};
    *bed = (struct bed){.corners = calloc(TRIANGLES, sizeof *bed->corners)};
    assert_non_null(bed->corners);
    for (uint32_t i = 0; i < TRIANGLES; i++)
        shape(&random, i, bed->corners[i]);
    const float(*corners)[3][3] = (const float(*)[3][3])bed->corners;
    const struct geometry geometries[2] = {
        test_scene_triangles(corners, TRIANGLES / 3, 0),
        test_scene_triangles(corners + TRIANGLES / 3, TRIANGLES - TRIANGLES / 3, GEOMETRY_OPAQUE)};
    test_scene_init(&bed->scene);
    bed->scene.quality = quality;
    test_scene_add(&bed->scene, geometries, 2, flags);
}

static void bed_close(struct bed *bed)
{
    for (uint32_t i = 0; i < TEST_SCENE_BOTTOMS; i++) {
        free(bed->nodes[i]);
        free(bed->triangles[i]);
    }
    free(bed->top);
    free(bed->boxes);
    free(bed->corners);
    test_scene_finish(&bed->scene);
}

/* Rays from one point to neighbouring points; from a point of the surface in all directions; along axes; at random. */
static void aim(struct random *random, const struct bed *bed, uint32_t index, struct ray *ret_ray)
{
    const float(*corners)[3] = (const float(*)[3])bed->corners[index / 64 * 13 % TRIANGLES];
    const uint32_t kind = index / TRAVERSE_GROUP % KINDS_OF_RAYS;
    double size = fabs((double)corners[0][0] - corners[1][0]) + fabs((double)corners[0][1] - corners[1][1]), point[3];
    for (int axis = 0; axis < 3; axis++) {
        double centre = corners[0][axis], away = random_between(random, -1, 1);
        point[axis] = centre + (kind == 0 || kind == 4 ? 30 * size * (axis == 2 ? 1 : 0.2) : 0);
        if (kind == 3)
            point[axis] = centre + 5 * size * random_between(random, -1, 1);
        ret_ray->origin[axis] = (float)point[axis];
        ret_ray->direction[axis] = (float)away;
        if (kind == 0 || kind == 4)
            ret_ray->direction[axis] = (float)(centre - ret_ray->origin[axis] + size * away);
        if (kind == 2)
            ret_ray->direction[axis] = axis == (int)(index % 3) ? index % 2 ? 1 : -1 : index % 5 ? 0 : 1e-12f;
    }
    if (kind == 1)
        ret_ray->tmin = (float)(1e-5 * size);
    if (kind == 4)
        ret_ray->tmax = (float)random_between(random, 0.5, 1.5);
}

/* Gives a ray something by which it differs from its neighbours. */
static void distort(struct random *random, uint32_t index, struct ray *ray)
{
    static const uint32_t flags[] = {RAY_OPAQUE, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING, RAY_CULL_OPAQUE,
                                     RAY_SKIP_TRIANGLES | RAY_TERMINATE_ON_FIRST_HIT};
    static const float odd[] = {NAN, INFINITY, 0, -1, FLT_MAX, 1e-40f, -0.0f};
    const float value = odd[random_next(random) % (sizeof odd / sizeof *odd)];
    switch (index % 32) {
    case 3:
        ray->flags |= flags[random_next(random) % (sizeof flags / sizeof *flags)];
        break;
    case 7:
        ray->origin[random_next(random) % 3] = value;
        break;
    case 11:
        ray->direction[random_next(random) % 3] = value;
        break;
    case 13:
        ray->tmin = value;
        break;
    case 17:
        ray->tmax = value;
        break;
    case 19:
        memset(ray->direction, 0, sizeof ray->direction);
        break;
    default:
        break;
    }
}

static void make_rays(const struct bed *bed, uint32_t flags, struct ray ret_rays[RAYS])
{
    struct random random = {5};
    for (uint32_t i = 0; i < RAYS; i++) {
        ret_rays[i] = (struct ray){.tmax = FLT_MAX, .cull_mask = 0xff, .flags = flags};
        aim(&random, bed, i, &ret_rays[i]);
        if (i / TRAVERSE_GROUP % 2)
            distort(&random, i, &ret_rays[i]);
    }
}

/* Traces those of the rays in turns for which it is possible. Returns them, and tells which of them hit. */
static uint64_t trace_in_turns(const struct traverse_stream *stream, const struct ray *rays, uint32_t count,
                               struct ray_hit *ret_hits, uint64_t *ret_is_hit)
{
    uint64_t plain = 0;
    *ret_is_hit = 0;
    if (stream->scene->top || !traverse_groups_pay(stream))
        return 0;
    for (uint32_t i = 0; i < count; i++)
        plain |= (uint64_t)(!(rays[i].flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT) && rays[i].tmin >= 0 &&
                            rays[i].tmin <= rays[i].tmax)
                 << i;
    const uint64_t done = turns_avx2_trace(stream, rays, plain, ret_hits, ret_is_hit);
    assert_int_equal(done & ~plain, 0);
    return done;
}

/* Compares the answers of groups of some size with those of single rays. Returns how many rays hit. */
static int compare(const struct bed *bed, const struct ray rays[RAYS], uint32_t group_size)
{
    struct traverse_counters counters = {0, 0, 0};
    struct traverse_stream stream = {.scene = &bed->unpacked, .counters = &counters};
    int found = 0;
    for (uint32_t begin = 0; begin < RAYS; begin += group_size) {
        struct ray_hit hits[TRAVERSE_GROUP], in_turns[TRAVERSE_GROUP], expected, alone;
        uint32_t count = RAYS - begin < group_size ? RAYS - begin : group_size;
        stream.alone = begin / group_size % 4 == 3 ? count : 0; /* most groups go in packets, whatever was decided */
        uint64_t is_hit = traverse_group(&stream, rays + begin, count, hits), turns_hit;
        const uint64_t turns = trace_in_turns(&stream, rays + begin, count, in_turns, &turns_hit);
        for (uint32_t i = 0; i < count; i++) {
            bool is_expected = traverse(&bed->scene.scene, &rays[begin + i], NULL, &expected, NULL);
            assert_int_equal(is_hit >> i & 1, is_expected);
            assert_int_equal(traverse(&bed->unpacked, &rays[begin + i], NULL, &alone, NULL), is_expected);
            found += is_expected;
            if (turns >> i & 1)
                assert_int_equal(turns_hit >> i & 1, is_expected);
            if (turns >> i & 1 && is_expected)
                assert_true(test_scene_same_hit(&in_turns[i], &expected));
            if (is_expected) {
                assert_true(test_scene_same_hit(&hits[i], &expected));
                assert_true(test_scene_same_hit(&alone, &expected));
            }
        }
    }
    assert_true(counters.nodes > 0 && counters.triangles > 0);
    return found;
}

static void rays_have_the_answers_of_single_rays(void **state)
{
    static const shape_function shapes[] = {soup, grid, pile, far_away, tiny, huge};
    static struct ray rays[RAYS];
    (void)state;
    for (size_t shape = 0; shape < sizeof shapes / sizeof *shapes; shape++)
        for (uint32_t way = 0; way < 4; way++) {
            struct bed bed;
            bed_open(&bed, shapes[shape], way & 1 ? PORTABLE_FAST_TRIANGLES : 0,
                     way & 1 ? QUALITY_HIGH : QUALITY_BALANCED);
            bed_unpack(&bed);
            make_rays(&bed, way & 2 ? RAY_TERMINATE_ON_FIRST_HIT : 0, rays);
            int found = compare(&bed, rays, way == 3 ? 11 : TRAVERSE_GROUP);
            assert_true(found > RAYS / 12 && found < RAYS);
            bed_close(&bed);
        }
}

/* Adds a bottom level of boxes at some of the triangles. */
static void add_boxes(struct bed *bed)
{
    enum { BOXES = 20 };
    bed->boxes = calloc(BOXES, sizeof *bed->boxes);
    assert_non_null(bed->boxes);
    for (uint32_t i = 0; i < BOXES; i++)
        for (int axis = 0; axis < 3; axis++) {
            const float at = bed->corners[i * (TRIANGLES / BOXES)][0][axis];
            bed->boxes[i][axis] = at;
            bed->boxes[i][3 + axis] = at + 0.2f;
        }
    const struct geometry geometry = test_scene_aabbs((const float(*)[6])bed->boxes, BOXES, 0);
    test_scene_add(&bed->scene, &geometry, 1, 0);
}

/* Instances that are turned, scaled and sheared, and others that all share the place that the rays aim at. */
static void make_instances(struct test_instance *instances, uint32_t count, double scale, double place)
{
    static const float in_place[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    struct random random = {9};
    for (uint32_t i = 0; i < count; i++) {
        instances[i] = (struct test_instance){.custom_index = i, .mask = 1u << i % 8, .flags = i % 12, .bottom = i % 3};
        if (i % 3 == 1)
            memcpy(instances[i].transform, in_place, sizeof in_place);
        else
            test_scene_transform(&random, scale, place, instances[i].transform);
    }
}

/* Adds two bottom levels, one of them of boxes, and a top level over all three. */
static void add_top(struct bed *bed, struct test_instance *instances, uint32_t count)
{
    const struct geometry half = test_scene_triangles((const float(*)[3][3])bed->corners, TRIANGLES / 2, 0);
    test_scene_add(&bed->scene, &half, 1, 0);
    add_boxes(bed);
    make_instances(instances, count, 0.6, 8);
    test_scene_add_top(&bed->scene, instances, count);
}

/* Gives rays masks: neighbours have the same one in most groups, and different ones in others. */
static void mask_rays(struct ray rays[RAYS])
{
    for (uint32_t i = 0; i < RAYS; i++) {
        const uint32_t group = i / TRAVERSE_GROUP;
        rays[i].cull_mask = group % 3 == 0 ? 0xff : group % 3 == 1 ? ~(1u << group % 8) & 0xff : (i * 37 & 0xff) | 1;
    }
}

static void instances_have_the_answers_of_single_rays(void **state)
{
    enum { INSTANCES = 40 };
    static const shape_function shapes[] = {soup, grid, pile, far_away, huge};
    static struct ray rays[RAYS];
    static struct test_instance instances[INSTANCES];
    (void)state;
    for (size_t shape = 0; shape < sizeof shapes / sizeof *shapes; shape++)
        for (uint32_t way = 0; way < 4; way++) {
            struct bed bed;
            bed_open(&bed, shapes[shape], way & 1 ? PORTABLE_FAST_TRIANGLES : 0, QUALITY_BALANCED);
            add_top(&bed, instances, INSTANCES);
            bed_unpack(&bed);
            make_rays(&bed, way & 2 ? RAY_TERMINATE_ON_FIRST_HIT : 0, rays);
            mask_rays(rays);
            const int found = compare(&bed, rays, way == 1 ? 11 : TRAVERSE_GROUP);
            assert_true(found > RAYS / 16 && found < RAYS);
            bed_close(&bed);
        }
}

/* A call can have any number of rays. */
static void any_number_of_rays_has_the_answers_of_single_rays(void **state)
{
    enum { INSTANCES = 12, MOST = 40 };
    static struct ray rays[RAYS];
    static struct test_instance instances[INSTANCES];
    (void)state;
    for (int way = 0; way < 4; way++) {
        const bool has_top = way & 1;
        struct bed bed;
        bed_open(&bed, soup, 0, QUALITY_BALANCED);
        if (has_top)
            add_top(&bed, instances, INSTANCES);
        bed_unpack(&bed);
        make_rays(&bed, way & 2 ? RAY_TERMINATE_ON_FIRST_HIT : 0, rays);
        for (uint32_t count = 1; count <= MOST; count++)
            assert_true(compare(&bed, rays, count) > 0);
        bed_close(&bed);
    }
}

/* Returns after how many of the rays, group by group, the next ones are to go alone; RAYS if never. */
static uint32_t rays_until_alone(const struct bed *bed, const struct ray rays[RAYS], struct traverse_stream *ret_stream)
{
    struct ray_hit hits[TRAVERSE_GROUP];
    uint32_t traced = 0;
    *ret_stream = (struct traverse_stream){.scene = &bed->unpacked};
    while (traced < RAYS && traverse_next_alone(ret_stream, 1) == 0) {
        traverse_group(ret_stream, rays + traced, TRAVERSE_GROUP, hits);
        traced += TRAVERSE_GROUP;
    }
    return traced;
}

/* Rays from everywhere in all directions go alone, and packets are tried again; rays side by side never do. */
static void rays_without_coherence_go_alone(void **state)
{
    static struct ray rays[RAYS];
    struct random random = {7};
    struct traverse_stream stream;
    struct bed bed;
    (void)state;
    bed_open(&bed, soup, 0, QUALITY_BALANCED);
    bed_unpack(&bed);
    stream = (struct traverse_stream){.scene = &bed.unpacked};
    const bool is_possible = traverse_groups_pay(&stream);
    for (uint32_t i = 0; i < RAYS; i++) {
        double origin[3], direction[3];
        random_point(&random, origin);
        random_point(&random, direction);
        rays[i] = (struct ray){.tmax = FLT_MAX, .cull_mask = 0xff};
        for (int axis = 0; axis < 3; axis++) {
            rays[i].origin[axis] = (float)(10 * origin[axis]);
            rays[i].direction[axis] = (float)direction[axis];
        }
    }
    uint64_t alone = 1;
    assert_true((rays_until_alone(&bed, rays, &stream) < RAYS) == is_possible);
    alone += traverse_next_alone(&stream, 100);
    assert_int_equal(alone, is_possible ? 101 : 1);
    alone += traverse_next_alone(&stream, UINT64_MAX);
    assert_true(!is_possible || (alone > RAYS && stream.pause == alone));
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i] = (struct ray){.origin = {0, 0, -30},
                               .direction = {1e-3f * (float)(i % 8), 1e-3f * (float)(i / 8 % 8), 1},
                               .tmax = FLT_MAX,
                               .cull_mask = 0xff};
    assert_int_equal(rays_until_alone(&bed, rays, &stream), RAYS);
    bed_close(&bed);
}

/* Makes the ray of a pixel of a tile: all from one point, or side by side in one direction. */
static struct ray tile_ray(uint32_t pixel, bool is_parallel)
{
    const float x = (float)(pixel % 8), y = (float)(pixel / 8);
    struct ray ray = {
        .origin = {0, 0, -30}, .direction = {1e-2f * x, 1e-2f * y, 1}, .tmax = FLT_MAX, .cull_mask = 0xff};
    if (is_parallel)
        ray = (struct ray){
            .origin = {0.3f * x, 0.3f * y, -30}, .direction = {0.1f, 0.1f, 1}, .tmax = FLT_MAX, .cull_mask = 0xff};
    return ray;
}

/* Packets of a tile are blocks of pixels: they cost what they cost if the blocks come one after the other. */
static void tiles_are_traced_in_blocks(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, soup, 0, QUALITY_BALANCED);
    bed_unpack(&bed);
    for (int is_parallel = 0; is_parallel < 2; is_parallel++) {
        struct ray tile[TRAVERSE_GROUP], blocks[TRAVERSE_GROUP];
        struct ray_hit hits[TRAVERSE_GROUP];
        struct traverse_stream of_tile = {.scene = &bed.unpacked}, of_blocks = {.scene = &bed.unpacked};
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
            const uint32_t block = i / 8, column = block % 2 * 4 + i % 4, row = block / 2 * 2 + i / 4 % 2;
            tile[i] = tile_ray(i, is_parallel);
            blocks[i] = tile_ray(8 * row + column, is_parallel);
        }
        const uint64_t is_hit = traverse_group(&of_tile, tile, TRAVERSE_GROUP, hits);
        assert_true(is_hit != 0);
        traverse_group(&of_blocks, blocks, TRAVERSE_GROUP, hits);
        assert_int_equal(of_tile.cost, of_blocks.cost);
        assert_int_equal(of_tile.visits_together, of_blocks.visits_together);
    }
    bed_close(&bed);
}

/* Far from the origin of their space, where a float has few digits left, rays in packets visit no more nodes. */
static void distance_from_the_origin_costs_no_visits(void **state)
{
    struct traverse_counters together = {0, 0, 0}, singly = {0, 0, 0};
    struct ray rays[TRAVERSE_GROUP];
    struct ray_hit hits[TRAVERSE_GROUP], hit;
    struct bed bed;
    (void)state;
    bed_open(&bed, far_out, 0, QUALITY_BALANCED);
    bed_unpack(&bed);
    struct traverse_stream stream = {.scene = &bed.unpacked, .counters = &together};
    const bool is_possible = traverse_groups_pay(&stream);
    for (uint32_t i = 0; i < TRAVERSE_GROUP; i++)
        rays[i] = (struct ray){.origin = {FAR_OUT, (float)(i % 8), -20},
                               .direction = {0.3f + 0.02f * (float)(i / 8), 0.3f, 1},
                               .tmax = FLT_MAX,
                               .cull_mask = 0xff};
    const uint64_t is_hit = traverse_group(&stream, rays, TRAVERSE_GROUP, hits);
    for (uint32_t i = 0; i < TRAVERSE_GROUP; i++)
        assert_int_equal(is_hit >> i & 1, traverse(&bed.unpacked, &rays[i], NULL, &hit, &singly));
    assert_true(is_hit != 0);
    assert_true(!is_possible || 4 * together.nodes < 5 * singly.nodes);
    bed_close(&bed);
}

/* Every corner of a leaf's triangles lies in the boxes above it, if nothing was split. */
static void check_boxes(const struct bed *bed, uint32_t index, const float box[6], uint32_t *triangles)
{
    const struct unpacked_node *node = &bed->nodes[0][index];
    for (int slot = 0; slot < 8; slot++) {
        float inner[6];
        for (int k = 0; k < 6; k++)
            inner[k] = node->planes[k][slot];
        if (bed->scene.bottoms[0]->nodes[index].meta[slot] == 0) {
            assert_true(inner[0] > inner[3]);
            continue;
        }
        for (int axis = 0; axis < 3; axis++)
            assert_true(inner[axis] >= box[axis] && inner[3 + axis] <= box[3 + axis]);
        const uint32_t child = node->children[slot];
        if (child >= CHILD_ROOT) {
            check_boxes(bed, child & CHILD_INDEX_MASK, inner, triangles);
            continue;
        }
        for (uint32_t i = 0; i <= child >> CHILD_KIND_SHIFT; i++, ++*triangles) {
            const float *corners[3];
            traverse_corners(bed->scene.bottoms[0], (child & CHILD_INDEX_MASK) + i, corners);
            for (int k = 0; k < 9; k++)
                assert_true(corners[k / 3][k % 3] >= inner[k % 3] && corners[k / 3][k % 3] <= inner[3 + k % 3]);
        }
    }
}

static void boxes_hold_their_triangles(void **state)
{
    static const shape_function shapes[] = {soup, grid, far_away, huge};
    (void)state;
    for (size_t shape = 0; shape < sizeof shapes / sizeof *shapes; shape++) {
        struct bed bed;
        uint32_t triangles = 0;
        bed_open(&bed, shapes[shape], 0, QUALITY_FAST);
        bed_unpack(&bed);
        check_boxes(&bed, 0, bed.scene.bottoms[0]->header->bounds, &triangles);
        assert_int_equal(triangles, bed.scene.bottoms[0]->header->record_count);
        bed_close(&bed);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_have_the_answers_of_single_rays),
        cmocka_unit_test(instances_have_the_answers_of_single_rays),
        cmocka_unit_test(any_number_of_rays_has_the_answers_of_single_rays),
        cmocka_unit_test(rays_without_coherence_go_alone),
        cmocka_unit_test(tiles_are_traced_in_blocks),
        cmocka_unit_test(distance_from_the_origin_costs_no_visits),
        cmocka_unit_test(boxes_hold_their_triangles),
    };
    return cmocka_run_group_tests_name("traverse_group", tests, NULL, NULL);
}

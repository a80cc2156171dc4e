/* SPDX-License-Identifier: Apache-2.0 */
/* test_spatial_bins.c - tests that spatial splits find the cheapest plane and send refs to the right sides. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/kernel/bins.h"
#include "tests/support/random.h"
#include "builder/kernel/spatial_bins.h"

enum { MOST = 400 };

struct fixture {
    float corners[MOST][9];
    struct primitive_ref refs[MOST];
    uint32_t count;
    struct canonical_geometry geometry;
    struct canonical canonical;
    struct vec4_box bounds, centroids;
    struct spatial_grid grid;
};

/*
 * Makes triangles of about `size`. With `flat` all lie in the plane y = 0.5, with corners on a coarse lattice, so that
 * they lie in planes of the grid.
 */
static void start(struct fixture *f, uint32_t count, double size, bool flat, uint64_t seed)
{
    struct random random = {seed};
    f->count = count;
    for (uint32_t id = 0; id < count; id++) {
        double centre[3];
        struct box box = box_empty();
        random_point(&random, centre);
        for (int k = 0; k < 9; k++) {
            double at = centre[k % 3] + size * random_between(&random, -1, 1);
            f->corners[id][k] = (float)(!flat ? at : k % 3 == 1 ? 0.5 : floor(4 * at) / 4);
        }
        for (int i = 0; i < 3; i++)
            box_add_point(&box, f->corners[id] + 3 * i);
        f->refs[id] =
            (struct primitive_ref){{box.min[0], box.min[1], box.min[2]}, 0, {box.max[0], box.max[1], box.max[2]}, id};
    }
    f->geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = count, .vertex_count = 3 * count, .positions = f->corners[0]};
    f->canonical = (struct canonical){.geometry_count = 1, .primitive_count = count, .geometries = &f->geometry};
    bins_bound(f->refs, count, &f->bounds, &f->centroids);
    spatial_grid_lay(&f->bounds, &f->grid);
}

static double half_area(const struct vec4_box *box)
{
    struct box plain = vec4_box_get(*box);
    return box_half_area(&plain);
}

/* Computes a plane's cost and counts by cutting each triangle once. */
static double cost_at(const struct fixture *f, unsigned axis, float position, uint32_t ret_counts[2])
{
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    ret_counts[0] = ret_counts[1] = 0;
    for (uint32_t i = 0; i < f->count; i++) {
        struct vec4_box box = vec4_box_load(&f->refs[i]), parts[2] = {box, box};
        struct clip_shape shape = clip_load(&f->canonical, i);
        bool on[2] = {f->refs[i].min[axis]<position, f->refs[i].max[axis]> position ||
                      f->refs[i].min[axis] >= position};
        if (on[0] && on[1])
            clip_cut(&shape, &box, axis, position, &parts[0], &parts[1]);
        for (int side = 0; side < 2; side++)
            if (on[side]) {
                ret_counts[side]++;
                vec4_box_grow(&sides[side], parts[side].min, parts[side].max);
            }
    }
    return ret_counts[0] && ret_counts[1] ? half_area(&sides[0]) * ret_counts[0] + half_area(&sides[1]) * ret_counts[1]
                                          : INFINITY;
}

static double least_cost(const struct fixture *f, uint32_t slack)
{
    double least = INFINITY;
    for (unsigned axis = 0; axis < 3; axis++)
        for (uint32_t k = 1; k < SPATIAL_BINS && f->grid.scale[axis] != 0; k++) {
            uint32_t counts[2];
            double cost = cost_at(f, axis, f->grid.planes[axis][k], counts);
            if (cost < least && counts[0] + counts[1] <= f->count + slack)
                least = cost;
        }
    return least;
}

/* Adds some of the refs to bins of their own, and merges them. */
static bool choose(const struct fixture *f, uint32_t slack, struct spatial_plane *ret_plane)
{
    struct spatial_bins bins, others;
    uint32_t some = f->count / 3;
    spatial_bins_clear(&bins);
    spatial_bins_clear(&others);
    assert_true(spatial_bins_add(&bins, &f->canonical, &f->grid, f->refs, some, NULL));
    assert_true(spatial_bins_add(&others, &f->canonical, &f->grid, f->refs + some, f->count - some, NULL));
    spatial_bins_merge(&bins, &others);
    return spatial_bins_choose(&bins, &f->grid, f->count + slack, ret_plane);
}

static void the_cheapest_plane_is_chosen(void **state)
{
    (void)state;
    static struct fixture f;
    uint32_t found = 0;
    for (uint32_t round = 0; round < 300; round++) {
        uint32_t slack = round % 4 == 3 ? MOST : round % 4 * 5, counts[2];
        struct spatial_plane plane;
        start(&f, 2 + round, round % 3 == 0 ? 1 : 0.1, round % 5 == 0, round);
        double least = least_cost(&f, slack);
        bool any = choose(&f, slack, &plane);
        assert_int_equal(any, isfinite(least));
        if (!any)
            continue;
        found++;
        cost_at(&f, plane.axis, f.grid.planes[plane.axis][plane.bin], counts);
        assert_int_equal(plane.left_count, counts[0]);
        assert_int_equal(plane.right_count, counts[1]);
        assert_true(counts[0] + counts[1] <= f.count + slack);
        assert_true(fabs(plane.cost - least) <= 1e-4 * least);
    }
    assert_true(found > 150);
}

static bool same(const struct vec4_box *a, const struct vec4_box *b)
{
    struct box x = vec4_box_get(*a), y = vec4_box_get(*b);
    return memcmp(&x, &y, sizeof x) == 0;
}

static void check_side(const struct spatial_side *side, const struct primitive_ref *refs)
{
    struct vec4_box bounds, centroids;
    bins_bound(refs, side->count, &bounds, &centroids);
    assert_true(same(&bounds, &side->bounds) && same(&centroids, &side->centroids));
}

/*
 * Records where each ref went (1: left, 2: right, 3: both), and checks that whole refs are unchanged and parts lie on
 * their sides.
 */
static void note(const struct fixture *f, const struct spatial_plane *plane, const struct primitive_ref *refs,
                 uint32_t count, int side, unsigned char seen[])
{
    float position = f->grid.planes[plane->axis][plane->bin];
    for (uint32_t i = 0; i < count; i++) {
        struct box box = primitive_ref_box(&refs[i]), whole = primitive_ref_box(&f->refs[refs[i].id]);
        assert_true(refs[i].id < f->count && !(seen[refs[i].id] & 1 << side));
        seen[refs[i].id] = (unsigned char)(seen[refs[i].id] | 1 << side);
        assert_true(box_contains(&whole, &box));
        bool is_whole = memcmp(&box, &whole, sizeof box) == 0;
        assert_true(is_whole || (side ? box.min[plane->axis] >= position : box.max[plane->axis] <= position));
    }
}

static void every_ref_goes_somewhere(void **state)
{
    (void)state;
    static struct fixture f;
    static struct primitive_ref to[2 * MOST];
    uint32_t cut = 0, left_whole = 0;
    for (uint32_t round = 0; round < 300; round++) {
        struct spatial_plane plane;
        struct spatial_side sides[2];
        unsigned char seen[MOST] = {0};
        start(&f, 2 + round, round % 3 == 0 ? 1 : 0.1, round % 5 == 0, round);
        if (!choose(&f, MOST, &plane))
            continue;
        spatial_partition(&f.canonical, &f.grid, &plane, f.refs, f.count, to, to + 2 * MOST, sides);
        assert_true(sides[0].count >= 1 && sides[0].count <= plane.left_count);
        assert_true(sides[1].count >= 1 && sides[1].count <= plane.right_count);
        const struct primitive_ref *right = to + 2 * MOST - sides[1].count;
        note(&f, &plane, to, sides[0].count, 0, seen);
        note(&f, &plane, right, sides[1].count, 1, seen);
        check_side(&sides[0], to);
        check_side(&sides[1], right);
        for (uint32_t i = 0; i < f.count; i++) {
            assert_true(seen[i] != 0);
            cut += seen[i] == 3;
        }
        left_whole += plane.left_count + plane.right_count - sides[0].count - sides[1].count;
        double cost = half_area(&sides[0].bounds) * sides[0].count + half_area(&sides[1].bounds) * sides[1].count;
        assert_true(cost <= plane.cost * 1.0001);
    }
    assert_true(cut > 1000 && left_whole > 100);
}

/* Sends refs in two steps, with the sides decided first. */
static void chunks_go_where_they_are_sent(void **state)
{
    (void)state;
    static struct fixture f;
    static struct primitive_ref left[2 * MOST], right[2 * MOST];
    uint32_t cut = 0, left_whole = 0;
    for (uint32_t round = 0; round < 300; round++) {
        struct spatial_plane plane;
        struct spatial_side sides[2];
        uint8_t ways[MOST];
        uint32_t counts[2], all[2];
        unsigned char seen[MOST] = {0};
        start(&f, 2 + round, round % 3 == 0 ? 1 : 0.1, round % 5 == 0, round);
        if (!choose(&f, MOST, &plane))
            continue;
        spatial_assign(&f.grid, &plane, f.refs, f.count, ways, counts);
        spatial_send(&f.canonical, &f.grid, &plane, f.refs, ways, f.count, left, right, sides);
        note(&f, &plane, left, sides[0].count, 0, seen);
        note(&f, &plane, right, sides[1].count, 1, seen);
        check_side(&sides[0], left);
        check_side(&sides[1], right);
        for (int side = 0; side < 2; side++)
            assert_int_equal(sides[side].count, counts[side]);
        for (uint32_t i = 0; i < f.count; i++) {
            assert_true(seen[i] != 0);
            cut += seen[i] == 3;
        }
        plane.cut_all = true;
        spatial_assign(&f.grid, &plane, f.refs, f.count, ways, all);
        assert_true(all[0] == plane.left_count && all[1] == plane.right_count);
        left_whole += all[0] + all[1] - counts[0] - counts[1];
    }
    assert_true(cut > 1000 && left_whole > 100);
}

static struct bins_plane division(float overlap, uint32_t left_count)
{
    return (struct bins_plane){.axis = 0,
                               .left_count = left_count,
                               .left = {{0, 0, 0, 0}, {1 + overlap, 1, 1, 0}},
                               .right = {{1 - overlap, 0, 0, 0}, {2, 1, 1, 0}}};
}

static void cuts_are_tried_where_they_may_pay(void **state)
{
    (void)state;
    struct bins_plane none = division(-0.25f, 50), little = division(0.001f, 50), much = division(0.5f, 50);
    assert_false(spatial_worth_a_try(&none, 100, 10, 5));
    assert_false(spatial_worth_a_try(&little, 100, 10, 5));
    assert_true(spatial_worth_a_try(&much, 100, 10, 5));
    assert_false(spatial_worth_a_try(&much, 100, 0, 5));
    assert_false(spatial_worth_a_try(&much, 100, 10, 1e6f));
    /* The division costs the same: its half areas are 4. */
    struct spatial_plane cut = {.cost = 50 * 4 + 50 * 4, .left_count = 50, .right_count = 60};
    assert_false(spatial_is_better(&cut, &much, 100, 0));
    cut.cost = 50 * 4 + 50 * 3;
    assert_true(spatial_is_better(&cut, &much, 100, 4.9f));
    assert_false(spatial_is_better(&cut, &much, 100, 5.1f)); /* ten more refs to save 50 */
}

/* The price of a ref scales as a cost does, whatever the unit of length. */
static void prices_follow_areas(void **state)
{
    (void)state;
    float price = spatial_price(90, 10, 100);
    assert_true(price > 0);
    assert_true(spatial_price(180, 20, 100) == 2 * price && spatial_price(90, 10, 50) == 2 * price);
    assert_true(spatial_price(360, 10, 100) == 2 * price);
    assert_true(spatial_price(0, 0, 1) == 0);
    assert_true(isfinite(spatial_price(0x1p116, 0x1p84f, 1)));
}

static void planes_are_left_across_two_axes(void **state)
{
    (void)state;
    struct spatial_grid grid;
    struct vec4_box box = {{0, 0, 0, 0}, {2, 1, 3, 0}};
    for (unsigned axis = 0; axis < 3; axis++) {
        spatial_grid_lay(&box, &grid);
        spatial_grid_narrow(&box, axis, &grid);
        for (unsigned i = 0; i < 3; i++)
            assert_int_equal(grid.scale[i] > 0, i == axis || i == 2);
    }
}

static void room_is_shared_by_what_it_is_worth(void **state)
{
    (void)state;
    struct spatial_side sides[2] = {{.bounds = {{0, 0, 0, 0}, {1, 1, 1, 0}}, .count = 10},
                                    {.bounds = {{0, 0, 0, 0}, {1, 1, 1, 0}}, .count = 30}};
    assert_int_equal(spatial_share_room(80, sides), 20);
    assert_int_equal(spatial_share_room(40, sides), 10);
    sides[0].bounds.max = sides[1].bounds.max = (vec4){0, 0, 0, 0};
    assert_int_equal(spatial_share_room(80, sides), 30);
}

/* Axes that are too thin have no planes; a box whose size overflows nothing has planes on its long axis. */
static void thin_boxes_have_no_planes(void **state)
{
    (void)state;
    struct spatial_grid grid;
    struct vec4_box box = {{1, -0x1p40f, 0, 0}, {nextafterf(1, 2), 0x1p40f, 0, 0}};
    spatial_grid_lay(&box, &grid);
    assert_true(grid.scale[0] == 0 && grid.scale[2] == 0);
    assert_true(grid.scale[1] > 0);
    for (uint32_t k = 1; k < SPATIAL_BINS; k++)
        assert_true(grid.planes[1][k] > grid.planes[1][k - 1] && grid.planes[1][k] < box.max[1]);
    box.max[0] = 1 + 0x1p-43f;
    box.min[0] = 1;
    box.min[2] = -FLT_MIN;
    spatial_grid_lay(&box, &grid);
    assert_true(grid.scale[0] == 0 && grid.scale[2] == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_cheapest_plane_is_chosen),
        cmocka_unit_test(every_ref_goes_somewhere),
        cmocka_unit_test(chunks_go_where_they_are_sent),
        cmocka_unit_test(cuts_are_tried_where_they_may_pay),
        cmocka_unit_test(prices_follow_areas),
        cmocka_unit_test(planes_are_left_across_two_axes),
        cmocka_unit_test(room_is_shared_by_what_it_is_worth),
        cmocka_unit_test(thin_boxes_have_no_planes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

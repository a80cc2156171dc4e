/* SPDX-License-Identifier: Apache-2.0 */
/* test_clip.c - tests that the parts of a cut primitive lose no point and are tight, and when cuts are allowed. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/swept_shape.h"
#include "builder/kernel/clip.h"
#include "tests/support/random.h"

static struct canonical view(struct canonical_geometry *geometry, const float *positions)
{
    *geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = 1, .vertex_count = 3, .positions = positions};
    return (struct canonical){
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = geometry};
}

static bool holds(const struct box *box, const long double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (point[axis] < box->min[axis] || point[axis] > box->max[axis])
            return false;
    return true;
}

static void cut(const struct canonical *canonical, const struct box *box, unsigned axis, float position,
                struct box *ret_left, struct box *ret_right)
{
    struct clip_shape shape = clip_load(canonical, 0);
    struct vec4_box limit = vec4_box_from(box), left, right;
    clip_cut(&shape, &limit, axis, position, &left, &right);
    *ret_left = vec4_box_get(left);
    *ret_right = vec4_box_get(right);
}

/* Every point of the triangle that lies in the ref's box must lie in the box of its side. */
static void check_points(struct random *random, const float p[9], const struct box *old, unsigned axis, float position,
                         const struct box *left, const struct box *right)
{
    for (int i = 0; i < 20; i++) {
        /* Take points on corners, on edges, and inside. */
        long double u = random_between(random, 0, 1), v = random_between(random, 0, 1), point[3];
        if (u + v > 1) {
            u = 1 - u;
            v = 1 - v;
        }
        if (i < 4)
            u = i & 1, v = i == 2;
        else if (i < 12)
            v = i < 8 ? 0 : 1 - u;
        for (int k = 0; k < 3; k++)
            point[k] = p[k] + u * ((long double)p[3 + k] - p[k]) + v * ((long double)p[6 + k] - p[k]);
        if (holds(old, point))
            assert_true(holds(point[axis] <= position ? left : right, point));
    }
}

static void no_point_is_lost(void **state)
{
    (void)state;
    struct random random = {17};
    uint32_t shrunk = 0, cuts = 0;
    for (int round = 0; round < 4000; round++) {
        float p[9];
        double scale = ldexp(1, (int)random_between(&random, -18, 38)),
               offset = round % 3 ? 0 : random_between(&random, -1e4, 1e4);
        for (int k = 0; k < 9; k++)
            p[k] = (float)((random_between(&random, -1, 1) + offset) * scale);
        if (round % 5 == 0)
            p[4] = p[1]; /* an edge perpendicular to an axis */
        struct canonical_geometry geometry;
        struct canonical canonical = view(&geometry, p);
        struct box box = box_empty(), left, right;
        for (int k = 0; k < 3; k++)
            box_add_point(&box, p + 3 * k);
        for (int depth = 0; depth < 8; depth++) {
            unsigned axis = (unsigned)(random_next(&random) % 3);
            float position = (float)random_between(&random, box.min[axis], box.max[axis]);
            if (depth == 3)
                position = p[axis];
            cut(&canonical, &box, axis, position, &left, &right);
            assert_true(!box_is_empty(&left) && !box_is_empty(&right));
            assert_true(box_contains(&box, &left) && box_contains(&box, &right));
            assert_true(left.max[axis] <= fmaxf(position, box.min[axis]) &&
                        right.min[axis] >= fminf(position, box.max[axis]));
            check_points(&random, p, &box, axis, position, &left, &right);
            shrunk += box_half_area(&left) + box_half_area(&right) < 0.9 * box_half_area(&box);
            cuts++;
            box = random_next(&random) % 2 ? left : right;
        }
    }
    assert_true(shrunk > cuts / 5);
}

/* A linear swept sphere as the union of the spheres between its ends: a point of one of them. */
static void point_of(struct random *random, const float ends[8], long double ret_point[3])
{
    const long double z = random_next(random) % 4 ? random_between(random, 0, 1) : random_next(random) % 2;
    long double direction[3], square = 0;
    for (int k = 0; k < 3; k++) {
        direction[k] = random_next(random) % 3 ? random_between(random, -1, 1) : 0;
        square += direction[k] * direction[k];
    }
    const long double radius = (ends[3] + z * ((long double)ends[7] - ends[3])) / (square > 0 ? sqrtl(square) : 1);
    for (int k = 0; k < 3; k++)
        ret_point[k] = ends[k] + z * ((long double)ends[4 + k] - ends[k]) + radius * direction[k];
}

static void no_point_of_a_swept_sphere_is_lost(void **state)
{
    (void)state;
    struct random random = {18};
    uint32_t shrunk = 0, cuts = 0;
    static const uint32_t index = 0;
    for (int round = 0; round < 4000; round++) {
        float ends[8];
        const double scale = ldexp(1, (int)random_between(&random, -18, 38)),
                     offset = round % 3 ? 0 : random_between(&random, -1e4, 1e4);
        for (int k = 0; k < 8; k++)
            ends[k] = (float)(k % 4 == 3 ? random_between(&random, 0, round % 2 ? 0.02 : 1) * scale
                                         : (random_between(&random, -1, 1) + offset) * scale);
        if (round % 5 == 0)
            ends[4] = ends[0], ends[7] = ends[3]; /* nothing changes along an axis */
        if (round % 7 == 0)
            ends[7] = ends[3] + 3 * (float)scale; /* the second end swallows the first one */
        struct canonical_geometry geometry = {.type = GEOMETRY_SWEPT_SPHERES,
                                              .primitive_count = 1,
                                              .vertex_count = 2,
                                              .positions = ends,
                                              .indices = &index};
        struct canonical canonical = {
            .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = &geometry};
        struct box box = swept_shape_box(ends, ends + 4, SWEPT_SHAPE_CAPS), left, right;
        for (int depth = 0; depth < 8; depth++) {
            const unsigned axis = (unsigned)(random_next(&random) % 3);
            const float position =
                depth == 3 ? ends[axis] : (float)random_between(&random, box.min[axis], box.max[axis]);
            cut(&canonical, &box, axis, position, &left, &right);
            assert_true(!box_is_empty(&left) && !box_is_empty(&right));
            assert_true(box_contains(&box, &left) && box_contains(&box, &right));
            for (int i = 0; i < 30; i++) {
                long double point[3];
                point_of(&random, ends, point);
                if (holds(&box, point))
                    assert_true(holds(point[axis] <= position ? &left : &right, point));
            }
            shrunk += box_half_area(&left) + box_half_area(&right) < 0.9 * box_half_area(&box);
            cuts++;
            box = random_next(&random) % 2 ? left : right;
        }
    }
    assert_true(shrunk > cuts / 8);
}

/* A thin diagonal is cut at its middle into two boxes of a quarter of the size. */
static void diagonals_are_halved(void **state)
{
    (void)state;
    static const float ends[8] = {0, 0, 0, 0.125f, 8, 8, 8, 0.125f};
    static const uint32_t index = CANONICAL_CAP_FIRST | CANONICAL_CAP_SECOND;
    struct canonical_geometry geometry = {
        .type = GEOMETRY_SWEPT_SPHERES, .primitive_count = 1, .vertex_count = 2, .positions = ends, .indices = &index};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = &geometry};
    struct box box = swept_shape_box(ends, ends + 4, SWEPT_SHAPE_CAPS), left, right;
    cut(&canonical, &box, 1, 4, &left, &right);
    for (int axis = 0; axis < 3; axis++) {
        const float beyond = axis == 1 ? 0 : 0.25f; /* the sphere whose lowest point is in the plane reaches higher */
        assert_true(left.min[axis] == -0.125f && right.max[axis] == 8.125f);
        assert_true(left.max[axis] >= 4 + beyond && left.max[axis] < 4.001f + beyond);
        assert_true(right.min[axis] <= 4 - beyond && right.min[axis] > 3.999f - beyond);
    }
}

/* A right triangle in an xy plane with legs of length 4 is cut at x = 1: the parts are 4 and 3 high. */
static void boxes_are_tight(void **state)
{
    (void)state;
    static const float p[9] = {0, 0, 1, 4, 0, 1, 0, 4, 1};
    struct canonical_geometry geometry;
    struct canonical canonical = view(&geometry, p);
    struct box box = {{0, 0, 1}, {4, 4, 1}}, left, right;
    cut(&canonical, &box, 0, 1, &left, &right);
    assert_true(left.min[0] == 0 && left.max[0] == 1 && left.min[1] == 0 && left.max[1] == 4);
    assert_true(right.min[0] == 1 && right.max[0] == 4 && right.min[1] == 0);
    assert_true(right.max[1] >= 3 && right.max[1] < 3.00001f);
    /* A plane outside of the box leaves the whole box on one side, and its face on the other. */
    cut(&canonical, &box, 0, 7, &left, &right);
    assert_true(left.max[0] == 4 && right.min[0] == 4 && right.max[0] == 4);
}

static void splits_are_forbidden_where_they_show(void **state)
{
    (void)state;
    struct canonical_geometry geometries[2] = {{.type = GEOMETRY_TRIANGLES}, {.type = GEOMETRY_TRIANGLES}};
    struct canonical canonical = {.geometry_count = 2, .geometries = geometries};
    assert_true(clip_allowed(&canonical));
    geometries[1].flags = GEOMETRY_OPAQUE;
    assert_true(clip_allowed(&canonical));
    geometries[1].flags = GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT;
    assert_true(clip_allowed(&canonical));
    geometries[1].flags = GEOMETRY_NO_DUPLICATE_ANY_HIT;
    assert_false(clip_allowed(&canonical));
    geometries[1] = (struct canonical_geometry){.type = GEOMETRY_SWEPT_SPHERES};
    assert_true(clip_allowed(&canonical));
    geometries[1] = (struct canonical_geometry){.type = GEOMETRY_SPHERES};
    assert_false(clip_allowed(&canonical));
    geometries[1] = (struct canonical_geometry){.type = GEOMETRY_AABBS};
    assert_false(clip_allowed(&canonical));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_point_is_lost),
        cmocka_unit_test(no_point_of_a_swept_sphere_is_lost),
        cmocka_unit_test(diagonals_are_halved),
        cmocka_unit_test(boxes_are_tight),
        cmocka_unit_test(splits_are_forbidden_where_they_show),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

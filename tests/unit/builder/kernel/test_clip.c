/* SPDX-License-Identifier: Apache-2.0 */
/* test_clip.c - tests that the parts of a cut triangle lose no point and are tight, and when cuts are allowed. */
#include "tests/support/unit.h"

#include <math.h>

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
    struct clip_triangle triangle = clip_load(canonical, 0);
    struct vec4_box limit = vec4_box_from(box), left, right;
    clip_cut(&triangle, &limit, axis, position, &left, &right);
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
    geometries[1] = (struct canonical_geometry){.type = GEOMETRY_AABBS};
    assert_false(clip_allowed(&canonical));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_point_is_lost),
        cmocka_unit_test(boxes_are_tight),
        cmocka_unit_test(splits_are_forbidden_where_they_show),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

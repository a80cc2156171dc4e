/* SPDX-License-Identifier: Apache-2.0 */
/* test_boxtest_moving.c - tests that no test of moving nodes misses a box that a ray meets at its time. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/boxtest_moving.h"
#include "builder/traverse/ray.h"
#include "tests/support/builder/moving_structure.h"
#include "tests/support/random.h"

enum { NODES = 4000, RAYS = 40 };

/* The boxes of eight children at both keys, and all of them. */
struct crowd {
    struct box keys[2][MOVING_WIDTH], bounds;
};

static struct crowd make_crowd(struct random *random, double size, double offset, double speed, bool is_flat)
{
    struct crowd crowd = {.bounds = box_empty()};
    for (int slot = 0; slot < MOVING_WIDTH; slot++)
        for (int key = 0; key < 2; key++) {
            struct box *box = &crowd.keys[key][slot];
            *box = box_empty();
            for (int corner = 0; corner < 2; corner++) {
                double place[3];
                float point[3];
                random_point(random, place);
                for (int axis = 0; axis < 3; axis++)
                    point[axis] = (float)(offset + size * (key ? speed : 1) * place[axis]);
                if (is_flat)
                    point[2] = (float)offset;
                box_add_point(box, point);
            }
            box_grow(&crowd.bounds, box);
        }
    return crowd;
}

/*
 * Returns whether a ray meets a child's box at its time, and where. The box reaches as far as vertices do that lie on
 * its planes at both keys, and is made smaller by what long double may round.
 */
static bool meets(const struct crowd *crowd, int slot, const struct ray *ray, long double *ret_near)
{
    const struct motion_weights at = motion_weights_at(ray->time);
    long double near = ray->tmin, far = ray->tmax;
    for (int axis = 0; axis < 3; axis++) {
        const struct box *start = &crowd->keys[0][slot], *end = &crowd->keys[1][slot];
        const long double lo = (long double)motion_number(start->min[axis], end->min[axis], at) - ray->origin[axis],
                          hi = (long double)motion_number(start->max[axis], end->max[axis], at) - ray->origin[axis],
                          speed = ray->direction[axis];
        if (speed == 0) {
            if (lo > 0 || hi < 0)
                return false;
            continue;
        }
        const long double first = (speed > 0 ? lo : hi) / speed, last = (speed > 0 ? hi : lo) / speed;
        near = fmaxl(near, first + 0x1p-60L * fabsl(first));
        far = fminl(far, last - 0x1p-60L * fabsl(last));
    }
    *ret_near = near;
    return near <= far;
}

static struct ray make_ray(struct random *random, const struct crowd *crowd)
{
    struct ray ray = {.tmax = FLT_MAX, .time = (float)random_between(random, 0, 1)};
    double from[3], to[3];
    random_point(random, from);
    random_point(random, to);
    if (random_next(random) % 4 == 0)
        ray.time = (float)(random_next(random) % 2);
    for (int axis = 0; axis < 3; axis++) {
        const double middle = ((double)crowd->bounds.min[axis] + crowd->bounds.max[axis]) / 2,
                     half = (double)crowd->bounds.max[axis] - middle;
        ray.origin[axis] = (float)(middle + 2 * half * from[axis]);
        ray.direction[axis] = (float)(middle + half * to[axis] - ray.origin[axis]);
        if (random_next(random) % 16 == 0)
            ray.direction[axis] = 0;
    }
    return ray;
}

#ifdef BOXTEST_AVX2

BOXTEST_AVX2 static unsigned test_avx2(const struct boxtest_moving *moving, const struct portable_moving_node *node,
                                       float tmax, float ret_near[8])
{
    return kernel_moving_avx2(moving, node, tmax, ret_near);
}

#else

static unsigned test_avx2(const struct boxtest_moving *moving, const struct portable_moving_node *node, float tmax,
                          float ret_near[8])
{
    return boxtest_moving_float(moving, node, tmax, ret_near);
}

#endif

static void check_one(bool is_met, unsigned hits, int slot, long double expected, double near)
{
    if (is_met && (!(hits >> slot & 1) || !(near <= expected + 0x1p-50L * fabsl(expected))))
        fail_msg("slot %d: hits 0x%x, near %.17g, met at %.17Lg", slot, hits, near, expected);
}

static uint64_t check_ray(const struct crowd *crowd, const struct portable_moving_node *node, const struct ray *ray)
{
    const double origin[3] = {ray->origin[0], ray->origin[1], ray->origin[2]},
                 direction[3] = {ray->direction[0], ray->direction[1], ray->direction[2]};
    struct boxtest_moving moving = {.at = motion_weights_at(ray->time)}, wide = moving;
    struct boxtest_moving_exact exact = {.at = moving.at};
    float bounds[6], near[8], near_wide[8];
    double near_exact[8];
    uint64_t met = 0;
    memcpy(bounds, &crowd->bounds, sizeof bounds);
    if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
        return 0;
    boxtest_init_exact(origin, direction, ray->tmin, bounds, &exact.still);
    boxtest_widen_exact(&exact.still, bounds);
    const bool is_float = boxtest_init(origin, direction, ray->tmin, bounds, &moving.still),
               is_wide = boxtest_has_avx2() && boxtest_init_avx2(origin, direction, ray->tmin, bounds, &wide.still);
    boxtest_widen(&moving.still, bounds);
    boxtest_widen(&wide.still, bounds);
    const unsigned all = 0xff, hits = is_float ? boxtest_moving_float(&moving, node, ray->tmax, near) : all,
                   hits_wide = is_wide ? test_avx2(&wide, node, ray->tmax, near_wide) : all,
                   hits_exact = kernel_moving_double(&exact, node, ray->tmax, near_exact);
    for (int slot = 0; slot < MOVING_WIDTH; slot++) {
        long double expected;
        const bool is_met = meets(crowd, slot, ray, &expected);
        check_one(is_met, hits, slot, expected, is_float ? (double)near[slot] : -INFINITY);
        check_one(is_met, hits_wide, slot, expected, is_wide ? (double)near_wide[slot] : -INFINITY);
        check_one(is_met, hits_exact, slot, expected, near_exact[slot]);
        met += is_met;
    }
    return met;
}

static void test_no_box_is_missed(void **state)
{
    (void)state;
    struct random random = {3};
    uint64_t met = 0;
    for (int i = 0; i < NODES; i++) {
        static const double sizes[] = {1, 1e-3, 1e6, 1e-20, 1e25}, offsets[] = {0, 1, 1000, 1e6}, speeds[] = {1, 20, 0};
        const double size = sizes[i % 5], offset = size * offsets[i % 4], speed = speeds[i % 3];
        const struct crowd crowd = make_crowd(&random, size, offset, speed, i % 7 == 0);
        struct portable_moving_node node = {.start = {.meta = {0x20, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20}}};
        write_boxes(crowd.keys, 0xff, &node);
        for (int k = 0; k < RAYS; k++) {
            const struct ray ray = make_ray(&random, &crowd);
            met += check_ray(&crowd, &node, &ray);
        }
    }
    assert_true(met > NODES * RAYS / 4);
}

/* Far beside the boxes of its time, but not beside those of other times, a ray meets none. */
static void test_time_counts(void **state)
{
    (void)state;
    struct crowd crowd = {.bounds = {{-1, -1, -1}, {101, 1, 1}}};
    struct portable_moving_node node = {.start = {.meta = {0x20}}};
    for (int slot = 0; slot < MOVING_WIDTH; slot++) {
        crowd.keys[0][slot] = (struct box){{-1, -1, -1}, {1, 1, 1}};
        crowd.keys[1][slot] = (struct box){{99, -1, -1}, {101, 1, 1}};
    }
    write_boxes((const struct box(*)[MOVING_WIDTH])crowd.keys, 1, &node);
    for (int i = 0; i <= 10; i++) {
        const double origin[3] = {10.0 * i, 0, -5}, direction[3] = {0, 0, 1};
        float near[8], bounds[6];
        memcpy(bounds, &crowd.bounds, sizeof bounds);
        for (int k = 0; k <= 10; k++) {
            struct boxtest_moving moving = {.at = motion_weights_at(0.1f * (float)k)};
            assert_true(boxtest_init(origin, direction, 0, bounds, &moving.still));
            boxtest_widen(&moving.still, bounds);
            assert_int_equal(boxtest_moving_float(&moving, &node, 100, near), i == k);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_box_is_missed),
        cmocka_unit_test(test_time_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_srt_bounds.c - tests that the boxes of SRTs hold what they move at all times, and are not much larger. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/srt_bounds.h"
#include "builder/traverse/motion.h"
#include "tests/support/random.h"

enum { PAIRS = 3000, TIMES = 257, MANNERS = 10 };

static void random_quaternion(struct random *random, double length, float *ret)
{
    double q[4], square = 0;
    do {
        square = 0;
        for (int i = 0; i < 4; i++) {
            q[i] = random_between(random, -1, 1);
            square += q[i] * q[i];
        }
    } while (square < 0.01 || square > 1);
    for (int i = 0; i < 4; i++)
        ret[i] = (float)(q[i] * length / sqrt(square));
}

static void random_srt(struct random *random, float srt[SRT_NUMBERS])
{
    for (int i = 0; i < SRT_NUMBERS; i++)
        srt[i] = (float)random_between(random, -2, 2);
    random_quaternion(random, 1, srt + SRT_QX);
}

/* A quaternion that is turned by that many degrees, half of which it has, about a random axis. */
static void turn(struct random *random, double degrees, const float from[4], float to[4])
{
    const double pi = 3.14159265358979323846;
    double axis[3], length;
    do {
        random_point(random, axis);
        length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    } while (length < 0.1);
    const double s = sin(degrees * pi / 360) / length, w = cos(degrees * pi / 360);
    const double x = axis[0] * s, y = axis[1] * s, z = axis[2] * s;
    to[0] = (float)(w * from[0] + x * from[3] + y * from[2] - z * from[1]);
    to[1] = (float)(w * from[1] - x * from[2] + y * from[3] + z * from[0]);
    to[2] = (float)(w * from[2] + x * from[1] - y * from[0] + z * from[3]);
    to[3] = (float)(w * from[3] - x * from[0] - y * from[1] - z * from[2]);
}

/* Scales as scenes have them, instead of ones that mirror and vanish on the way. */
static void calm(float srt[SRT_NUMBERS])
{
    static const int scales[3] = {SRT_SX, SRT_SY, SRT_SZ};
    for (int i = 0; i <= SRT_PVZ; i++)
        srt[i] *= 0.1f;
    for (int i = 0; i < 3; i++)
        srt[scales[i]] += 1;
}

/* Makes both ends of a motion; returns the manner's name. */
static const char *make_pair(struct random *random, int manner, float start[SRT_NUMBERS], float end[SRT_NUMBERS])
{
    random_srt(random, start);
    random_srt(random, end);
    if (manner % 2 == 0 || manner == 7) {
        calm(start);
        calm(end);
    }
    switch (manner) {
    case 0:
        turn(random, 359, start + SRT_QX, end + SRT_QX);
        return "359 degrees";
    case 1:
        for (int i = SRT_QX; i <= SRT_QW; i++)
            end[i] = -start[i];
        return "opposite quaternions";
    case 2:
        for (int i = SRT_QX; i <= SRT_QW; i++)
            end[i] = -start[i] * (1 + (float)random_between(random, -1e-3, 1e-3));
        return "nearly opposite quaternions";
    case 3:
        for (int i = SRT_TX; i <= SRT_TZ; i++) {
            start[i] *= (float)(random_next(random) % 2 ? 1e30 : 1e4);
            end[i] *= (float)(random_next(random) % 2 ? 1e30 : 1e4);
        }
        return "huge translation";
    case 4:
        memcpy(end + SRT_QX, start + SRT_QX, 4 * sizeof *end);
        return "no turn";
    case 5:
        random_quaternion(random, exp(random_between(random, -20, 20)), end + SRT_QX);
        return "lengths of quaternions";
    case 6: /* pivots that cancel what the object's place adds */
        start[SRT_PVX] = -1000 * start[SRT_SX];
        end[SRT_PVX] = -1000 * end[SRT_SX];
        return "far pivot";
    case 7:
        turn(random, random_between(random, 0, 40), start + SRT_QX, end + SRT_QX);
        return "small turn";
    case 8:
        turn(random, random_between(random, 330, 360), start + SRT_QX, end + SRT_QX);
        return "large turn";
    default:
        return "any";
    }
}

static struct box make_box(struct random *random, int manner)
{
    struct box box = box_empty();
    for (int k = 0; k < 2; k++) {
        double point[3];
        random_point(random, point);
        const float at[3] = {(float)point[0] + (manner == 6 ? 1000 : 0), (float)point[1], (float)point[2]};
        box_add_point(&box, at);
    }
    return box;
}

/* Sums of the sides of boxes over all times: of the interpolated ones, and of those that the corners need. */
struct trace {
    double given, needed;
    uint32_t outside;
};

static void follow(const struct portable_moving_instance *instance, const struct box *box, const struct box keys[2],
                   float time, struct trace *trace)
{
    float m[12];
    if (!motion_matrix(instance, time, m))
        return;
    for (int row = 0; row < 3; row++) {
        const double low = keys[0].min[row] * (1 - (double)time) + keys[1].min[row] * (double)time,
                     high = keys[0].max[row] * (1 - (double)time) + keys[1].max[row] * (double)time;
        double min = INFINITY, max = -INFINITY;
        for (int corner = 0; corner < 8; corner++) {
            double x = m[4 * row + 3];
            for (int axis = 0; axis < 3; axis++)
                x += (double)m[4 * row + axis] * (corner >> axis & 1 ? box->max[axis] : box->min[axis]);
            trace->outside += !(x >= low && x <= high);
            min = fmin(min, x);
            max = fmax(max, x);
        }
        trace->given += high - low;
        trace->needed += max - min;
    }
}

/*
 * Every corner is in the box that is interpolated at its time, at 257 times of 3,000 motions. The printed growth is how
 * much longer the sides of these boxes are than what the corners need at each time.
 */
static void boxes_hold_all_corners(void **state)
{
    (void)state;
    struct random random = {7};
    double growth[MANNERS] = {0}, most[MANNERS] = {0};
    uint32_t outside = 0;
    const char *names[MANNERS];
    for (int pair = 0; pair < PAIRS; pair++) {
        const int manner = pair % MANNERS;
        struct portable_moving_instance instance = {.motion = MOTION_SRT};
        struct trace trace = {0, 0, 0};
        struct box keys[2], box = make_box(&random, manner);
        names[manner] = make_pair(&random, manner, instance.start, instance.end);
        srt_bounds(instance.start, instance.end, &box, keys);
        for (int i = 0; i < TIMES; i++)
            follow(&instance, &box, keys, (float)i / (TIMES - 1), &trace);
        outside += trace.outside;
        const double own = manner == 3 ? 1 : trace.given / trace.needed; /* a box at 1e30 has no extent */
        growth[manner] += own * MANNERS / PAIRS;
        most[manner] = fmax(most[manner], own);
    }
    for (int manner = 0; manner < MANNERS; manner++)
        print_message("%s: sides are %.3f times as long on average, %.3f at most\n", names[manner], growth[manner],
                      most[manner]);
    assert_int_equal(outside, 0);
    assert_true(growth[4] < 1.01 && growth[7] < 1.5 && growth[8] < 2.5);
}

/* Without a turn and scale, the box moves as it is; only the roundings are added. */
static void translations_keep_the_size(void **state)
{
    (void)state;
    const struct box box = {{-1, -2, -3}, {1, 2, 3}};
    float start[SRT_NUMBERS] = {[SRT_SX] = 1, [SRT_SY] = 1, [SRT_SZ] = 1, [SRT_QW] = 1}, end[SRT_NUMBERS];
    struct box keys[2];
    memcpy(end, start, sizeof end);
    start[SRT_TX] = 5;
    end[SRT_TX] = -7;
    srt_bounds(start, end, &box, keys);
    for (int key = 0; key < 2; key++)
        for (int axis = 0; axis < 3; axis++) {
            const float place = axis ? 0 : key ? -7 : 5;
            assert_true(fabsf(keys[key].min[axis] - place - box.min[axis]) < 1e-5f);
            assert_true(fabsf(keys[key].max[axis] - place - box.max[axis]) < 1e-5f);
        }
}

/* Whatever the finite numbers are, so are the boxes; quaternions of zeros have one, too. */
static void boxes_are_finite(void **state)
{
    (void)state;
    static const float values[] = {0, 1, -1, FLT_MAX, -FLT_MAX, 0x1p-149f, 0x1p-126f, 1e20f};
    struct random random = {8};
    for (int i = 0; i < 20000; i++) {
        float ends[2][SRT_NUMBERS];
        struct box keys[2], box = make_box(&random, 0);
        for (int k = 0; k < 2 * SRT_NUMBERS; k++)
            ends[k / SRT_NUMBERS][k % SRT_NUMBERS] = values[random_next(&random) % (sizeof values / sizeof *values)];
        srt_bounds(ends[0], ends[1], &box, keys);
        for (int key = 0; key < 2; key++) {
            assert_false(box_is_empty(&keys[key]));
            for (int axis = 0; axis < 3; axis++)
                assert_true(isfinite(keys[key].min[axis]) && isfinite(keys[key].max[axis]));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_hold_all_corners),
        cmocka_unit_test(translations_keep_the_size),
        cmocka_unit_test(boxes_are_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

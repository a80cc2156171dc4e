/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/swept_sphere.h"

#include "builder/traverse/sphere.h"

/*
 * The answer of the test in one precision: the line misses the shape; it enters the side; it can enter the cap of the
 * first or of the second end alone; one end swallows the other, so that only its sphere is left; or this precision
 * cannot decide.
 */
enum swept_answer { SWEPT_MISSED, SWEPT_SIDE, SWEPT_FIRST, SWEPT_SECOND, SWEPT_SWALLOWED, SWEPT_OPEN };

#include "builder/traverse/round_real.h"
#include "builder/traverse/swept_sphere_steps.h"

#define ROUND_TWOFOLD
#include "builder/traverse/round_real.h"
#include "builder/traverse/swept_sphere_steps.h"

static bool meet_end(const struct round_ray *ray, const float *const ends[2], unsigned end, unsigned caps,
                     struct swept_sphere_hit *ret_hit)
{
    if (!(caps >> end & 1) || !sphere_intersect(ray, ends[end], &ret_hit->t))
        return false;
    ret_hit->u = end;
    return true;
}

/* Returns the square of a distance, of which rounding decides nothing. */
static double remoteness(const struct round_ray *ray, const float end[4])
{
    const double x = end[0] - ray->origin[0], y = end[1] - ray->origin[1], z = end[2] - ray->origin[2];
    return x * x + y * y + z * z;
}

/*
 * Answers in twofold precision. It is more precise to begin with the end that is nearer to the ray's origin, where one
 * is so far away that the other, and what is next to it, would be lost in the rounding.
 */
static enum swept_answer enter_precisely(const struct round_ray *ray, const float *const ends[2],
                                         struct swept_sphere_hit *ret_hit)
{
    if (!(remoteness(ray, ends[0]) > remoteness(ray, ends[1])))
        return enter_swept_twofold(ray, ends[0], ends[1], ret_hit);
    const enum swept_answer answer = enter_swept_twofold(ray, ends[1], ends[0], ret_hit);
    if (answer == SWEPT_SIDE)
        ret_hit->u = 1 - ret_hit->u;
    return answer == SWEPT_FIRST ? SWEPT_SECOND : answer == SWEPT_SECOND ? SWEPT_FIRST : answer;
}

static bool is_finite(const float end[4])
{
    return isfinite(end[0]) && isfinite(end[1]) && isfinite(end[2]) && isfinite(end[3]);
}

bool swept_sphere_intersect(const struct round_ray *ray, const float first[4], const float second[4], unsigned caps,
                            struct swept_sphere_hit *ret_hit)
{
    const float *const ends[2] = {first, second};
    if (!is_finite(first) || !is_finite(second) || !(first[3] >= 0 && second[3] >= 0 && first[3] + second[3] > 0))
        return false;
    enum swept_answer answer = enter_swept_double(ray, first, second, ret_hit);
    if (answer == SWEPT_OPEN)
        answer = enter_precisely(ray, ends, ret_hit);
    switch (answer) {
    case SWEPT_SIDE:
        return isfinite(ret_hit->t);
    case SWEPT_FIRST:
    case SWEPT_SECOND:
        return meet_end(ray, ends, answer == SWEPT_SECOND, caps, ret_hit);
    case SWEPT_SWALLOWED:
        return meet_end(ray, ends, second[3] > first[3], caps, ret_hit);
    default:
        return false;
    }
}

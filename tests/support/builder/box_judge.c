/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/box_judge.h"

#include <float.h>

void box_judge_init(struct box_judge *ret_judge, const struct ray *world, const float *matrix)
{
    const struct long_ray exact = candidates_ray(world);
    *ret_judge = (struct box_judge){.world = world, .local = exact};
    if (matrix) {
        ret_judge->local = candidates_ray_into(&exact, matrix);
        ret_judge->slack = 1e-9L;
    }
    for (int axis = 0; axis < 3; axis++) {
        ret_judge->origin[axis] = (double)ret_judge->local.origin[axis];
        ret_judge->inverse[axis] = 1 / (double)ret_judge->local.direction[axis];
    }
}

bool box_judge_is_beyond_floats(const struct ray *ray, long double t)
{
    for (int axis = 0; axis < 3; axis++)
        if (fabsl(ray->origin[axis] + t * ray->direction[axis]) > (long double)FLT_MAX)
            return true;
    return false;
}

static long double reach_of(const struct long_ray *ray, const float box[6])
{
    long double reach = 0;
    for (int axis = 0; axis < 3; axis++)
        reach = fmaxl(reach, fmaxl(fabsl(ray->origin[axis]), fmaxl(fabsl(box[axis]), fabsl(box[3 + axis]))));
    return reach;
}

/*
 * Dismisses a box by two axes that the ray does not pass at the same time, in double, with a margin over its rounding.
 * Comparisons with NaN dismiss nothing.
 */
static bool is_far(const struct box_judge *judge, const float box[6])
{
    double near = (double)judge->local.tmin, far = (double)judge->local.tmax;
    for (int axis = 0; axis < 3; axis++) {
        const double inverse = judge->inverse[axis], a = (box[axis] - judge->origin[axis]) * inverse,
                     b = (box[3 + axis] - judge->origin[axis]) * inverse;
        if (!isfinite(a) || !isfinite(b))
            continue;
        near = (a < b ? a : b) > near ? (a < b ? a : b) : near;
        far = (a < b ? b : a) < far ? (a < b ? b : a) : far;
    }
    return near > far + 1e-6 * (fabs(near) + fabs(far));
}

const char *box_judge_find(const struct box_judge *judge, const float box[6], bool seen)
{
    const struct long_ray *ray = &judge->local;
    long double near = 0, far = 0;
    float ends[6]; /* an infinite box ends at FLT_MAX */
    bool is_finite = true;
    if (!seen && is_far(judge, box))
        return NULL;
    for (int i = 0; i < 6; i++) {
        is_finite = is_finite && isfinite(box[i]);
        ends[i] = isinf(box[i]) ? copysignf(FLT_MAX, box[i]) : box[i];
    }
    if (seen && is_finite && !candidates_meet(ray, box, 1e-5L * reach_of(ray, box), &near, &far))
        return "a candidate though it is far";
    if (seen || !candidates_surely_meet(ray, ends, judge->slack))
        return NULL;
    candidates_meet(ray, ends, 0, &near, &far);
    return box_judge_is_beyond_floats(judge->world, near) || box_judge_is_beyond_floats(judge->world, far)
               ? NULL
               : "no candidate though it is met";
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/boxtest.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/boxtest_kernels.h"

static int main_axis(const double direction[3])
{
    int axis = fabs(direction[1]) > fabs(direction[0]) ? 1 : 0;
    return fabs(direction[2]) > fabs(direction[axis]) ? 2 : axis;
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Returns how far from the ray's origin the structure reaches along an axis. */
static double reach(const double origin[3], const float bounds[6], int axis)
{
    return larger(fabs(bounds[axis] - origin[axis]), fabs(bounds[3 + axis] - origin[axis]));
}

static bool in_float_range(const double origin[3], const double direction[3], const float bounds[6])
{
    double largest = 0, longest = 0;
    for (int axis = 0; axis < 3; axis++) {
        largest = larger(largest, larger(fabs(bounds[axis]), fabs(bounds[3 + axis])));
        longest = larger(longest, fabs(direction[axis]));
        if (!(fabs(origin[axis]) <= range_max && fabs(direction[axis]) <= range_max))
            return false;
    }
    return largest >= structure_min && largest <= range_max && longest >= direction_min;
}

/*
 * Returns an upper bound of a sum of errors. The added thousandth covers the rounding of the sum and of this function.
 */
static float error_bound(double error)
{
    return (float)(1.001 * error + underflow_error);
}

#define PLANES(axis, is_negative) (uint32_t)(offsetof(struct portable_node, lo) + 8 * (axis) + 24 * (is_negative))
#define PLANES_OF(x, y, z)                                                                                             \
    {                                                                                                                  \
        {PLANES(0, x), PLANES(1, y), PLANES(2, z)},                                                                    \
        {                                                                                                              \
            PLANES(0, !(x)), PLANES(1, !(y)), PLANES(2, !(z))                                                          \
        }                                                                                                              \
    }

_Static_assert(offsetof(struct portable_node, hi) == offsetof(struct portable_node, lo) + 24, "hi follows lo");

const struct boxtest_planes boxtest_planes[8] = {
    PLANES_OF(0, 0, 0), PLANES_OF(1, 0, 0), PLANES_OF(0, 1, 0), PLANES_OF(1, 1, 0),
    PLANES_OF(0, 0, 1), PLANES_OF(1, 0, 1), PLANES_OF(0, 1, 1), PLANES_OF(1, 1, 1),
};

bool boxtest_init(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                  struct boxtest_ray *ret_ray)
{
    if (!in_float_range(origin, direction, bounds))
        return false;
    double speed = fabs(direction[main_axis(direction)]), farthest = 0;
    for (int axis = 0; axis < 3; axis++)
        farthest = larger(farthest, reach(origin, bounds, axis));
    /* No point of the structure is met at a larger |t|. */
    double t_reach = farthest / speed;

    struct boxtest_ray ray = {.tmin = tmin};
    for (int axis = 0; axis < 3; axis++) {
        double distance = reach(origin, bounds, axis);
        ray.origin[axis] = (float)origin[axis];
        double moved = fabs(origin[axis] - ray.origin[axis]) + corner_error * distance;
        ray.wide_scale[axis] = (float)(wide_share * distance);
        ray.backward |= (unsigned)(direction[axis] < 0) << axis;
        if (fabs(direction[axis]) < parallel_ratio * speed) {
            ray.parallel_axes |= 1u << axis;
            ray.parallel_slack[axis] = error_bound(moved + t_reach * fabs(direction[axis]));
            ray.slack[axis] = ray.common_slack[axis] = FLT_MAX;
        } else {
            double inverse = 1 / direction[axis], slack = moved * fabs(inverse) + t_error * t_reach;
            ray.inverse[axis] = (float)inverse;
            ray.slack[axis] = error_bound(slack);
            ray.common_slack[axis] = error_bound(slack + boxtest_gamma * distance * fabs(inverse));
        }
    }
    ray.planes = &boxtest_planes[ray.backward];
    *ret_ray = ray;
    return true;
}

void boxtest_init_exact(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                        struct boxtest_exact *ret_ray)
{
    int longest = main_axis(direction);
    double t_reach = reach(origin, bounds, longest) / fabs(direction[longest]);
    struct boxtest_exact ray = {.tmin = tmin};
    for (int axis = 0; axis < 3; axis++) {
        double moved = corner_error * reach(origin, bounds, axis);
        ray.origin[axis] = origin[axis];
        if (direction[axis] == 0) {
            ray.parallel_axes |= 1u << axis;
            ray.parallel_slack[axis] = moved;
        } else {
            ray.inverse[axis] = 1 / direction[axis];
            ray.slack[axis] = moved * fabs(ray.inverse[axis]) + t_error * t_reach;
        }
    }
    *ret_ray = ray;
}

unsigned boxtest_beside(const struct boxtest_ray *ray, const struct portable_node *node, unsigned hits)
{
    for (int axis = 0; axis < 3; axis++) {
        if (!(ray->parallel_axes >> axis & 1))
            continue;
        float offset = node->origin[axis] - ray->origin[axis];
        float scale = boxtest_scale(node->exponent[axis]);
        float slack = boxtest_gamma * (fabsf(offset) + 255.0f * scale) + ray->parallel_slack[axis];
        for (unsigned s = 0; s < 8; s++)
            if (offset + (float)node->lo[axis][s] * scale > slack || offset + (float)node->hi[axis][s] * scale < -slack)
                hits &= ~(1u << s);
    }
    return hits;
}

unsigned boxtest_beside_unpacked(const struct boxtest_ray *ray, const struct unpacked_node *node, unsigned hits)
{
    for (int axis = 0; axis < 3; axis++) {
        if (!(ray->parallel_axes >> axis & 1))
            continue;
        float slack = ray->parallel_slack[axis];
        for (unsigned s = 0; s < 8; s++) {
            float lo = node->planes[axis][s] - ray->origin[axis], hi = node->planes[3 + axis][s] - ray->origin[axis];
            if (lo > slack + boxtest_gamma * fabsf(lo) || hi < -slack - boxtest_gamma * fabsf(hi))
                hits &= ~(1u << s);
        }
    }
    return hits;
}

unsigned boxtest_float(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8])
{
    return kernel_float(ray, node, tmax, ret_near);
}

unsigned boxtest_double(const struct boxtest_exact *ray, const struct portable_node *node, double tmax,
                        double ret_near[8])
{
    return kernel_double(ray, node, tmax, ret_near);
}

/* Subtraction and division round twice, by at most 2^-52 together. */
static const double aabb_gamma = 0x1p-50;

bool boxtest_aabb(const double origin[3], const double direction[3], const float min[3], const float max[3],
                  double tmin, double tmax, double *ret_entry)
{
    double enter = tmin, leave = tmax, entry = tmin;
    for (int axis = 0; axis < 3; axis++) {
        if (!(min[axis] <= max[axis]))
            return false;
        if (direction[axis] == 0) {
            if (origin[axis] < min[axis] || origin[axis] > max[axis])
                return false;
            continue;
        }
        double near = ((direction[axis] > 0 ? min[axis] : max[axis]) - origin[axis]) / direction[axis];
        double far = ((direction[axis] > 0 ? max[axis] : min[axis]) - origin[axis]) / direction[axis];
        entry = fmax(entry, near);
        enter = fmax(enter, near - aabb_gamma * fabs(near));
        leave = fmin(leave, far + aabb_gamma * fabs(far));
    }
    if (!(enter <= leave))
        return false;
    *ret_entry = fmin(entry, tmax);
    return true;
}

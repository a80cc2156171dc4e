/* SPDX-License-Identifier: Apache-2.0 */
#include "boxtest.h"

#include <float.h>
#include <math.h>

#include "boxtest_kernels.h"

static const double range_max = 0x1p60, structure_min = 0x1p-60, direction_min = 0x1p-32;
/* Axes whose direction is this much below the longest count as parallel: float's rounding of the position is of that size. */
static const double parallel_ratio = 0x1p-30;
static const double corner_error = 0x1p-50, t_error = 0x1p-40, underflow_error = 0x1p-118;
/* 8u of the distance is 1/64 of 256 steps of this size. */
static const double wide_share = 0x1p-23;

static int main_axis(const double direction[3])
{
    int axis = fabs(direction[1]) > fabs(direction[0]) ? 1 : 0;
    return fabs(direction[2]) > fabs(direction[axis]) ? 2 : axis;
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* How far from the origin the structure reaches along an axis. */
static double reach(const double origin[3], const float bounds[6], int axis)
{
    return larger(fabs(bounds[axis] - origin[axis]), fabs(bounds[3 + axis] - origin[axis]));
}

static bool in_float_range(const double origin[3], double longest, const float bounds[6])
{
    double largest = 0, farthest = 0;
    for (int axis = 0; axis < 3; axis++) {
        largest = larger(largest, larger(fabs(bounds[axis]), fabs(bounds[3 + axis])));
        farthest = larger(farthest, fabs(origin[axis]));
    }
    return largest >= structure_min && largest <= range_max && farthest <= range_max && longest >= direction_min &&
           longest <= range_max;
}

/* An upper bound of a sum of errors: a thousandth more than covers the rounding of the sum and of this. */
static float round_up(double error)
{
    return (float)(1.001 * error + underflow_error);
}

static void init_planes(const double direction[3], struct boxtest_ray *ray)
{
    for (int axis = 0; axis < 3; axis++) {
        uint32_t lo = (uint32_t)(offsetof(struct portable_node, lo) + sizeof(uint8_t[8]) * (unsigned)axis);
        uint32_t hi = (uint32_t)(offsetof(struct portable_node, hi) + sizeof(uint8_t[8]) * (unsigned)axis);
        ray->near_planes[axis] = direction[axis] < 0 ? hi : lo;
        ray->far_planes[axis] = direction[axis] < 0 ? lo : hi;
    }
}

bool boxtest_init(const double origin[3], const double direction[3], float tmin, const float bounds[6], struct boxtest_ray *ret_ray)
{
    int longest = main_axis(direction);
    double speed = fabs(direction[longest]);
    if (!in_float_range(origin, speed, bounds))
        return false;
    /* No structure point is met at a greater |t|. */
    double t_reach = reach(origin, bounds, longest) / speed;

    struct boxtest_ray *ray = ret_ray;
    ray->tmin = tmin;
    ray->parallel_axes = 0;
    ray->origin[3] = ray->inverse[3] = ray->slack[3] = ray->wide_slack[3] = ray->wide_scale[3] = 0;
    for (int axis = 0; axis < 3; axis++) {
        ray->origin[axis] = (float)origin[axis];
        double distance = reach(origin, bounds, axis);
        double moved = fabs(origin[axis] - ray->origin[axis]) + corner_error * distance;
        ray->wide_scale[axis] = (float)(wide_share * distance);
        if (fabs(direction[axis]) < parallel_ratio * speed) {
            ray->parallel_axes |= 1u << axis;
            ray->parallel_slack[axis] = round_up(moved + t_reach * fabs(direction[axis]));
            ray->inverse[axis] = 0;
            ray->slack[axis] = ray->wide_slack[axis] = FLT_MAX;
        } else {
            double inverse = 1 / direction[axis];
            ray->inverse[axis] = (float)inverse;
            double slack = moved * fabs(inverse) + t_error * t_reach;
            ray->slack[axis] = round_up(slack);
            ray->wide_slack[axis] = round_up(slack + boxtest_gamma * distance * fabs(inverse));
        }
    }
    init_planes(direction, ray);
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

unsigned boxtest_float(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8])
{
    return kernel_float(ray, node, tmax, ret_near);
}

unsigned boxtest_double(const struct boxtest_exact *ray, const struct portable_node *node, double tmax, double ret_near[8])
{
    return kernel_double(ray, node, tmax, ret_near);
}

#ifdef BOXTEST_WIDE
bool boxtest_has_wide(void)
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}

BOXTEST_WIDE unsigned boxtest_wide(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8])
{
    return kernel_wide(ray, node, tmax, ret_near);
}
#else
bool boxtest_has_wide(void)
{
    return false;
}

unsigned boxtest_wide(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8])
{
    return kernel_float(ray, node, tmax, ret_near);
}
#endif

/* Subtraction and division round twice, at most 2^-52 in all. */
static const double aabb_gamma = 0x1p-50;

bool boxtest_aabb(const double origin[3], const double direction[3], const float min[3], const float max[3], double tmin, double tmax,
                  double *ret_entry)
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

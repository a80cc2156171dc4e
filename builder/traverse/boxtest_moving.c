/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/boxtest_moving.h"

/* A common slack of FLT_MAX, of a parallel axis, stays what it is. The double of the others has 8u R more. */
void boxtest_widen(struct boxtest_ray *ray, const float bounds[6])
{
    for (int axis = 0; axis < 3; axis++) {
        const double moved = boxtest_moved(bounds, axis), in_t = moved * fabs((double)ray->inverse[axis]) * 1.001;
        if (ray->parallel_axes >> axis & 1) {
            ray->parallel_slack[axis] = (float)(1.001 * (ray->parallel_slack[axis] + moved));
            continue;
        }
        ray->slack[axis] = (float)(1.001 * (ray->slack[axis] + in_t));
        ray->common_slack[axis] = (float)(1.001 * (2.0 * ray->common_slack[axis] + in_t));
    }
}

void boxtest_widen_exact(struct boxtest_exact *ray, const float bounds[6])
{
    for (int axis = 0; axis < 3; axis++) {
        const double moved = boxtest_moved(bounds, axis);
        if (ray->parallel_axes >> axis & 1)
            ray->parallel_slack[axis] += moved;
        else
            ray->slack[axis] += moved * fabs(ray->inverse[axis]);
    }
}

unsigned boxtest_moving_beside(const struct boxtest_moving *moving, const struct portable_moving_node *node,
                               unsigned hits)
{
    const struct boxtest_ray *ray = &moving->still;
    const struct portable_node *grid = &node->start;
    for (int axis = 0; axis < 3; axis++) {
        if (!(ray->parallel_axes >> axis & 1))
            continue;
        float offset = grid->origin[axis] - ray->origin[axis];
        float scale = boxtest_scale(grid->exponent[axis]);
        float slack = boxtest_gamma * (fabsf(offset) + 255.0f * scale) + ray->parallel_slack[axis];
        for (unsigned s = 0; s < 8; s++)
            if (offset + moving_plane(grid->lo[axis], s, moving->at) * scale > slack ||
                offset + moving_plane(grid->hi[axis], s, moving->at) * scale < -slack)
                hits &= ~(1u << s);
    }
    return hits;
}

unsigned boxtest_moving_float(const struct boxtest_moving *moving, const struct portable_moving_node *node, float tmax,
                              float ret_near[8])
{
    return kernel_moving_float(moving, node, tmax, ret_near);
}

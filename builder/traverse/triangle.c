/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/triangle.h"

#include <math.h>
#include <string.h>

/* A vertex in the ray's space: the ray runs along z through the origin of x and y; z is in units of t. */
struct corner {
    double x, y, z;
};

/* Indexed by the sign and the axis of the longest direction; a table avoids branches, which would be unpredictable. */
const int triangle_axis_orders[2][3][4] = {
    {{1, 2, 0, 3}, {2, 0, 1, 3}, {0, 1, 2, 3}},
    {{2, 1, 0, 3}, {0, 2, 1, 3}, {1, 0, 2, 3}},
};

void triangle_ray_init(const double origin[3], const double direction[3], struct triangle_ray *ret_ray)
{
    double x = fabs(direction[0]), y = fabs(direction[1]), z = fabs(direction[2]);
    int y_over_x = y > x, longest = z > (y_over_x ? y : x) ? 2 : y_over_x;
    const int *axis = triangle_axis_orders[direction[longest] < 0][longest];
    memcpy(ret_ray->axis, axis, sizeof ret_ray->axis);
    for (int k = 0; k < 3; k++)
        ret_ray->origin[k] = origin[axis[k]];
    double inverse = 1 / direction[longest];
    ret_ray->shear[0] = direction[axis[0]] * inverse;
    ret_ray->shear[1] = direction[axis[1]] * inverse;
    ret_ray->shear[2] = inverse;
}

static struct corner move_and_shear(const struct triangle_ray *ray, const float vertex[3])
{
    double x = vertex[ray->axis[0]] - ray->origin[0];
    double y = vertex[ray->axis[1]] - ray->origin[1];
    double z = vertex[ray->axis[2]] - ray->origin[2];
    return (struct corner){x - ray->shear[0] * z, y - ray->shear[1] * z, ray->shear[2] * z};
}

static double edge_function(const struct corner *from, const struct corner *to)
{
    return to->x * from->y - to->y * from->x;
}

/*
 * Computes the edge function to about twice double's precision, rounded once: the rounding errors of the two products
 * are doubles themselves. Its sign is exact. Swapping the ends changes only the sign.
 */
static double edge_function_exact(const struct corner *from, const struct corner *to)
{
    double left = to->x * from->y, right = to->y * from->x;
    double left_error = fma(to->x, from->y, -left), right_error = fma(to->y, from->x, -right);
    return (left - right) + (left_error - right_error);
}

/*
 * Returns the sign of the edge function after moving the ray by (e, e * e), e > 0 infinitely small: 0 only for an edge
 * without length.
 */
static int edge_sign(const struct corner *from, const struct corner *to, double value)
{
    if (value == 0)
        value = to->y - from->y;
    if (value == 0)
        value = from->x - to->x;
    return (value > 0) - (value < 0);
}

/*
 * Fills ret_edges[3] with edge functions of full relative precision. Returns true if the ray is on the same side of all
 * three.
 */
static bool decide_exactly(const struct corner corners[3], double ret_edges[3])
{
    int signs = 0;
    for (int k = 0; k < 3; k++) {
        const struct corner *from = &corners[(k + 1) % 3], *to = &corners[(k + 2) % 3];
        ret_edges[k] = edge_function_exact(from, to);
        signs += edge_sign(from, to, ret_edges[k]);
    }
    return signs == 3 || signs == -3;
}

static bool is_cancelled(const struct corner corners[3], double sum)
{
    double products = 0;
    for (int k = 0; k < 3; k++) {
        const struct corner *from = &corners[(k + 1) % 3], *to = &corners[(k + 2) % 3];
        products += fabs(to->x * from->y) + fabs(to->y * from->x);
    }
    return fabs(sum) < triangle_cancellation * products;
}

/*
 * Returns whether the triangle has no area, by the test with which the builder leaves such triangles out. The builder
 * keeps some of them, which must not be hit either, but rounding in the ray's space can give them some area.
 */
static bool is_flat(const float v0[3], const float v1[3], const float v2[3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)v1[axis] - v0[axis];
        b[axis] = (double)v2[axis] - v0[axis];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

bool triangle_intersect(const struct triangle_ray *ray, const float v0[3], const float v1[3], const float v2[3],
                        struct triangle_hit *ret_hit)
{
    const struct corner corners[3] = {move_and_shear(ray, v0), move_and_shear(ray, v1), move_and_shear(ray, v2)};
    double edges[3] = {edge_function(&corners[1], &corners[2]), edge_function(&corners[2], &corners[0]),
                       edge_function(&corners[0], &corners[1])};
    if ((edges[0] < 0 || edges[1] < 0 || edges[2] < 0) && (edges[0] > 0 || edges[1] > 0 || edges[2] > 0))
        return false;

    double sum = edges[0] + edges[1] + edges[2];
    if (edges[0] == 0 || edges[1] == 0 || edges[2] == 0 || is_cancelled(corners, sum)) {
        if (!decide_exactly(corners, edges) || is_flat(v0, v1, v2))
            return false;
        sum = edges[0] + edges[1] + edges[2];
    }
    if (!(sum != 0 && isfinite(sum)))
        return false;

    double weights[3] = {edges[0] / sum, edges[1] / sum, edges[2] / sum};
    ret_hit->t = weights[0] * corners[0].z + weights[1] * corners[1].z + weights[2] * corners[2].z;
    ret_hit->u = weights[1];
    ret_hit->v = weights[2];
    ret_hit->front = sum > 0;
    return true;
}

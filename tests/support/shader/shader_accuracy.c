/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_accuracy.h"

static long double largest_of(const long double value[3])
{
    return fmaxl(fabsl(value[0]), fmaxl(fabsl(value[1]), fabsl(value[2])));
}

struct long_ray shader_accuracy_ray(const struct ray *ray, const float *matrix)
{
    struct long_ray world = candidates_ray(ray);
    return matrix ? candidates_ray_into(&world, matrix) : world;
}

/*
 * The sum of the rounding of floats of the box's size and of the slack in bvhd_box.glsl, with a factor of two to spare:
 * 2^-40 of the distance to the structure's farthest point; 2^-29, and a displacement of 2^-30 along axes to which the
 * ray is nearly perpendicular; and 2^-118 of t for underflow.
 */
long double shader_accuracy_box(const struct long_ray *ray, const float box[6], const float bounds[6])
{
    long double longest = largest_of(ray->direction), farthest = 0, size = 0;
    bool is_parallel = false;
    for (int axis = 0; axis < 3; axis++) {
        size = fmaxl(size, fmaxl(fabsl(ray->origin[axis]), fmaxl(fabsl(box[axis]), fabsl(box[3 + axis]))));
        farthest = fmaxl(farthest,
                         fmaxl(fabsl(bounds[axis] - ray->origin[axis]), fabsl(bounds[3 + axis] - ray->origin[axis])));
        is_parallel = is_parallel || fabsl(ray->direction[axis]) <= 0x1p-29L * longest;
    }
    return 1e-5L * size + farthest * (is_parallel ? 0x1p-27L : 0x1p-39L) + longest * 0x1p-117L;
}

bool shader_accuracy_allows_entry(const struct ray *ray, const float *matrix, const float box[6], const float bounds[6],
                                  float t)
{
    struct long_ray local = shader_accuracy_ray(ray, matrix);
    long double grow = shader_accuracy_box(&local, box, bounds), first, last, end, unused;
    if (!candidates_meet(&local, box, grow, &first, &end))
        return false;
    last = end;
    candidates_meet(&local, box, -grow, &last, &unused);
    last = fminl(last, end);
    return t >= first - 1e-5L * fabsl(first) && t <= last + 1e-5L * fabsl(last);
}

static void cross(const long double a[3], const long double b[3], long double ret_cross[3])
{
    for (int axis = 0; axis < 3; axis++) {
        int y = (axis + 1) % 3, z = (axis + 2) % 3;
        ret_cross[axis] = a[y] * b[z] - a[z] * b[y];
    }
}

static long double dot(const long double a[3], const long double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static long double length(const long double a[3])
{
    return sqrtl(dot(a, a));
}

/*
 * The largest component of |M^-1| |M| |M^-1| |x|. The rounding error of M^-1 x, corrected once by M, is proportional to
 * it.
 */
static long double size_through(long double inverse[3][3], const float m[12], const long double x[3])
{
    long double sizes[3] = {fabsl(x[0]), fabsl(x[1]), fabsl(x[2])}, next[3];
    for (int step = 0; step < 3; step++) {
        for (int row = 0; row < 3; row++) {
            next[row] = 0;
            for (int k = 0; k < 3; k++)
                next[row] += fabsl(step == 1 ? (long double)m[4 * row + k] : inverse[row][k]) * sizes[k];
        }
        for (int k = 0; k < 3; k++)
            sizes[k] = next[k];
    }
    return largest_of(sizes);
}

/*
 * Bounds the rounding error of bvhdToObject, which computes with pairs of floats and corrects the result once with
 * products of floats. 2^-43 of the sum of the terms' magnitudes exceeds it.
 */
static long double moved_by_matrix(const struct long_ray *ray, const float m[12], long double t)
{
    long double inverse[3][3], from[3];
    candidates_invert(m, inverse);
    for (int k = 0; k < 3; k++)
        from[k] = ray->origin[k] - m[4 * k + 3];
    return 0x1p-43L * (size_through(inverse, m, from) + fabsl(t) * size_through(inverse, m, ray->direction));
}

static bool is_near(float value, long double exact, long double slack)
{
    return fabsl(value - exact) <= slack;
}

/*
 * The intersection of Möller and Trumbore (1997). When a ray is displaced by 1, its t, u and v change by the lengths
 * of the three products, divided by det.
 */
bool shader_accuracy_allows(const struct ray *ray, const float *matrix, float corners[3][3], const struct ray_hit *hit)
{
    struct long_ray world = candidates_ray(ray), local = shader_accuracy_ray(ray, matrix);
    long double e1[3], e2[3], s[3], along[3], across[3], normal[3], q[3], distance = 0;
    for (int axis = 0; axis < 3; axis++) {
        e1[axis] = (long double)corners[1][axis] - corners[0][axis];
        e2[axis] = (long double)corners[2][axis] - corners[0][axis];
        s[axis] = local.origin[axis] - corners[0][axis];
        for (int k = 0; k < 3; k++)
            distance = fmaxl(distance, fabsl(corners[k][axis] - local.origin[axis]));
    }
    cross(local.direction, e2, along);
    cross(local.direction, e1, across);
    cross(e1, e2, normal);
    cross(s, e1, q);
    long double det = dot(e1, along), t = dot(e2, q) / det;
    /* bvhdTriangleHit: the shear has a relative error of about 2^-44. */
    long double moved = 0x1p-42L * distance + (matrix ? moved_by_matrix(&world, matrix, t) : 0);
    long double share = moved / fabsl(det), moved_u = share * length(along), moved_v = share * length(across);
    /* t is interpolated between the corners. */
    long double moved_t =
        share * length(normal) + (moved_u * length(e1) + moved_v * length(e2)) / length(local.direction);
    return is_near(hit->t, t, 0x1p-22L * fabsl(t) + 0x1p-140L + moved_t) &&
           is_near(hit->u, dot(s, along) / det, 1e-6L + moved_u) &&
           is_near(hit->v, dot(local.direction, q) / det, 1e-6L + moved_v);
}

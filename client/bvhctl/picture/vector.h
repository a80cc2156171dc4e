/* SPDX-License-Identifier: Apache-2.0 */
/* vector.h - three doubles: points, directions, linear colours. */
#ifndef BVHCTL_VECTOR_H
#define BVHCTL_VECTOR_H

#include <math.h>

struct vector {
    double x, y, z;
};

static inline struct vector vector_make(double x, double y, double z)
{
    return (struct vector){x, y, z};
}

static inline struct vector vector_from_floats(const float at[3])
{
    return vector_make((double)at[0], (double)at[1], (double)at[2]);
}

static inline double vector_component(struct vector a, int axis)
{
    return axis == 0 ? a.x : axis == 1 ? a.y : a.z;
}

static inline struct vector vector_add(struct vector a, struct vector b)
{
    return vector_make(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct vector vector_sub(struct vector a, struct vector b)
{
    return vector_make(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct vector vector_scale(struct vector a, double factor)
{
    return vector_make(a.x * factor, a.y * factor, a.z * factor);
}

/* a + b * factor */
static inline struct vector vector_mad(struct vector a, struct vector b, double factor)
{
    return vector_make(a.x + b.x * factor, a.y + b.y * factor, a.z + b.z * factor);
}

/* Multiplies component by component, as a filter does with a colour. */
static inline struct vector vector_mul(struct vector a, struct vector b)
{
    return vector_make(a.x * b.x, a.y * b.y, a.z * b.z);
}

static inline struct vector vector_mix(struct vector a, struct vector b, double fraction)
{
    return vector_mad(vector_scale(a, 1 - fraction), b, fraction);
}

static inline double vector_dot(struct vector a, struct vector b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vector vector_cross(struct vector a, struct vector b)
{
    return vector_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline double vector_length(struct vector a)
{
    return sqrt(vector_dot(a, a));
}

/* Vectors of any magnitude that floats have are allowed; the zero vector stays zero. */
static inline struct vector vector_unit(struct vector a)
{
    double length = vector_length(a);
    return length > 0 ? vector_scale(a, 1 / length) : a;
}

/* Transforms a point by a row-major 3x4 matrix. */
static inline struct vector vector_transform(const float m[12], struct vector p)
{
    return vector_make(m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3], m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
                       m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]);
}

/* Returns the unit normal of a triangle; 0 for a triangle without area. */
static inline struct vector vector_normal(const struct vector corners[3])
{
    /* The sides are normalized first, because squares of tiny or huge ones would leave the range of doubles. */
    return vector_unit(
        vector_cross(vector_unit(vector_sub(corners[1], corners[0])), vector_unit(vector_sub(corners[2], corners[0]))));
}

/* Returns two unit vectors that are perpendicular to the unit vector `n` and to each other (Duff 2017). */
static inline void vector_basis(struct vector n, struct vector *ret_a, struct vector *ret_b)
{
    double sign = copysign(1, n.z), a = -1 / (sign + n.z), b = n.x * n.y * a;
    *ret_a = vector_make(1 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *ret_b = vector_make(b, sign + n.y * n.y * a, -n.y);
}

#endif

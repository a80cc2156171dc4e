/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_radial.h - arithmetic with bounds on every error: a running error analysis in doubles.
 *
 * Each quantity has a centre and a radius, which enclose every value that it can take while each input (vertex, matrix
 * and ray component) moves by up to one float ulp, rounding included. Floats, and products of up to four of them,
 * neither overflow nor underflow a double.
 */
#ifndef BVHD_ORACLE_RADIAL_H
#define BVHD_ORACLE_RADIAL_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Relative errors: of a few roundings of a double, and of the computation of the radii themselves. */
#define RADIAL_ROUNDING (2 * DBL_EPSILON)
#define RADIAL_WIDEN (1 + 8 * DBL_EPSILON)

/* The interval [centre - radius, centre + radius]. */
struct radial {
    double centre, radius;
};

/* Returns the interval of a float that may move by one ulp, the distance between floats at its magnitude. */
static inline struct radial radial_input(float value)
{
    float power = fabsf(value);
    uint32_t bits;
    memcpy(&bits, &power, sizeof bits);
    bits &= 0x7f800000; /* only the exponent is left: the power of two at or below the value */
    memcpy(&power, &bits, sizeof bits);
    return (struct radial){value, bits ? power * (double)FLT_EPSILON : FLT_TRUE_MIN};
}

/* Adds what rounding changes in a result of this magnitude. */
static inline struct radial radial_rounded(double centre, double radius, double magnitude)
{
    return (struct radial){centre, (radius + RADIAL_ROUNDING * magnitude) * RADIAL_WIDEN};
}

static inline struct radial radial_add(struct radial a, struct radial b)
{
    double sum = a.centre + b.centre;
    return radial_rounded(sum, a.radius + b.radius, fabs(sum));
}

static inline struct radial radial_sub(struct radial a, struct radial b)
{
    double difference = a.centre - b.centre;
    return radial_rounded(difference, a.radius + b.radius, fabs(difference));
}

static inline struct radial radial_mul(struct radial a, struct radial b)
{
    double product = a.centre * b.centre;
    double radius = fabs(a.centre) * b.radius + fabs(b.centre) * a.radius + a.radius * b.radius;
    return radial_rounded(product, radius, fabs(product));
}

/* The interval b must not contain 0. */
static inline struct radial radial_div(struct radial a, struct radial b)
{
    double quotient = a.centre / b.centre;
    double radius = (a.radius + fabs(quotient) * b.radius) / (fabs(b.centre) - b.radius);
    return radial_rounded(quotient, radius, fabs(quotient));
}

/* These three return whether every value of the interval is positive, negative, or not zero. */
static inline bool radial_is_positive(struct radial a)
{
    return a.centre > a.radius;
}

static inline bool radial_is_negative(struct radial a)
{
    return a.centre < -a.radius;
}

static inline bool radial_is_nonzero(struct radial a)
{
    return fabs(a.centre) > a.radius;
}

static inline struct radial radial_exact(double value)
{
    return (struct radial){value, 0};
}

#endif

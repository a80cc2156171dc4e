/* SPDX-License-Identifier: Apache-2.0 */
/*
 * twofold.h - numbers of twice double's precision: sums of two doubles, of which the second is at most half a unit in
 * the last place of the first (Dekker 1971; the operations as in Joldes, Muller and Popescu 2017).
 *
 * A sum, a difference or a product has a relative error of at most 2^-103, a quotient or a square root 2^-100, unless
 * it or its parts overflow or underflow. The sum and the product of two doubles are exact.
 */
#ifndef BVHD_TWOFOLD_H
#define BVHD_TWOFOLD_H

#include <math.h>

struct twofold {
    double high, low;
};

/* Returns the sum of two doubles of which the first is the larger one, or which have no bits in common places. */
static inline struct twofold twofold_joined(double large, double small)
{
    const double sum = large + small;
    return (struct twofold){sum, small - (sum - large)};
}

static inline struct twofold twofold_sum(double a, double b)
{
    const double sum = a + b, from_b = sum - a;
    return (struct twofold){sum, (a - (sum - from_b)) + (b - from_b)};
}

static inline struct twofold twofold_product(double a, double b)
{
    const double product = a * b;
    return (struct twofold){product, fma(a, b, -product)};
}

static inline struct twofold twofold_add(struct twofold a, struct twofold b)
{
    const struct twofold high = twofold_sum(a.high, b.high), low = twofold_sum(a.low, b.low);
    const struct twofold sum = twofold_joined(high.high, high.low + low.high);
    return twofold_joined(sum.high, sum.low + low.low);
}

static inline struct twofold twofold_sub(struct twofold a, struct twofold b)
{
    return twofold_add(a, (struct twofold){-b.high, -b.low});
}

static inline struct twofold twofold_mul(struct twofold a, struct twofold b)
{
    const struct twofold product = twofold_product(a.high, b.high);
    return twofold_joined(product.high, product.low + (a.high * b.low + a.low * b.high));
}

static inline struct twofold twofold_div(struct twofold a, struct twofold b)
{
    const double first = a.high / b.high;
    const struct twofold rest = twofold_sub(a, twofold_mul(b, (struct twofold){first, 0}));
    return twofold_joined(first, rest.high / b.high);
}

/* Returns the square root, or 0 for a number that is not above 0. */
static inline struct twofold twofold_sqrt(struct twofold a)
{
    if (!(a.high > 0))
        return (struct twofold){0, 0};
    const double root = sqrt(a.high);
    const struct twofold rest = twofold_sub(a, twofold_product(root, root));
    return twofold_joined(root, rest.high / (2 * root));
}

#endif

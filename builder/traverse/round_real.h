/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_real.h - the arithmetic in which the tests of spheres and of linear swept spheres are compiled: first in
 * double, then, for what that leaves open, in twofold precision. It is not an ordinary header: a file includes it
 * before each of the two, the second time with ROUND_TWOFOLD defined.
 *
 *   REAL                  the type of numbers
 *   REAL_UNIT             the largest relative error of a sum, a difference or a product; twice that and less than
 *                         8 times that for quotients and roots
 *   REAL_IS_LAST          whether there is no more precise arithmetic, so that what is open counts as a hit
 *   REAL_NAME(name)       the name of a function that is compiled twice
 *   REAL_ADD, REAL_SUB, REAL_MUL, REAL_DIV, REAL_SQRT
 *   REAL_APART(a, b)      the difference of two doubles
 *   REAL_OF(a), REAL_ROUND(a)  converts from a double, and to one
 *
 * It also defines the vectors of these numbers.
 */
#undef REAL
#undef REAL_UNIT
#undef REAL_IS_LAST
#undef REAL_NAME
#undef REAL_ADD
#undef REAL_SUB
#undef REAL_MUL
#undef REAL_DIV
#undef REAL_SQRT
#undef REAL_APART
#undef REAL_OF
#undef REAL_ROUND

#include <math.h>

#include "builder/traverse/twofold.h"

#ifdef ROUND_TWOFOLD

#define REAL struct twofold
#define REAL_UNIT 0x1p-103
#define REAL_IS_LAST 1
#define REAL_NAME(name) name##_twofold
#define REAL_ADD(a, b) twofold_add(a, b)
#define REAL_SUB(a, b) twofold_sub(a, b)
#define REAL_MUL(a, b) twofold_mul(a, b)
#define REAL_DIV(a, b) twofold_div(a, b)
#define REAL_SQRT(a) twofold_sqrt(a)
#define REAL_APART(a, b) twofold_sum(a, -(b))
#define REAL_OF(a) ((struct twofold){a, 0})
#define REAL_ROUND(a) ((a).high)

#else

#define REAL double
#define REAL_UNIT 0x1p-53
#define REAL_IS_LAST 0
#define REAL_NAME(name) name##_double
#define REAL_ADD(a, b) ((a) + (b))
#define REAL_SUB(a, b) ((a) - (b))
#define REAL_MUL(a, b) ((a) * (b))
#define REAL_DIV(a, b) ((a) / (b))
#define REAL_SQRT(a) ((a) > 0 ? sqrt(a) : 0)
#define REAL_APART(a, b) ((a) - (b))
#define REAL_OF(a) (a)
#define REAL_ROUND(a) (a)

#endif

/* A vector, or the products that are made of two. */
struct REAL_NAME(vector) {
    REAL at[3];
};

static inline REAL REAL_NAME(dot)(const struct REAL_NAME(vector) * a, const struct REAL_NAME(vector) * b)
{
    return REAL_ADD(REAL_ADD(REAL_MUL(a->at[0], b->at[0]), REAL_MUL(a->at[1], b->at[1])), REAL_MUL(a->at[2], b->at[2]));
}

/*
 * Returns the cross product. The relative error of *ret_squared, which bounds the products that the differences are
 * made of, does not matter: the vector is wrong by at most 4 units of its square root, if the vectors are wrong by a
 * unit.
 */
static inline struct REAL_NAME(vector)
    REAL_NAME(cross)(const struct REAL_NAME(vector) * a, const struct REAL_NAME(vector) * b, double *ret_squared)
{
    struct REAL_NAME(vector) product;
    double squared = 0;
    for (int k = 0; k < 3; k++) {
        const int i = k == 2 ? 0 : k + 1, j = k == 0 ? 2 : k - 1;
        const REAL left = REAL_MUL(a->at[i], b->at[j]), right = REAL_MUL(a->at[j], b->at[i]);
        const double size = fabs(REAL_ROUND(left)) + fabs(REAL_ROUND(right));
        product.at[k] = REAL_SUB(left, right);
        squared += size * size;
    }
    *ret_squared = squared;
    return product;
}

/* Returns a bound of what the rounding of a dot product is relative to. */
static inline double REAL_NAME(dot_size)(const struct REAL_NAME(vector) * a, const struct REAL_NAME(vector) * b)
{
    return fabs(REAL_ROUND(a->at[0]) * REAL_ROUND(b->at[0])) + fabs(REAL_ROUND(a->at[1]) * REAL_ROUND(b->at[1])) +
           fabs(REAL_ROUND(a->at[2]) * REAL_ROUND(b->at[2]));
}

/* Returns the vector from one point to another. */
static inline struct REAL_NAME(vector) REAL_NAME(towards)(const double from[3], const float to[3])
{
    return (struct REAL_NAME(vector)){
        {REAL_APART(to[0], from[0]), REAL_APART(to[1], from[1]), REAL_APART(to[2], from[2])}};
}

static inline struct REAL_NAME(vector) REAL_NAME(direction_of)(const struct round_ray *ray)
{
    return (struct REAL_NAME(vector)){
        {REAL_OF(ray->direction[0]), REAL_OF(ray->direction[1]), REAL_OF(ray->direction[2])}};
}

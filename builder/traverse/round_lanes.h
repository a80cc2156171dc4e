/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_lanes.h - dismisses spheres and linear swept spheres that a ray misses for certain, eight at a time in float.
 * What it does not dismiss is decided by sphere.h and swept_sphere.h.
 *
 * Shapes are seen along the ray: p is the place of a centre across the ray, in a plane with two unit vectors, s its
 * place along the ray, both in units of length. There a sphere is a circle around p, and a linear swept sphere what a
 * circle sweeps. Let u be 2^-24. The unit vectors and the differences from the ray's origin are wrong by a unit, the
 * products of three terms by 3 more, so that p and s are wrong by at most 8u of the sum of the differences; a ray in an
 * instance's space adds the rounding of its origin. Twice that bound is `blur` below.
 *
 * With v = p1 - p0 and q = r0 - r1, the lines that touch both circles have the ray between them if
 *
 *   |p0 cross v| <= |r0 v + q p0|,
 *
 * and touch the circles on the shares of the way from 0 to 1 if 0 <= g <= k, where g = -(p0.v + r0 q), k = v.v - q^2.
 * The errors of both sides of the first one, and of g, are together at most
 *
 *   blur (|v| + 2 |p0| + 2 r0 + |q| + 2 blur) + 8u (|p0| + r0) (|v| + |q|).
 *
 * Squares of single numbers get a factor of 1 + 16u for their rounding, and FLT_MIN for underflow. Overflow, where it
 * happens, makes the side infinite that is to be the greater one, or makes a NaN; neither dismisses anything.
 */
#ifndef BVHD_ROUND_LANES_H
#define BVHD_ROUND_LANES_H

#include <float.h>

#include "builder/traverse/boxtest_kernels.h"
#include "builder/traverse/traverse_state.h"

#ifdef BOXTEST_AVX2

/* A ray, and its directions: two across it, and itself, of unit length. */
struct round_lanes_ray {
    float origin[3], across[2][3], along[3];
    float blur; /* how far the rounding of the origin can move a shape */
    float speed; /* the length of the direction, rounded up: distances are this often t */
    float tmin; /* as a length, rounded down */
};

/*
 * Prepares the ray of a state, of which the origin may be more precise than a float. Spheres do not need the directions
 * across it.
 */
static inline void round_lanes_init(const struct traverse_state *state, bool is_swept, struct round_lanes_ray *ret_ray)
{
    const double *d = state->round_ray.direction;
    const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), inverse = 1 / length;
    const double x = d[0] * inverse, y = d[1] * inverse, z = d[2] * inverse;
    float size = 0;
    bool is_rounded = false;
    for (int k = 0; k < 3; k++) {
        ret_ray->origin[k] = (float)state->origin[k];
        size += fabsf(ret_ray->origin[k]);
        is_rounded |= (double)ret_ray->origin[k] != state->origin[k];
    }
    if (is_swept) {
        /* Two unit vectors across a third (Duff et al. 2017). */
        const double sign = copysign(1, z), a = -1 / (sign + z), b = x * y * a;
        const double across[2][3] = {{1 + sign * x * x * a, sign * b, -sign * x}, {b, sign + y * y * a, -y}};
        for (int k = 0; k < 3; k++) {
            ret_ray->across[0][k] = (float)across[0][k];
            ret_ray->across[1][k] = (float)across[1][k];
        }
    }
    ret_ray->along[0] = (float)x;
    ret_ray->along[1] = (float)y;
    ret_ray->along[2] = (float)z;
    ret_ray->blur = is_rounded ? 0x1p-23f * size + FLT_MIN : FLT_MIN;
    const double speed = length / state->round_ray.scale;
    ret_ray->speed = (float)(speed * (1 + 0x1p-20));
    ret_ray->tmin = (float)(state->ray->tmin * speed);
    ret_ray->tmin -= 0x1p-20f * fabsf(ret_ray->tmin);
}

BOXTEST_AVX2_INLINE __m256 lanes_size(__m256 a)
{
    return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a);
}

BOXTEST_AVX2_INLINE __m256 lanes_dot(const __m256 a[3], const float b[3])
{
    return _mm256_fmadd_ps(
        a[2], _mm256_broadcast_ss(&b[2]),
        _mm256_fmadd_ps(a[1], _mm256_broadcast_ss(&b[1]), _mm256_mul_ps(a[0], _mm256_broadcast_ss(&b[0]))));
}

/* Places of spheres as seen along the ray. */
struct lanes_places {
    __m256 from[3], along, blur;
};

BOXTEST_AVX2_INLINE struct lanes_places lanes_places_of(const struct round_lanes_ray *ray, const __m256 spheres[4])
{
    struct lanes_places places;
    for (int k = 0; k < 3; k++)
        places.from[k] = _mm256_sub_ps(spheres[k], _mm256_broadcast_ss(&ray->origin[k]));
    const __m256 size = _mm256_add_ps(_mm256_add_ps(lanes_size(places.from[0]), lanes_size(places.from[1])),
                                      lanes_size(places.from[2]));
    places.along = lanes_dot(places.from, ray->along);
    places.blur = _mm256_fmadd_ps(size, _mm256_set1_ps(0x1p-20f), _mm256_broadcast_ss(&ray->blur));
    return places;
}

/* Circles across the ray. */
struct lanes_circles {
    __m256 x, y, along, radius, blur;
};

/* Returns the circles of spheres, whose four numbers are in four registers. */
BOXTEST_AVX2_INLINE struct lanes_circles lanes_circles_of(const struct round_lanes_ray *ray, const __m256 spheres[4])
{
    const struct lanes_places places = lanes_places_of(ray, spheres);
    return (struct lanes_circles){lanes_dot(places.from, ray->across[0]), lanes_dot(places.from, ray->across[1]),
                                  places.along, spheres[3], places.blur};
}

/* Returns the square of the distance from the ray. */
BOXTEST_AVX2_INLINE __m256 lanes_apart(const struct lanes_circles *circles)
{
    return _mm256_fmadd_ps(circles->x, circles->x, _mm256_mul_ps(circles->y, circles->y));
}

/*
 * Does the same without a plane across the ray: by the place of the centre without its part along the ray, whose
 * components are wrong by that part's error, too.
 */
BOXTEST_AVX2_INLINE __m256 lanes_apart_of(const struct round_lanes_ray *ray, const struct lanes_places *places)
{
    __m256 squares = _mm256_setzero_ps();
    for (int k = 0; k < 3; k++) {
        const __m256 rest = _mm256_fnmadd_ps(places->along, _mm256_broadcast_ss(&ray->along[k]), places->from[k]);
        squares = _mm256_fmadd_ps(rest, rest, squares);
    }
    return squares;
}

/* Returns a - b, or 0 if that is negative. */
BOXTEST_AVX2_INLINE __m256 lanes_less(__m256 a, __m256 b)
{
    return _mm256_max_ps(_mm256_sub_ps(a, b), _mm256_setzero_ps());
}

/* Returns a number that is made larger, by its rounding errors and by those of underflow. */
BOXTEST_AVX2_INLINE __m256 lanes_more(__m256 a)
{
    return _mm256_fmadd_ps(a, _mm256_set1_ps(1 + 0x1p-19f), _mm256_set1_ps(FLT_MIN));
}

/*
 * Returns the spheres that the ray may enter between its tmin and `reach`, a length, as bits. ret_near are lower bounds
 * of the lengths at which it enters.
 */
BOXTEST_AVX2_INLINE unsigned lanes_meet_spheres(const struct round_lanes_ray *ray, const __m256 spheres[4], float reach,
                                                float ret_near[8])
{
    const struct lanes_places places = lanes_places_of(ray, spheres);
    const __m256 apart = lanes_apart_of(ray, &places), outer = _mm256_add_ps(spheres[3], places.blur),
                 inner = lanes_less(spheres[3], places.blur);
    const __m256 most = _mm256_sub_ps(lanes_more(_mm256_mul_ps(outer, outer)), apart),
                 least = _mm256_sub_ps(_mm256_mul_ps(inner, inner), lanes_more(apart));
    const __m256 deepest = lanes_more(_mm256_sqrt_ps(_mm256_max_ps(most, _mm256_setzero_ps()))),
                 flattest = _mm256_sqrt_ps(_mm256_max_ps(least, _mm256_setzero_ps()));
    const __m256 near = _mm256_sub_ps(_mm256_sub_ps(places.along, deepest), places.blur),
                 far =
                     _mm256_add_ps(_mm256_fnmadd_ps(flattest, _mm256_set1_ps(1 - 0x1p-19f), places.along), places.blur);
    const __m256 out = _mm256_or_ps(_mm256_cmp_ps(lanes_more(most), _mm256_setzero_ps(), _CMP_LT_OQ),
                                    _mm256_or_ps(_mm256_cmp_ps(near, _mm256_set1_ps(reach), _CMP_GT_OQ),
                                                 _mm256_cmp_ps(far, _mm256_broadcast_ss(&ray->tmin), _CMP_LT_OQ)));
    _mm256_storeu_ps(ret_near, near);
    return ~(unsigned)_mm256_movemask_ps(out) & 0xff;
}

/* Does the same for linear swept spheres with all caps; the second end follows the first one. */
BOXTEST_AVX2_INLINE unsigned lanes_meet_swept(const struct round_lanes_ray *ray, const __m256 ends[8], float reach,
                                              float ret_near[8])
{
    const struct lanes_circles first = lanes_circles_of(ray, ends), second = lanes_circles_of(ray, ends + 4);
    const __m256 zero = _mm256_setzero_ps(), blur = _mm256_max_ps(first.blur, second.blur);
    const __m256 near = _mm256_sub_ps(_mm256_min_ps(_mm256_sub_ps(first.along, first.radius),
                                                    _mm256_sub_ps(second.along, second.radius)),
                                      blur),
                 far = _mm256_add_ps(_mm256_max_ps(_mm256_add_ps(first.along, first.radius),
                                                   _mm256_add_ps(second.along, second.radius)),
                                     blur);
    const __m256 in_first = _mm256_add_ps(first.radius, blur), in_second = _mm256_add_ps(second.radius, blur);
    const __m256 misses_ends =
        _mm256_and_ps(_mm256_cmp_ps(lanes_apart(&first), lanes_more(_mm256_mul_ps(in_first, in_first)), _CMP_GT_OQ),
                      _mm256_cmp_ps(lanes_apart(&second), lanes_more(_mm256_mul_ps(in_second, in_second)), _CMP_GT_OQ));

    const __m256 x = _mm256_sub_ps(second.x, first.x), y = _mm256_sub_ps(second.y, first.y),
                 q = _mm256_sub_ps(first.radius, second.radius);
    const __m256 cross = lanes_size(_mm256_fmsub_ps(first.x, y, _mm256_mul_ps(first.y, x)));
    const __m256 side_x = _mm256_fmadd_ps(first.radius, x, _mm256_mul_ps(q, first.x)),
                 side_y = _mm256_fmadd_ps(first.radius, y, _mm256_mul_ps(q, first.y));
    const __m256 away = _mm256_add_ps(lanes_size(first.x), lanes_size(first.y)),
                 way = _mm256_add_ps(lanes_size(x), lanes_size(y)), taper = lanes_size(q);
    const __m256 sides = _mm256_add_ps(way, taper), places = _mm256_add_ps(away, first.radius);
    const __m256 both = _mm256_fmadd_ps(_mm256_set1_ps(2), _mm256_add_ps(places, blur), sides);
    const __m256 open =
        lanes_more(_mm256_fmadd_ps(_mm256_mul_ps(_mm256_set1_ps(0x1p-21f), places), sides, _mm256_mul_ps(blur, both)));
    const __m256 beside = lanes_less(cross, open);
    const __m256 squared_side = _mm256_fmadd_ps(side_x, side_x, _mm256_mul_ps(side_y, side_y));
    const __m256 misses_lines = _mm256_cmp_ps(_mm256_mul_ps(beside, beside), lanes_more(squared_side), _CMP_GT_OQ);
    const __m256 minus_g = _mm256_fmadd_ps(first.x, x, _mm256_fmadd_ps(first.y, y, _mm256_mul_ps(first.radius, q)));
    const __m256 k = _mm256_fmadd_ps(x, x, _mm256_fmsub_ps(y, y, _mm256_mul_ps(q, q)));
    const __m256 k_open = _mm256_fmadd_ps(_mm256_set1_ps(4), _mm256_mul_ps(blur, _mm256_add_ps(way, blur)),
                                          _mm256_mul_ps(_mm256_set1_ps(0x1p-21f), _mm256_mul_ps(sides, sides)));
    const __m256 beyond = _mm256_add_ps(minus_g, k); /* of the second end, if it is negative */
    const __m256 misses_way =
        _mm256_or_ps(_mm256_cmp_ps(minus_g, open, _CMP_GT_OQ),
                     _mm256_cmp_ps(_mm256_add_ps(beyond, _mm256_add_ps(open, lanes_more(k_open))), zero, _CMP_LT_OQ));
    const __m256 out = _mm256_or_ps(_mm256_and_ps(misses_ends, _mm256_or_ps(misses_lines, misses_way)),
                                    _mm256_or_ps(_mm256_cmp_ps(near, _mm256_set1_ps(reach), _CMP_GT_OQ),
                                                 _mm256_cmp_ps(far, _mm256_broadcast_ss(&ray->tmin), _CMP_LT_OQ)));
    _mm256_storeu_ps(ret_near, near);
    return ~(unsigned)_mm256_movemask_ps(out) & 0xff;
}

#endif
#endif

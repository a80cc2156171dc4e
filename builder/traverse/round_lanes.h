/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_lanes.h - spheres and linear swept spheres against rays, four pairs at once in double: four shapes and one ray,
 * or one shape and four rays. Where double decides, answers are those of sphere.h and swept_sphere.h to the last bit,
 * because the same operations make them; what it leaves open is passed to these. Letters are those of these headers.
 *
 * The bounds of errors here are at least those of sphere_steps.h and swept_sphere_steps.h, so that what is clear here
 * is clear there. They need fewer roots. With u = 2^-53, the squared sizes of the products in f cross d are at most
 * 2 f.f d.d, and the same holds for v.
 */
#ifndef BVHD_ROUND_LANES_H
#define BVHD_ROUND_LANES_H

#include <float.h>

#include "builder/traverse/boxtest_kernels.h"
#include "builder/traverse/round_ray.h"

#ifdef BOXTEST_AVX2

/* Four rays, or one of them four times, as struct round_ray has one. */
struct round_lanes_ray {
    __m256d origin[3], direction[3];
    __m256d squared; /* d.d */
    __m256d scale;
    __m256d tmin; /* lowered by lanes_least() */
    __m256d behind; /* 0 if tmin >= 0, so that nothing behind the origin counts; else minus infinity */
};

/*
 * Returns where a ray begins, less what rounding may add to the distance of a hit: hits before that are dismissed
 * without a precise distance.
 */
BOXTEST_AVX2_INLINE __m256d lanes_least(__m256d tmin)
{
    const __m256d size = _mm256_andnot_pd(_mm256_set1_pd(-0.0), tmin);
    return _mm256_fnmadd_pd(_mm256_set1_pd(0x1p-40), size, tmin);
}

/* The answers for four pairs. */
struct round_lanes_hits {
    __m256d t, u; /* of the pairs that hit */
    unsigned hits; /* the pairs of which the ray enters the shape, as bits */
    unsigned open; /* the pairs that double does not decide */
    unsigned ends[2]; /* the pairs of which the ray can enter only the cap of the first, or of the second end */
};

/* Four lanes of all ones where a condition holds. */
BOXTEST_AVX2_INLINE __m256d lanes_less(__m256d a, __m256d b)
{
    return _mm256_cmp_pd(a, b, _CMP_LT_OQ);
}

BOXTEST_AVX2_INLINE __m256d lanes_size(__m256d a)
{
    return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a);
}

BOXTEST_AVX2_INLINE __m256d lanes_minus(__m256d a)
{
    return _mm256_xor_pd(_mm256_set1_pd(-0.0), a);
}

BOXTEST_AVX2_INLINE __m256d lanes_times(double a, __m256d b)
{
    return _mm256_mul_pd(_mm256_set1_pd(a), b);
}

BOXTEST_AVX2_INLINE unsigned lanes_bits(__m256d a)
{
    return (unsigned)_mm256_movemask_pd(a);
}

/* The operations of round_real.h. Results that become answers use no fused operations, which would round less. */
BOXTEST_AVX2_INLINE __m256d lanes_dot(const __m256d a[3], const __m256d b[3])
{
    return _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])),
                         _mm256_mul_pd(a[2], b[2]));
}

BOXTEST_AVX2_INLINE void lanes_cross(const __m256d a[3], const __m256d b[3], __m256d ret_product[3])
{
    for (int k = 0; k < 3; k++) {
        const int i = k == 2 ? 0 : k + 1, j = k == 0 ? 2 : k - 1;
        ret_product[k] = _mm256_sub_pd(_mm256_mul_pd(a[i], b[j]), _mm256_mul_pd(a[j], b[i]));
    }
}

/* Returns a bound of what the rounding of a dot product is relative to. */
BOXTEST_AVX2_INLINE __m256d lanes_dot_size(const __m256d a[3], const __m256d b[3])
{
    return _mm256_add_pd(_mm256_add_pd(lanes_size(_mm256_mul_pd(a[0], b[0])), lanes_size(_mm256_mul_pd(a[1], b[1]))),
                         lanes_size(_mm256_mul_pd(a[2], b[2])));
}

/* Sets the answer of pairs none of which hits. */
BOXTEST_AVX2_INLINE void lanes_miss(struct round_lanes_hits *ret_hits)
{
    ret_hits->hits = ret_hits->open = ret_hits->ends[0] = ret_hits->ends[1] = 0;
}

/* Returns the pairs that are left to decide or hit. */
BOXTEST_AVX2_INLINE unsigned lanes_met(const struct round_lanes_hits *hits)
{
    return hits->hits | hits->open | hits->ends[0] | hits->ends[1];
}

/*
 * Tests `wanted` pairs, as bits, of rays and spheres, of which the radius follows the centre. Distances beyond tmax,
 * one for each pair, are dismissed.
 *
 * The first dismissal allows 32u (f.f d.d + r^2 d.d) for the discriminant. With the sizes above, the bound of
 * sphere_steps.h is at most u (8 sqrt(2) + 8 + 2^-40) f.f d.d + 8u r^2 d.d, and what its own rounding adds.
 */
BOXTEST_AVX2_INLINE void lanes_meet_spheres(const struct round_lanes_ray *ray, const __m256d sphere[4], __m256d tmax,
                                            unsigned wanted, struct round_lanes_hits *ret_hits)
{
    const double u = 0x1p-53, precise = 0x1p45; /* three errors below 2^-45 are below round_distance_error */
    const __m256d *d = ray->direction, dd = ray->squared;
    __m256d f[3], x[3];
    for (int k = 0; k < 3; k++)
        f[k] = _mm256_sub_pd(sphere[k], ray->origin[k]);
    lanes_cross(f, d, x);
    const __m256d squared_r = _mm256_mul_pd(sphere[3], sphere[3]), reach = _mm256_mul_pd(squared_r, dd),
                  missed = lanes_dot(x, x), discriminant = _mm256_sub_pd(reach, missed);
    const __m256d ff = lanes_dot(f, f), size = _mm256_mul_pd(ff, dd), fd = lanes_dot(f, d);
    const __m256d wide = lanes_times(32 * u, _mm256_add_pd(size, reach)),
                  fd_open = lanes_times(8 * u, lanes_dot_size(f, d));
    wanted &= ~lanes_bits(
        _mm256_or_pd(lanes_less(discriminant, lanes_minus(wide)), lanes_less(_mm256_add_pd(fd, fd_open), ray->behind)));
    if (wanted == 0) {
        lanes_miss(ret_hits);
        return;
    }

    const __m256d outside = _mm256_sub_pd(ff, squared_r),
                  outside_open = lanes_times(8 * u, _mm256_add_pd(ff, squared_r));
    wanted &= ~lanes_bits(lanes_less(_mm256_add_pd(outside, outside_open), ray->behind));
    const __m256d wider = _mm256_sqrt_pd(lanes_times(2.0001, _mm256_mul_pd(missed, size)));
    const __m256d open = lanes_times(
        8.0001 * u, _mm256_add_pd(_mm256_fmadd_pd(_mm256_set1_pd(8 * u), size, wider), _mm256_add_pd(missed, reach)));
    const __m256d root = _mm256_sqrt_pd(discriminant), below = _mm256_add_pd(fd, root);
    const __m256d t = _mm256_mul_pd(_mm256_div_pd(outside, below), ray->scale);
    __m256d clear = _mm256_and_pd(lanes_less(wide, discriminant), lanes_less(_mm256_setzero_pd(), fd));
    clear = _mm256_and_pd(clear, lanes_less(lanes_times(precise, outside_open), lanes_size(outside)));
    clear = _mm256_and_pd(clear, lanes_less(lanes_times(precise, fd_open), below));
    clear = _mm256_and_pd(clear, lanes_less(lanes_times(precise, open), _mm256_mul_pd(below, root)));
    clear = _mm256_and_pd(clear, lanes_less(_mm256_setzero_pd(), sphere[3]));
    clear = _mm256_and_pd(clear, _mm256_cmp_pd(lanes_size(t), _mm256_set1_pd(DBL_MAX), _CMP_LE_OQ));
    ret_hits->t = t;
    ret_hits->u = _mm256_setzero_pd();
    ret_hits->ends[0] = ret_hits->ends[1] = 0;
    ret_hits->open = wanted & ~lanes_bits(clear);
    ret_hits->hits = wanted & lanes_bits(_mm256_and_pd(clear, _mm256_cmp_pd(t, tmax, _CMP_LE_OQ)));
}

/* Numbers of four linear swept spheres, as struct cone of swept_sphere_steps.h has them. */
struct lanes_cone {
    __m256d f[3], way[3], xx, vv, length, ff, rr_dd, qq_dd, rq_dd; /* what the others are made of */
    __m256d c, g, k, h;
    __m256d last, last_open; /* c of the second end, and a bound of its error */
};

/*
 * Tests the ends and the cone between them as a whole. Returns the pairs that may meet.
 *
 * The sphere at share z is met if k z^2 - 2 g z + c <= 0. So nothing is met if that is positive at both ends, where it
 * is c and k - 2 g + c, and between them: because its least value is not between them, which is where g < 0 or g > k,
 * or is positive, which is where h < 0. That also holds without caps, and if one end swallows the other.
 *
 * Let S = (f.f + D.D + r0^2 + r1^2) d.d. Then |c| and |k| are at most S, and |g| at most 3/2 S. The errors of each are
 * at most 20u S, those of their sums and differences here at most 104u S, and that of h a quarter of `h_open`.
 */
BOXTEST_AVX2_INLINE unsigned lanes_meet_cones(const struct round_lanes_ray *ray, const __m256d first[4],
                                              const __m256d second[4], unsigned wanted, struct lanes_cone *ret_cone)
{
    const double u = 0x1p-53;
    const __m256d *d = ray->direction, dd = ray->squared, r = first[3], q = _mm256_sub_pd(first[3], second[3]);
    struct lanes_cone cone;
    __m256d x[3], v[3];
    for (int k = 0; k < 3; k++) {
        cone.f[k] = _mm256_sub_pd(first[k], ray->origin[k]);
        cone.way[k] = _mm256_sub_pd(second[k], first[k]);
    }
    lanes_cross(cone.f, d, x);
    lanes_cross(cone.way, d, v);
    cone.xx = lanes_dot(x, x);
    cone.vv = lanes_dot(v, v);
    cone.length = lanes_dot(cone.way, cone.way);
    cone.ff = lanes_dot(cone.f, cone.f);
    const __m256d rr = _mm256_mul_pd(r, r);
    cone.rr_dd = _mm256_mul_pd(rr, dd);
    cone.qq_dd = _mm256_mul_pd(_mm256_mul_pd(q, q), dd);
    cone.rq_dd = _mm256_mul_pd(_mm256_mul_pd(r, q), dd);
    const __m256d c = _mm256_sub_pd(cone.xx, cone.rr_dd), k = _mm256_sub_pd(cone.vv, cone.qq_dd),
                  g = _mm256_sub_pd(_mm256_setzero_pd(), _mm256_add_pd(lanes_dot(x, v), cone.rq_dd));
    const __m256d h = _mm256_sub_pd(_mm256_mul_pd(g, g), _mm256_mul_pd(k, c));

    const __m256d squares =
        _mm256_fmadd_pd(second[3], second[3], _mm256_add_pd(rr, _mm256_add_pd(cone.ff, cone.length)));
    const __m256d open = lanes_times(128 * u, _mm256_mul_pd(squares, dd));
    const __m256d g_size = lanes_size(g), k_size = lanes_size(k), c_size = lanes_size(c);
    const __m256d sizes = _mm256_add_pd(_mm256_add_pd(_mm256_add_pd(g_size, g_size), _mm256_add_pd(k_size, c_size)),
                                        _mm256_add_pd(open, open));
    const __m256d h_open = _mm256_mul_pd(open, sizes);
    const __m256d past = _mm256_sub_pd(k, g), last = _mm256_add_pd(_mm256_sub_pd(past, g), c);
    const __m256d misses_ends = _mm256_and_pd(lanes_less(open, c), lanes_less(open, last));
    const __m256d misses_between =
        _mm256_or_pd(_mm256_or_pd(lanes_less(g, lanes_minus(open)), lanes_less(past, lanes_minus(open))),
                     lanes_less(h, lanes_minus(h_open)));
    wanted &= ~lanes_bits(_mm256_and_pd(misses_ends, misses_between));
    cone.c = c;
    cone.g = g;
    cone.k = k;
    cone.h = h;
    cone.last = last;
    cone.last_open = open;
    *ret_cone = cone;
    return wanted;
}

/* Bounds of the errors of these numbers. */
struct lanes_cone_open {
    __m256d c, g, k, h;
};

/* Returns the bounds of swept_sphere_steps.h, or greater ones. */
BOXTEST_AVX2_INLINE struct lanes_cone_open lanes_open_cones(const struct lanes_cone *cone, __m256d dd)
{
    const double u = 0x1p-53;
    struct lanes_cone_open open;
    const __m256d x_squared = lanes_times(2.0001, _mm256_mul_pd(cone->ff, dd)),
                  v_squared = lanes_times(2.0001, _mm256_mul_pd(cone->length, dd));
    const __m256d x_long = _mm256_sqrt_pd(cone->xx), x_wide = _mm256_sqrt_pd(x_squared),
                  v_wide = _mm256_sqrt_pd(v_squared); /* of which the length of v is at most the 1.4th part */
    const __m256d g = lanes_size(cone->g), k = lanes_size(cone->k), c = lanes_size(cone->c);
    open.c = lanes_times(8.0001 * u, _mm256_add_pd(_mm256_fmadd_pd(x_long, x_wide, lanes_times(4 * u, x_squared)),
                                                   _mm256_add_pd(cone->xx, cone->rr_dd)));
    open.k =
        lanes_times(8.0001 * u, _mm256_add_pd(lanes_times(1.0001, v_squared), _mm256_add_pd(cone->vv, cone->qq_dd)));
    const __m256d mixed =
        _mm256_mul_pd(v_wide, _mm256_fmadd_pd(x_long, _mm256_set1_pd(1.5), lanes_times(0.5001, x_wide)));
    open.g = lanes_times(8.0001 * u, _mm256_add_pd(mixed, lanes_size(cone->rq_dd)));
    const __m256d kc = _mm256_mul_pd(k, c), gg = _mm256_mul_pd(g, g);
    const __m256d of_g = _mm256_mul_pd(open.g, _mm256_fmadd_pd(_mm256_set1_pd(2), g, open.g)),
                  of_c = _mm256_mul_pd(open.c, _mm256_add_pd(k, open.k)), of_k = _mm256_mul_pd(c, open.k);
    open.h = lanes_times(1.0001, _mm256_add_pd(_mm256_add_pd(of_g, lanes_times(4 * u, _mm256_add_pd(gg, kc))),
                                               _mm256_add_pd(of_c, of_k)));
    return open;
}

/*
 * Tests `wanted` pairs, as bits, of rays and linear swept spheres, whose second ends follow the first ones. Distances
 * beyond tmax, one for each pair, are dismissed.
 */
BOXTEST_AVX2_INLINE void lanes_meet_swept(const struct round_lanes_ray *ray, const __m256d first[4],
                                          const __m256d second[4], __m256d tmax, unsigned wanted,
                                          struct round_lanes_hits *ret_hits)
{
    const double u = 0x1p-53;
    const __m256d zero = _mm256_setzero_pd(), dd = ray->squared;
    struct lanes_cone cone;
    wanted = lanes_meet_cones(ray, first, second, wanted, &cone);
    if (wanted == 0) {
        lanes_miss(ret_hits);
        return;
    }
    const struct lanes_cone_open open = lanes_open_cones(&cone, dd);
    /* What swept_sphere_steps.h finds before it enters the cone; one that a ray meets in both halves is left open. */
    const __m256d qq = _mm256_mul_pd(_mm256_sub_pd(first[3], second[3]), _mm256_sub_pd(first[3], second[3]));
    const __m256d slack = _mm256_sub_pd(cone.length, qq),
                  slack_open = lanes_times(8 * u, _mm256_add_pd(cone.length, qq));
    const __m256d is_usual = _mm256_and_pd(lanes_less(slack_open, slack), lanes_less(open.k, cone.k));
    __m256d clear = _mm256_and_pd(is_usual, lanes_less(open.h, cone.h)),
            missed = _mm256_and_pd(is_usual, lanes_less(cone.h, lanes_minus(open.h)));

    /* Where the cone is entered, with the bounds of errors of enter_cone(). */
    const __m256d towards = lanes_dot(cone.way, ray->direction),
                  towards_open = lanes_times(8 * u, lanes_dot_size(cone.way, ray->direction));
    const __m256d along = lanes_size(towards), g = lanes_size(cone.g), c = lanes_size(cone.c);
    const __m256d e = _mm256_mul_pd(dd, slack), side = _mm256_mul_pd(towards, cone.g),
                  product = _mm256_mul_pd(e, cone.h), root = _mm256_sqrt_pd(_mm256_max_pd(product, zero));
    const __m256d e_open = _mm256_fmadd_pd(dd, slack_open, lanes_times(8 * u, e));
    const __m256d product_open =
        _mm256_fmadd_pd(e, open.h, _mm256_fmadd_pd(e_open, _mm256_add_pd(cone.h, open.h), lanes_times(2 * u, product)));
    const __m256d root_open = _mm256_fmadd_pd(_mm256_set1_pd(4 * u), root, _mm256_div_pd(product_open, root));
    const __m256d side_open =
        _mm256_fmadd_pd(along, open.g, _mm256_fmadd_pd(g, towards_open, _mm256_mul_pd(open.g, towards_open)));
    const __m256d sum_open = _mm256_add_pd(_mm256_fmadd_pd(lanes_times(2 * u, along), g, side_open), root_open);
    const __m256d is_front = lanes_less(zero, side);
    const __m256d gg = _mm256_mul_pd(cone.g, cone.g), ec = _mm256_mul_pd(e, cone.c);
    const __m256d front_above = _mm256_sub_pd(ec, gg), back_above = _mm256_sub_pd(side, root);
    const __m256d above = _mm256_blendv_pd(back_above, front_above, is_front);
    const __m256d below = _mm256_mul_pd(dd, _mm256_blendv_pd(cone.k, _mm256_add_pd(side, root), is_front));
    const __m256d front_open =
        _mm256_fmadd_pd(e, open.c,
                        _mm256_fmadd_pd(e_open, _mm256_add_pd(c, open.c),
                                        _mm256_fmadd_pd(open.g, _mm256_fmadd_pd(_mm256_set1_pd(2), g, open.g),
                                                        lanes_times(4 * u, _mm256_add_pd(lanes_size(ec), gg)))));
    const __m256d back_open = _mm256_fmadd_pd(_mm256_set1_pd(2 * u), lanes_size(back_above), sum_open);
    const __m256d above_open = _mm256_blendv_pd(back_open, front_open, is_front);
    const __m256d below_open =
        _mm256_fmadd_pd(dd, _mm256_blendv_pd(open.k, sum_open, is_front), lanes_times(8 * u, lanes_size(below)));
    const __m256d way = _mm256_div_pd(above, below), way_size = lanes_size(way);
    const __m256d surely_below = _mm256_max_pd(_mm256_sub_pd(lanes_size(below), below_open), zero);
    const __m256d way_open = lanes_times(
        1.0001, _mm256_fmadd_pd(_mm256_set1_pd(8 * u), way_size,
                                _mm256_div_pd(_mm256_fmadd_pd(way_size, below_open, above_open), surely_below)));
    const __m256d y = _mm256_add_pd(_mm256_div_pd(cone.g, dd), _mm256_mul_pd(way, towards));
    const __m256d y_open = lanes_times(
        1.0001, _mm256_add_pd(_mm256_div_pd(_mm256_fmadd_pd(_mm256_set1_pd(16 * u), g, open.g), dd),
                              _mm256_fmadd_pd(way_open, _mm256_add_pd(along, towards_open),
                                              _mm256_mul_pd(way_size, _mm256_fmadd_pd(_mm256_set1_pd(4 * u), along,
                                                                                      towards_open)))));
    const __m256d beyond = _mm256_sub_pd(y, slack),
                  beyond_open = _mm256_add_pd(y_open, _mm256_fmadd_pd(_mm256_set1_pd(2.0001 * u), slack, slack_open));
    clear = _mm256_and_pd(clear, _mm256_cmp_pd(_mm256_min_pd(first[3], second[3]), zero, _CMP_GE_OQ));
    const __m256d before_first = _mm256_and_pd(clear, lanes_less(y, lanes_minus(y_open))),
                  past_second = _mm256_and_pd(clear, lanes_less(beyond_open, beyond));
    clear = _mm256_and_pd(clear, _mm256_and_pd(lanes_less(y_open, y), lanes_less(beyond, lanes_minus(beyond_open))));
    const __m256d fd = lanes_dot(cone.f, ray->direction), next = _mm256_div_pd(fd, dd), t = _mm256_add_pd(next, way);
    const __m256d next_open = _mm256_div_pd(lanes_times(24.0001 * u, lanes_dot_size(cone.f, ray->direction)), dd);
    const __m256d t_size = lanes_size(t),
                  t_open = _mm256_fmadd_pd(_mm256_set1_pd(2.0001 * u), t_size, _mm256_add_pd(next_open, way_open));
    missed = _mm256_or_pd(missed, _mm256_and_pd(clear, lanes_less(_mm256_add_pd(t, t_open), ray->tmin)));
    const __m256d at = _mm256_mul_pd(t, ray->scale);
    clear = _mm256_and_pd(clear, lanes_less(t_open, lanes_times(round_distance_error, t_size)));
    clear = _mm256_and_pd(clear, _mm256_cmp_pd(lanes_size(at), _mm256_set1_pd(DBL_MAX), _CMP_LE_OQ));
    ret_hits->t = at;
    ret_hits->u = _mm256_min_pd(_mm256_max_pd(_mm256_div_pd(y, slack), zero), _mm256_set1_pd(1));
    /* The ends without those that the ray misses. */
    ret_hits->ends[0] = wanted & lanes_bits(_mm256_andnot_pd(lanes_less(open.c, cone.c), before_first));
    ret_hits->ends[1] = wanted & lanes_bits(_mm256_andnot_pd(lanes_less(cone.last_open, cone.last), past_second));
    wanted &= ~lanes_bits(_mm256_or_pd(missed, _mm256_or_pd(before_first, past_second)));
    ret_hits->open = wanted & ~lanes_bits(clear);
    ret_hits->hits = wanted & lanes_bits(_mm256_and_pd(clear, _mm256_cmp_pd(at, tmax, _CMP_LE_OQ)));
}

#endif
#endif

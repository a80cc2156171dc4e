/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest.h - a ray against the eight children of a node, and against one AABB. Never misses a box that the ray meets
 * (Ize 2013).
 *
 * Child planes lie at origin + q * scale. With A = (origin - o) / d and S = scale / d the ray meets one at t = A + q *
 * S: one multiplication and one addition a plane. What rounding does to it, with u = 2^-24 (float) and every
 * operation's error at most u of its result:
 *
 *   1 / d                     u                        of A and of S
 *   origin - o, times 1 / d   2u                       of A
 *   scale / d                 u                        of S (a power of two)
 *   A -+ E, q * S, their sum  2u |A| + 2u |q S|        E is the bound itself; its own rounding is of second order
 *
 * altogether 5u |A| + 4u |q S|, so E = 8u (|A| + 255 |S|) + slack is a bound with room to spare. The slack, in units of
 * t and constant over a structure, covers what does not shrink with A and S:
 *  - the rounding of an instance's ray, whose origin is known in double, to a float origin: |o - (float)o| / |d|;
 *  - underflow of products: below 2^-118 for the ranges that boxtest_init accepts;
 *  - the triangle test (triangle.h). On each axis it moves corners by less than 2^-50 of their distance from the ray's origin, along that axis
 *    and along the ray's main axis, and t by less than 2^-42 of the latter; the structure's bounds limit both. So what it calls a hit at t
 *    lies in the intervals of all boxes around it, and culling by the closest hit so far cannot change an answer.
 *
 * Eight wide, with fused operations, the bound shrinks to 3u |A| + u |q S| + u |A + q S|. With R the distance from the
 * ray's origin to the farthest corner of the structure on that axis, over |d|: |A| and |A + q S| are at most R and |q
 * S| at most 2R (and some hundredths more, as planes are rounded outward), so 8u R + slack bounds it for every node.
 * That is a constant of the ray, and what makes the test fast; but it can pass the size of small nodes of structures
 * that have an outlier. Those are left to the test above: nodes with an axis on which 8u of that distance is more than
 * about 1/64 of the node.
 *
 * An axis along which the ray hardly moves has no usable 1 / d. There the position is compared instead, with a slack in
 * units of length that covers the small movement within the structure's bounds.
 */
#ifndef BVHD_BOXTEST_H
#define BVHD_BOXTEST_H

#include "builder/format/portable.h"

/*
 * Where in a node the planes lie that a ray meets first, and last: lo or hi of each axis, by the direction's sign.
 * Bytes.
 */
struct boxtest_planes {
    uint32_t near[3], far[3];
};

/* A ray in one structure's space, for float tests. Of the arrays of four, the last is of no use. */
struct boxtest_ray {
    _Alignas(16) float origin[4];
    float inverse[4]; /* 1 / direction; 0 for parallel axes */
    float slack[4]; /* in t; FLT_MAX for parallel axes, which makes their interval everything */
    float common_slack[4]; /* the same with the bound for all nodes */
    float wide_scale[4]; /* nodes with a smaller scale, but for 0, are too small for that bound; the last is 0 */
    const struct boxtest_planes *planes;
    float tmin;
    uint32_t backward; /* bit a: along axis a the direction is negative */
    uint32_t parallel_axes; /* bit a: axis a is compared by position */
    float parallel_slack[3]; /* in length */
};

/* The same in double, for every ray and structure. */
struct boxtest_exact {
    double origin[3], inverse[3], slack[3];
    double tmin;
    uint32_t parallel_axes; /* only exactly parallel ones */
    double parallel_slack[3];
};

/* Whether this machine can run the functions called wide. */
bool boxtest_has_avx2(void);

/*
 * Prepares a ray for the structure with these bounds (min xyz, max xyz). False when float tests can not be trusted: a
 * coordinate or a direction beyond 2^60 or not a number, a longest direction component below 2^-32, or bounds that lie
 * altogether within 2^-60 of zero. *ret_ray holds nothing of use then. All fill in the same, to the last bits.
 */
bool boxtest_init_avx2(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                       struct boxtest_ray *ret_ray);
bool boxtest_init(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                  struct boxtest_ray *ret_ray);

/*
 * The same, wide too, for rays that are known in float. Of origin and direction 16 bytes are read; the last four are of
 * no use.
 */
bool boxtest_init_floats(const float *origin, const float *direction, float tmin, const float bounds[6],
                         struct boxtest_ray *ret_ray);

/* Prepares any ray of finite origin and finite, non-zero direction. */
void boxtest_init_exact(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                        struct boxtest_exact *ret_ray);

/*
 * Bit s of the result: the ray meets child s at some t in [tmin, tmax]; ret_near[s] is a lower bound of where. Empty
 * slots are never met.
 */
unsigned boxtest_float(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8]);
unsigned boxtest_avx2(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8]);
unsigned boxtest_double(const struct boxtest_exact *ray, const struct portable_node *node, double tmax,
                        double ret_near[8]);

/* For parallel axes: those of the children `hits` whose boxes reach as far as the ray's position. */
unsigned boxtest_beside(const struct boxtest_ray *ray, const struct portable_node *node, unsigned hits);

/*
 * One exact box against the closed interval [tmin, tmax], in double: may report a box that the ray misses by rounding,
 * never misses one. *ret_entry is where the ray enters, within the interval; tmin when it starts inside. Empty and NaN
 * boxes are never met.
 */
bool boxtest_aabb(const double origin[3], const double direction[3], const float min[3], const float max[3],
                  double tmin, double tmax, double *ret_entry);

#endif

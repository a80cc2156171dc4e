/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest.h - tests a ray against the eight children of a node, and against one AABB. A test never misses a box that
 * the ray meets (Ize 2013).
 *
 * Child planes lie at origin + q * scale. With A = (origin - o) / d and S = scale / d the ray meets a plane at t = A +
 * q * S: one multiplication and one addition per plane. The rounding errors of that, with u = 2^-24 (float) and every
 * operation's error at most u of its result, are
 *
 *   1 / d                     u                        of A and of S
 *   origin - o, times 1 / d   2u                       of A
 *   scale / d                 u                        of S (a power of two)
 *   A -+ E, q * S, their sum  2u |A| + 2u |q S|        E is the bound itself; its own rounding is of second order
 *
 * Together they are 5u |A| + 4u |q S|, so that E = 8u (|A| + 255 |S|) + slack is a safe bound. The slack, in units of t
 * and constant over a structure, covers the errors that do not shrink with A and S:
 * - the rounding of an instance's ray, whose origin is known in double, to a float origin: |o - (float)o| / |d|;
 * - underflow of products: below 2^-118 for the ranges that boxtest_init accepts;
 * - the triangle test (triangle.h). On each axis it moves corners by less than 2^-50 of their distance from the ray's
 *   origin, along that axis and along the ray's main axis, and t by less than 2^-42 of the latter; the structure's
 *   bounds limit both. So a hit that it reports at t lies in the intervals of all boxes around it, and culling by the
 *   closest hit so far cannot change an answer. The tests of spheres and of linear swept spheres have
 *   smaller errors: they move a ray by 2^-98 of its way, and t by 2^-43 of itself.
 *
 * In the AVX2 version, with fused operations, the bound shrinks to 3u |A| + u |q S| + u |A + q S|. Let R be the
 * distance from the ray's origin to the farthest corner of the structure on that axis, over |d|. |A| and |A + q S| are
 * at most R, and |q S| is at most 2R (and some hundredths more, as planes are rounded outward), so 8u R + slack is a
 * bound for every node. It is a constant of the ray, which makes the test fast. But it can exceed the size of small
 * nodes in structures that have an outlier. Nodes with an axis on which 8u of that distance is more than about 1/64 of
 * the node use the test above.
 *
 * Unpacked nodes have float planes p, which are met at (p - o) * inverse. Its error is relative: u for each of the
 * reciprocal, the difference, the product and the sum with the slack. So reciprocals that are smaller and larger by 8u
 * give the bounds, if distances that count are not negative: tmin is not. This has no term of the node's size.
 *
 * An axis along which the ray hardly moves has no usable 1 / d. There the test compares the position, with a slack in
 * units of length that covers the small movement within the structure's bounds.
 */
#ifndef BVHD_BOXTEST_H
#define BVHD_BOXTEST_H

#include "builder/format/portable.h"
#include "builder/traverse/unpacked.h"

/*
 * Offsets in bytes, within a node, of the planes that a ray meets first and last: lo or hi of each axis, chosen by the
 * direction's sign.
 */
struct boxtest_planes {
    uint32_t near[3], far[3];
};

/* A ray in one structure's space, for float tests. The last element of the arrays of four is unused. */
struct boxtest_ray {
    _Alignas(16) float origin[4];
    float inverse[4]; /* 1 / direction; 0 for parallel axes */
    float slack[4]; /* in t; FLT_MAX for parallel axes, which makes their interval infinite */
    float common_slack[4]; /* the slack plus the error bound that is common to all nodes */
    /* nodes whose scale is below this, and not 0, are too small for the common bound; the last is 0 */
    float wide_scale[4];
    const struct boxtest_planes *planes;
    float tmin;
    uint32_t backward; /* bit a: the direction is negative along axis a */
    uint32_t parallel_axes; /* bit a: axis a is compared by position */
    float parallel_slack[3]; /* in length */
};

/* The same in double. It works for every ray and structure. */
struct boxtest_exact {
    double origin[3], inverse[3], slack[3];
    double tmin;
    uint32_t parallel_axes; /* only exactly parallel ones */
    double parallel_slack[3];
};

/* Returns whether this machine can run the functions with the suffix _avx2. */
bool boxtest_has_avx2(void);

/*
 * Prepare a ray for the structure with these bounds (min xyz, max xyz). They return false, and leave *ret_ray
 * undefined, if float tests cannot be trusted: a coordinate or a direction is beyond 2^60 or NaN, the longest direction
 * component is below 2^-32, or all bounds lie within 2^-60 of zero. All versions fill in the same values except for the
 * last bits.
 */
bool boxtest_init_avx2(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                       struct boxtest_ray *ret_ray);
bool boxtest_init(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                  struct boxtest_ray *ret_ray);

/*
 * Does the same for rays that are known in float, with AVX2 where the machine has it. It reads 16 bytes of origin and
 * of direction, and ignores the last four.
 */
bool boxtest_init_floats(const float *origin, const float *direction, float tmin, const float bounds[6],
                         struct boxtest_ray *ret_ray);

/* Prepares any ray with a finite origin and a finite, non-zero direction. */
void boxtest_init_exact(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                        struct boxtest_exact *ret_ray);

/*
 * Test the eight children of a node. Bit s of the result: the ray meets child s at some t in [tmin, tmax]; ret_near[s]
 * is a lower bound of that t. Empty slots are never met.
 */
unsigned boxtest_float(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8]);
unsigned boxtest_avx2(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8]);
unsigned boxtest_double(const struct boxtest_exact *ray, const struct portable_node *node, double tmax,
                        double ret_near[8]);

/* Removes from `hits` the children whose boxes do not reach the ray's position along the parallel axes. */
unsigned boxtest_beside(const struct boxtest_ray *ray, const struct portable_node *node, unsigned hits);

/* Does the same for an unpacked node. */
unsigned boxtest_beside_unpacked(const struct boxtest_ray *ray, const struct unpacked_node *node, unsigned hits);

/*
 * Tests one exact box against the closed interval [tmin, tmax], in double. Because of rounding it can report a box that
 * the ray misses, but it never misses one. *ret_entry is where the ray enters, within the interval; tmin if it starts
 * inside. Empty and NaN boxes are never met.
 */
bool boxtest_aabb(const double origin[3], const double direction[3], const float min[3], const float max[3],
                  double tmin, double tmax, double *ret_entry);

#endif

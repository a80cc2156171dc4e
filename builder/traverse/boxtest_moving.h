/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest_moving.h - tests a ray against the eight children of a moving node, whose boxes are those at the ray's time.
 *
 * A plane at time t lies at origin + q(t) * scale, where q(t) is interpolated between the bytes of both keys. With the
 * terms of boxtest.h, u = 2^-24 and M the largest coordinate of the structure along the axis there are these errors
 * more:
 *
 *   q(t): two products, one sum        2u of q * S     both are positive
 *   a vertex at t, which is rounded    2u M            and 2^-148, where numbers underflow
 *   1 - t, which is rounded            u / 2 of M      the weights of both keys then have not quite the sum 1
 *
 * The bound 8u (|A| + 255 |S|) of a node of its own already has room for the first one. The bound that is common to all
 * nodes, 8u R, has not: the sum with q(t), 10u R, needs another 8u R. The others are at most 4u M, times 1 / d; the
 * slack gets 8u M. That is enough for unpacked nodes, too, whose planes at t are p + (p' - p) * t in float: difference,
 * product and sum are off by at most 4u M, as |p' - p| is at most 2M.
 *
 * Boxes of motion instances hold what the rounded matrices of all times reach, so that the same terms suffice.
 */
#ifndef BVHD_BOXTEST_MOVING_H
#define BVHD_BOXTEST_MOVING_H

#include "builder/traverse/boxtest_kernels.h"
#include "builder/traverse/motion.h"

/* A ray in one structure's space, and its time. */
struct boxtest_moving {
    struct boxtest_ray still; /* with the slack of structures that move */
    struct motion_weights at;
};

struct boxtest_moving_exact {
    struct boxtest_exact still;
    struct motion_weights at;
};

/*
 * The terms of the slack: 8u of the largest coordinate, and what numbers lose that underflow. The added thousandth
 * covers the rounding of the sums.
 */
static const double moving_error = 1.001 * 0x1p-21, moving_underflow = 0x1p-146;

/* Returns by how much planes and vertices may be off along an axis of a structure with these bounds, in length. */
static inline double boxtest_moved(const float bounds[6], int axis)
{
    return moving_error * fmax(fabs((double)bounds[axis]), fabs((double)bounds[3 + axis])) + moving_underflow;
}

/* Widen the slack of a ray that has been prepared for a structure with these bounds, to that of one that moves. */
void boxtest_widen(struct boxtest_ray *ray, const float bounds[6]);
void boxtest_widen_exact(struct boxtest_exact *ray, const float bounds[6]);

/* Removes from `hits` the children whose boxes do not reach the ray's position along the parallel axes. */
unsigned boxtest_moving_beside(const struct boxtest_moving *moving, const struct portable_moving_node *node,
                               unsigned hits);

/* Works like boxtest_float(). */
unsigned boxtest_moving_float(const struct boxtest_moving *moving, const struct portable_moving_node *node, float tmax,
                              float ret_near[8]);

/* The planes of t = 1 are this far behind those of t = 0. */
enum { MOVING_END_PLANES = offsetof(struct portable_moving_node, end_lo) - offsetof(struct portable_node, lo) };

_Static_assert(offsetof(struct portable_moving_node, end_hi) - offsetof(struct portable_node, hi) == MOVING_END_PLANES,
               "both keys have their planes in one order");

/* Returns a plane at the ray's time, in steps of the grid. */
BOXTEST_INLINE float moving_plane(const uint8_t *start, unsigned slot, struct motion_weights at)
{
    return (float)start[slot] * at.start + (float)start[MOVING_END_PLANES + slot] * at.end;
}

BOXTEST_INLINE unsigned kernel_moving_float(const struct boxtest_moving *moving,
                                            const struct portable_moving_node *node, float tmax, float ret_near[8])
{
    const struct boxtest_ray *ray = &moving->still;
    const struct grid_steps grid = grid_steps_of(ray, &node->start);
    unsigned hits = 0;
    for (unsigned s = 0; s < 8; s++) {
        float near = ray->tmin, far = tmax;
        for (int axis = 0; axis < 3; axis++) {
            near = greater(moving_plane(grid.near[axis], s, moving->at) * grid.step[axis] + grid.lo[axis], near);
            far = lesser(moving_plane(grid.far[axis], s, moving->at) * grid.step[axis] + grid.hi[axis], far);
        }
        hits |= (unsigned)(near <= far && node->start.meta[s] != 0) << s;
        ret_near[s] = near;
    }
    return ray->parallel_axes ? boxtest_moving_beside(moving, node, hits) : hits;
}

BOXTEST_INLINE unsigned kernel_moving_double(const struct boxtest_moving_exact *moving,
                                             const struct portable_moving_node *node, double tmax, double ret_near[8])
{
    const struct boxtest_exact *ray = &moving->still;
    const struct portable_node *grid = &node->start;
    const double start = moving->at.start, end = moving->at.end;
    unsigned hits = 0;
    for (unsigned s = 0; s < 8; s++) {
        double near = ray->tmin, far = tmax;
        bool reaches = grid->meta[s] != 0;
        for (int axis = 0; axis < 3; axis++) {
            double offset = grid->origin[axis] - ray->origin[axis], scale = boxtest_scale(grid->exponent[axis]);
            double lo = (grid->lo[axis][s] * start + node->end_lo[axis][s] * end) * scale;
            double hi = (grid->hi[axis][s] * start + node->end_hi[axis][s] * end) * scale;
            reaches = narrow_double(ray, axis, offset, lo, hi, &near, &far) && reaches;
        }
        hits |= (unsigned)(reaches && near <= far) << s;
        ret_near[s] = near;
    }
    return hits;
}

#ifdef BOXTEST_AVX2

/* Loads the eight planes of a moving node at the ray's time, in steps of the grid. */
BOXTEST_AVX2_INLINE __m256 load_moving_planes(const struct boxtest_moving *moving,
                                              const struct portable_moving_node *node, uint32_t at)
{
    const __m256 start = load_planes(&node->start, at), end = load_planes(&node->start, at + MOVING_END_PLANES);
    return _mm256_fmadd_ps(end, _mm256_broadcast_ss(&moving->at.end),
                           _mm256_mul_ps(start, _mm256_broadcast_ss(&moving->at.start)));
}

/* Does for a moving node what kernel_avx2() does, without empty slots and with parallel axes. */
BOXTEST_AVX2_INLINE unsigned kernel_moving_avx2(const struct boxtest_moving *moving,
                                                const struct portable_moving_node *node, float tmax, float ret_near[8])
{
    const struct boxtest_ray *ray = &moving->still;
    const int exponents = (int)bytes_get32(node->start.exponent); /* the fourth lane, the inner mask, is unused */
    if (__builtin_expect(is_fine(ray, exponents), 0))
        return boxtest_moving_float(moving, node, tmax, ret_near);
    const __m256i all = _mm256_set1_epi32(exponents);
    struct spans spans;
    for (int axis = 0; axis < 3; axis++)
        span_avx2(ray, &node->start, axis, all, load_moving_planes(moving, node, ray->planes->near[axis]),
                  load_moving_planes(moving, node, ray->planes->far[axis]), &spans);
    const unsigned hits = without_empty(&node->start, meet_spans(ray, &spans, tmax, ret_near));
    return __builtin_expect(ray->parallel_axes != 0, 0) ? boxtest_moving_beside(moving, node, hits) : hits;
}

#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_filter.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/oracle/oracle_radial.h"

#define ROUNDING 1e-14 /* relative; more than the few operations between the inputs and each comparison can add */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double length(const double a[3])
{
    return sqrt(dot(a, a));
}

static void scale(double a[3], double factor)
{
    for (int axis = 0; axis < 3; axis++)
        a[axis] *= factor;
}

static void cross(const double a[3], const double b[3], double ret[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret[axis] = a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3];
}

static void make_across(const double direction[3], double ret_across[2][3])
{
    double aside[3] = {0, 0, 0};
    int least = fabs(direction[0]) < fabs(direction[1]) ? 0 : 1;
    least = fabs(direction[2]) < fabs(direction[least]) ? 2 : least;
    aside[least] = 1;
    cross(direction, aside, ret_across[0]);
    scale(ret_across[0], 1 / length(ret_across[0]));
    cross(direction, ret_across[0], ret_across[1]);
    scale(ret_across[1], 1 / length(ret_across[1]));
}

double oracle_filter_ray_init(struct oracle_filter_ray *ret_filter, const struct ray *ray)
{
    double origin[3], origin_moves[3], direction[3], direction_moves[3];
    for (int axis = 0; axis < 3; axis++) {
        struct radial at = radial_input(ray->origin[axis]), along = radial_input(ray->direction[axis]);
        origin[axis] = at.centre;
        origin_moves[axis] = at.radius;
        direction[axis] = along.centre;
        direction_moves[axis] = along.radius;
    }
    double norm = length(direction), sine = length(direction_moves) / norm;
    scale(direction, 1 / norm);
    make_across(direction, ret_filter->across);
    ret_filter->offset[0] = dot(ret_filter->across[0], origin);
    ret_filter->offset[1] = dot(ret_filter->across[1], origin);
    /* asin(sine) <= pi / 2 * sine. If the sine of the angle may be 1, the ray may meet every primitive. */
    double wobble = sine < 1 ? 1.6 * sine + ROUNDING : INFINITY;
    ret_filter->slack = wobble * length(origin) * (1 + ROUNDING) + length(origin_moves) * (1 + ROUNDING);
    return wobble;
}

void oracle_filter_begin(struct oracle_filter_block *block, double wobble)
{
    memset(block, 0, sizeof *block);
    block->wobble = wobble;
}

void oracle_filter_add(struct oracle_filter_block *block, const double centre[3], double radius)
{
    for (int axis = 0; axis < 3; axis++)
        block->centre[axis][block->count] = centre[axis];
    block->reach[block->count++] = (radius + (block->wobble + ROUNDING) * length(centre)) * (1 + 100 * ROUNDING);
}

typedef double lanes __attribute__((vector_size(32), aligned(8)));
typedef long long lane_mask __attribute__((vector_size(32)));

enum { LANES = 4, STEP = 4 };

_Static_assert(ORACLE_FILTER_BLOCK % (LANES * STEP) == 0, "a scan reads whole steps");

static inline __attribute__((always_inline)) void find_near(const struct oracle_filter_block *block,
                                                            const struct oracle_filter_ray *ray, uint32_t at,
                                                            lane_mask *ret_near)
{
    const lanes *x = (const lanes *)(block->centre[0] + at), *y = (const lanes *)(block->centre[1] + at);
    const lanes *z = (const lanes *)(block->centre[2] + at), *reach = (const lanes *)(block->reach + at);
    lanes u = *x * ray->across[0][0] + *y * ray->across[0][1] + *z * ray->across[0][2] - ray->offset[0];
    lanes v = *x * ray->across[1][0] + *y * ray->across[1][1] + *z * ray->across[1][2] - ray->offset[1];
    lanes limit = *reach + ray->slack;
    *ret_near = ~(lane_mask)(u * u + v * v > limit * limit); /* a NaN counts as near */
}

static inline __attribute__((always_inline)) uint32_t scan(const struct oracle_filter_block *block,
                                                           const struct oracle_filter_ray *ray, uint16_t *ret_near)
{
    uint32_t count = 0;
    for (uint32_t at = 0; at < block->count; at += LANES * STEP) {
        lane_mask near[STEP], any = {0};
        for (uint32_t step = 0; step < STEP; step++) {
            find_near(block, ray, at + LANES * step, &near[step]);
            any |= near[step];
        }
        if (!(any[0] | any[1] | any[2] | any[3]))
            continue;
        for (uint32_t lane = 0; lane < LANES * STEP && at + lane < block->count; lane++)
            if (near[lane / LANES][lane % LANES])
                ret_near[count++] = (uint16_t)(at + lane);
    }
    return count;
}

static uint32_t scan_plain(const struct oracle_filter_block *block, const struct oracle_filter_ray *ray,
                           uint16_t *ret_near)
{
    return scan(block, ray, ret_near);
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static uint32_t scan_avx2(const struct oracle_filter_block *block,
                                                          const struct oracle_filter_ray *ray, uint16_t *ret_near)
{
    return scan(block, ray, ret_near);
}
#endif

uint32_t oracle_filter_scan(const struct oracle_filter_block *block, const struct oracle_filter_ray *ray,
                            uint16_t ret_near[ORACLE_FILTER_BLOCK])
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2"))
        return scan_avx2(block, ray, ret_near);
#endif
    return scan_plain(block, ray, ret_near);
}

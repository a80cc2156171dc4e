/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_kind.h"

/*
 * Half of what two distances differ by at most, relative to them, if they are rounded to the same number of 32
 * significant bits: their spacing is at most 2^-31.
 */
#define EQUAL_WITHIN 0x1p-32

struct oracle_crossing oracle_crossing_make(double t, double low, double high, double shift)
{
    return (struct oracle_crossing){
        .t = t,
        .low = low - (EQUAL_WITHIN + RADIAL_ROUNDING) * fabs(low),
        .high = high + (EQUAL_WITHIN + RADIAL_ROUNDING) * fabs(high),
        .shift = shift,
    };
}

enum oracle_presence oracle_crossing_between(const struct oracle_crossing *crossing, const struct oracle_ray *ray)
{
    double low = crossing->low - crossing->shift, high = crossing->high + crossing->shift;
    if (high <= ray->tmin || low >= ray->tmax)
        return ORACLE_ABSENT;
    return low > ray->tmin && high < ray->tmax ? ORACLE_SURE : ORACLE_POSSIBLE;
}

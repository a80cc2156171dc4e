/* SPDX-License-Identifier: Apache-2.0 */
/*
 * slabs.h - a structure's extents along ten directions other than the axes. Together with the bounds they form a
 * polytope of 26 faces (a k-DOP, Klosowski 1998). The world box of a rotated instance follows from it more tightly than
 * from the bounds.
 *
 * The directions, in order: x + y, y + z, z + x, x - y, y - z, z - x, x + y - z, y + z - x, z + x - y, x + y + z. All 0
 * means unknown.
 */
#ifndef BVHD_SLABS_H
#define BVHD_SLABS_H

#include <stdbool.h>

enum { SLABS_COUNT = 10 };

struct slabs {
    float min[SLABS_COUNT], max[SLABS_COUNT];
};

/* Returns whether the slabs are known. A structure that lies entirely in the origin also counts as unknown. */
static inline bool slabs_are_known(const struct slabs *slabs)
{
    for (int i = 0; i < SLABS_COUNT; i++)
        if (slabs->min[i] != 0 || slabs->max[i] != 0)
            return true;
    return false;
}

/* Returns whether all numbers are finite and no minimum exceeds its maximum. */
static inline bool slabs_are_valid(const struct slabs *slabs)
{
    for (int i = 0; i < SLABS_COUNT; i++)
        if (!(__builtin_isfinite(slabs->min[i]) && __builtin_isfinite(slabs->max[i]) && slabs->min[i] <= slabs->max[i]))
            return false;
    return true;
}

#endif

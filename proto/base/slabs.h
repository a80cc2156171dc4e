/* SPDX-License-Identifier: Apache-2.0 */
/*
 * slabs.h - how far a structure reaches along ten directions beside the axes: with its bounds a polytope of 26 faces (a
 * k-DOP, Klosowski 1998). The world box of an instance that is turned follows from it more tightly than from the
 * bounds.
 *
 * The directions, in order: x + y, y + z, z + x, x - y, y - z, z - x, x + y - z, y + z - x, z + x - y, x + y + z. All
 * 0: not known.
 */
#ifndef BVHD_SLABS_H
#define BVHD_SLABS_H

#include <stdbool.h>

enum { SLABS_COUNT = 10 };

struct slabs {
    float min[SLABS_COUNT], max[SLABS_COUNT];
};

/* 0 is not known, and so is what lies in the origin. */
static inline bool slabs_are_known(const struct slabs *slabs)
{
    for (int i = 0; i < SLABS_COUNT; i++)
        if (slabs->min[i] != 0 || slabs->max[i] != 0)
            return true;
    return false;
}

/* Finite, and none is turned round. */
static inline bool slabs_are_valid(const struct slabs *slabs)
{
    for (int i = 0; i < SLABS_COUNT; i++)
        if (!(__builtin_isfinite(slabs->min[i]) && __builtin_isfinite(slabs->max[i]) && slabs->min[i] <= slabs->max[i]))
            return false;
    return true;
}

#endif

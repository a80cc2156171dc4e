/* SPDX-License-Identifier: Apache-2.0 */
/*
 * prefix.h - finds the range that contains a number, when ranges follow each other and each stores its first number.
 *
 * The primitives and vertices of a build are numbered across all its geometries: the numbers of geometry g start at the
 * sum of the counts of the geometries before it.
 */
#ifndef BVHD_PREFIX_H
#define BVHD_PREFIX_H

#include <stddef.h>
#include <stdint.h>

/*
 * Returns the index of the last of `count` ranges whose first number is at most `number`, or 0. `firsts` points to the
 * first number of range 0; that of each following range is `stride` bytes later. They ascend, and firsts[0] <= number.
 * A range without numbers is never found, unless it is the last one, because the next range starts at the same number.
 */
static inline uint32_t prefix_find(const uint32_t *firsts, size_t stride, uint32_t count, uint64_t number)
{
    uint32_t low = 0, high = count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        const uint32_t *first = (const void *)((const char *)firsts + middle * stride);
        if (*first <= number)
            low = middle;
        else
            high = middle;
    }
    return low;
}

#endif

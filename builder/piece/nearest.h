/* SPDX-License-Identifier: Apache-2.0 */
/*
 * nearest.h - the inner loop of clustering: finds, for each of a sequence of boxes, the neighbour with which it has the
 * smallest common box.
 *
 * The answer is a key: the half area of the union as the bits of a float, whose lowest five bits are replaced by (i ^
 * k) mod 32 for boxes i and k. A pair has the same key from both sides, and no two neighbours of one box have equal
 * keys, so the smallest key of all belongs to two boxes that choose each other.
 */
#ifndef BVHD_NEAREST_H
#define BVHD_NEAREST_H

#include <stdint.h>

enum { NEAREST_MAX = 15, NEAREST_PAD = 24 };

/*
 * The boxes as six arrays of coordinates, with magnitudes up to 2^40. The pointers lead to the first box; there is room
 * for NEAREST_PAD more boxes before it, and after the last.
 */
struct nearest_boxes {
    float *min[3], *max[3];
};

/* Fills the padding with boxes that no box has as its nearest neighbour. */
void nearest_pad(const struct nearest_boxes *boxes, uint32_t count);

/*
 * Finds the key of each box's nearest neighbour among those up to `radius` places before and after it; 1 <= radius <=
 * NEAREST_MAX, count >= 2, and the padding is filled. ret_keys has room for `count` rounded up to 8; entries after
 * `count` have no meaning. The result is the same on every machine.
 */
void nearest_find(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);

/*
 * Both implementations, which give the same keys: for every machine, and for machines with AVX2 (nearest_find_avx2
 * returns NULL elsewhere).
 */
typedef void (*nearest_finder)(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);
void nearest_find_plain(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);
nearest_finder nearest_find_avx2(void);

/* Returns the neighbour that box `index` chose. */
static inline uint32_t nearest_partner(uint32_t index, int32_t key)
{
    /* The difference mod 32, as a number in -16 .. 15. */
    uint32_t place = (index ^ (uint32_t)key) & 31;
    int32_t step = (int32_t)((place - index) << 27) >> 27;
    return index + (uint32_t)step;
}

#endif

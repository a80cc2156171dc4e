/* SPDX-License-Identifier: Apache-2.0 */
/*
 * nearest.h - the inner loop of clustering: for each of a row of boxes, the neighbour with which it makes the smallest
 * box.
 *
 * An answer is a key: the half area of the union without its lowest bits, as the bits of a float, and in their place (i
 * ^ k) mod 32. It is the same seen from both, and no two neighbours of one box have the same, so the smallest key of
 * all belongs to two that choose each other.
 */
#ifndef BVHD_NEAREST_H
#define BVHD_NEAREST_H

#include <stdint.h>

enum { NEAREST_MAX = 15, NEAREST_PAD = 24 };

/*
 * Arrays of coordinates, of magnitudes up to 2^40, with room for NEAREST_PAD boxes before the first and behind the
 * last.
 */
struct nearest_boxes {
    float *min[3], *max[3];
};

/* Fills the padding: nothing is near it. */
void nearest_pad(const struct nearest_boxes *boxes, uint32_t count);

/*
 * The key of each box's nearest among those up to `radius` places before and behind it, 1 <= radius <= NEAREST_MAX.
 * count >= 2, the padding is filled. ret_keys: room for `count` rounded up to 8; what stands behind `count` is of no
 * meaning. The same on every machine.
 */
void nearest_find(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);

/* The two ways to the same keys: for every machine, and for those with AVX2 (NULL elsewhere). */
typedef void (*nearest_finder)(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);
void nearest_find_plain(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys);
nearest_finder nearest_find_avx2(void);

/* Whom box `index` chose. */
static inline uint32_t nearest_partner(uint32_t index, int32_t key)
{
    /* The difference mod 32, as a number of -16 .. 15. */
    uint32_t place = (index ^ (uint32_t)key) & 31;
    int32_t step = (int32_t)((place - index) << 27) >> 27;
    return index + (uint32_t)step;
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * box_lanes.h - loads eight boxes from any addresses into one vector per coordinate. For functions that are compiled
 * for AVX2.
 */
#ifndef BVHD_BOX_LANES_H
#define BVHD_BOX_LANES_H

#include "proto/base/box.h"

#if defined(__x86_64__)
#include <immintrin.h>
#include <stddef.h>

#define BOX_LANES __attribute__((target("avx2")))
#define BOX_LANES_INLINE BOX_LANES static inline __attribute__((always_inline))

/* Eight boxes, one per lane, by axis. */
struct box_lanes {
    __m256 min[3], max[3];
};

/* Loads four floats of box i into the lower half, and of box i + 4 into the upper half. */
BOX_LANES_INLINE __m256 box_lanes_load_two(const struct box *const boxes[8], int i, size_t from)
{
    __m128 low = _mm_loadu_ps((const float *)(const void *)boxes[i] + from);
    return _mm256_insertf128_ps(_mm256_castps128_ps256(low),
                                _mm_loadu_ps((const float *)(const void *)boxes[i + 4] + from), 1);
}

BOX_LANES_INLINE struct box_lanes box_lanes_load(const struct box *const boxes[8])
{
    /* {x y z X} and {z X Y Z} of each box; lower-case letters are minima */
    __m256 a = box_lanes_load_two(boxes, 0, 0), b = box_lanes_load_two(boxes, 1, 0);
    __m256 c = box_lanes_load_two(boxes, 2, 0), d = box_lanes_load_two(boxes, 3, 0);
    __m256 xy = _mm256_unpacklo_ps(a, b), xy2 = _mm256_unpacklo_ps(c, d), zx = _mm256_unpackhi_ps(a, b),
           zx2 = _mm256_unpackhi_ps(c, d);
    __m256 e = box_lanes_load_two(boxes, 0, 2), f = box_lanes_load_two(boxes, 1, 2);
    __m256 g = box_lanes_load_two(boxes, 2, 2), h = box_lanes_load_two(boxes, 3, 2);
    __m256 yz = _mm256_unpackhi_ps(e, f), yz2 = _mm256_unpackhi_ps(g, h);
    return (struct box_lanes){
        {_mm256_shuffle_ps(xy, xy2, 0x44), _mm256_shuffle_ps(xy, xy2, 0xee), _mm256_shuffle_ps(zx, zx2, 0x44)},
        {_mm256_shuffle_ps(zx, zx2, 0xee), _mm256_shuffle_ps(yz, yz2, 0x44), _mm256_shuffle_ps(yz, yz2, 0xee)},
    };
}

#endif

#endif

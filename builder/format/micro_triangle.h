/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micro_triangle.h - the micro-triangles of opacity micromaps (VK_EXT_opacity_micromap): their order, and how their
 * states are stored.
 *
 * Level L cuts each edge of a triangle into 2^L parts and the triangle into 4^L equal micro-triangles, which a
 * space-filling curve numbers. The curve is recursive: a triangle with corners a, b, c in this order (at the top the
 * ones with barycentric weights w, u, v) has four children, with p, q, r the middles of ab, bc and ca:
 *
 *     0: a p r    1: r q p    2: p b q    3: q r c
 *
 * The states of a triangle are one bit (2-state) or two bits (4-state) for each micro-triangle, in this order, from the
 * lowest bits of each byte upwards. They begin with a byte, and level 0 fills one byte in part.
 *
 * Levels are at most MICRO_LEVEL_MAX; callers check that. The functions are pure.
 */
#ifndef BVHD_MICRO_TRIANGLE_H
#define BVHD_MICRO_TRIANGLE_H

#include <stdbool.h>
#include <stdint.h>

enum { MICRO_LEVEL_MAX = 12, MICRO_COUNT_MAX = 1 << 2 * MICRO_LEVEL_MAX };

/* VkOpacityMicromapFormatEXT. Each value is also the number of bits of a state. */
enum micro_format { MICRO_2_STATE = 1, MICRO_4_STATE = 2 };

/*
 * The states of a micro-triangle; 2-state micromaps have the first two only. VkOpacityMicromapSpecialIndexEXT gives a
 * whole triangle the state s by the index ~s: -1 to -4.
 */
enum micro_state { MICRO_TRANSPARENT, MICRO_OPAQUE, MICRO_UNKNOWN_TRANSPARENT, MICRO_UNKNOWN_OPAQUE, MICRO_STATES };

/* Returns the number of micro-triangles, 4^level. */
static inline uint32_t micro_triangle_count(unsigned level)
{
    return UINT32_C(1) << 2 * level;
}

/* Returns how many bytes the states of a triangle take. */
static inline uint32_t micro_triangle_bytes(enum micro_format format, unsigned level)
{
    return (micro_triangle_count(level) * (uint32_t)format + 7) / 8;
}

/* Returns the state of micro-triangle `index`, which is below micro_triangle_count(level) of those bytes. */
static inline enum micro_state micro_triangle_state(const unsigned char *states, enum micro_format format,
                                                    uint32_t index)
{
    uint32_t bit = index * (uint32_t)format;
    return (enum micro_state)(states[bit / 8] >> bit % 8 & ((1u << format) - 1));
}

/* Returns x with its bits, of which there are at most 16, at the even places. */
static inline uint32_t micro_triangle_spread(uint32_t x)
{
    x = (x | x << 8) & 0x00ff00ff;
    x = (x | x << 4) & 0x0f0f0f0f;
    x = (x | x << 2) & 0x33333333;
    return (x | x << 1) & 0x55555555;
}

/*
 * Returns the index of the micro-triangle that contains the point with barycentric weights u and v of the second and
 * third corner. Any floats are allowed: weights below 0 and NaNs count as 0, weights above 1 as 1, and a point beyond
 * the third edge belongs to the micro-triangle of that edge with the same v. A point on an edge between micro-triangles
 * belongs to that with larger u or v; the sum that decides about edges of constant u + v is rounded to a float.
 *
 * It is the function of Vulkan's specification. With i, j, k the numbers, in binary, of the strips between lines of
 * constant u, v and w that the point lies in, and i + j + k = 2^L - 1, or one less in a micro-triangle that stands on
 * its corner: the two bits that the curve adds at each level depend on the bits of i, j, k at this level, and on how
 * often the levels above have swapped the directions, which is an exclusive or over these levels.
 */
static inline uint32_t micro_triangle_index(float u, float v, unsigned level)
{
    const uint32_t parts = UINT32_C(1) << level, last = parts - 1;
    const float across_u = (u > 0 ? u < 1 ? u : 1 : 0) * (float)parts;
    const float across_v = (v > 0 ? v < 1 ? v : 1 : 0) * (float)parts;
    uint32_t i = (uint32_t)across_u, j = (uint32_t)across_v;
    const float rest = (across_u - (float)i) + (across_v - (float)j);
    i = i < last ? i : last;
    j = j < last ? j : last;
    const bool is_inner = i + j < last;
    i = i < last - j ? i : last - j;
    const uint32_t k = last - i - j - (is_inner && rest >= 1);
    const uint32_t is_middle = ~(i ^ k) & last;
    const uint32_t swaps = (i ^ j) & is_middle;
    uint32_t swapped = swaps ^ swaps >> 1;
    swapped ^= swapped >> 2;
    swapped ^= swapped >> 4;
    swapped ^= swapped >> 8;
    const uint32_t high = ((swapped ^ i) & ~is_middle & last) | swaps;
    return micro_triangle_spread(is_middle) | micro_triangle_spread(high) << 1;
}

/*
 * Computes the corners of micro-triangle `index`, in the curve's order: how many 2^level-ths of u and of v each has.
 * Returns true if it is upright, with corners (i, j), (i + 1, j), (i, j + 1) in some order, and false if it stands on
 * its corner, with (i + 1, j + 1), (i, j + 1), (i + 1, j).
 */
bool micro_triangle_corners(uint32_t index, unsigned level, uint32_t ret_corners[3][2]);

#endif

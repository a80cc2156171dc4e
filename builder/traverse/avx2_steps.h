/* SPDX-License-Identifier: Apache-2.0 */
/*
 * avx2_steps.h - the steps of walks with AVX2 over nodes, portable and unpacked ones: the test of a node, and the stack
 * of children that wait. They are inlined. Internal.
 *
 * A child on the stack is a node, or a leaf: the two highest bits are 3, or the number of its records less 1; below
 * them is the node, or the first record. So of children at equal distances leaves come first.
 */
#ifndef BVHD_AVX2_STEPS_H
#define BVHD_AVX2_STEPS_H

#include "builder/traverse/avx2_walk.h"

#ifdef BOXTEST_AVX2

BOXTEST_AVX2_INLINE __m256i load_bytes(const uint8_t from[8])
{
    return _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)from));
}

/* Returns the node in the slot of an inner child. */
BOXTEST_AVX2_INLINE uint32_t inner_child(const struct portable_node *node, unsigned slot)
{
    return node->first_child + (uint32_t)__builtin_popcount(_bzhi_u32(node->inner_mask, slot));
}

/* Prefetches a child that is pushed on the stack. */
BOXTEST_AVX2_INLINE void prefetch_child(const struct avx2_walk *walk, uintptr_t record_rows, uint32_t child)
{
    enum { ROW = 16 };
    const uintptr_t node_rows = (walk->unpacked ? sizeof *walk->unpacked : sizeof *walk->view->nodes) / ROW;
    const uintptr_t index = child & CHILD_INDEX_MASK;
    const bool is_node = child >= (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
    const void *nodes = walk->unpacked ? (const void *)walk->unpacked : walk->view->nodes;
    const uintptr_t rows = (uintptr_t)(is_node ? nodes : walk->view->records);
    const uintptr_t address = rows + ROW * (index * (is_node ? node_rows : record_rows));
    __builtin_prefetch((const void *)address);
    __builtin_prefetch((const void *)(address + 64)); /* a node can end in another cache line than it begins in */
}

/* Returns the children that the ray meets; empty slots can be among them. */
BOXTEST_AVX2_INLINE unsigned test_boxes(const struct avx2_walk *walk, const struct portable_node *node,
                                        float ret_near[8])
{
    unsigned hits = kernel_avx2_slots(&walk->boxes, node, walk->state->tmax_above, ret_near);
    return __builtin_expect(walk->boxes.parallel_axes != 0, 0) ? boxtest_beside(&walk->boxes, node, hits) : hits;
}

/* Does the same for an unpacked node, of which empty slots are never met. */
BOXTEST_AVX2_INLINE unsigned test_unpacked(const struct avx2_walk *walk, const struct unpacked_node *node,
                                           float ret_near[8])
{
    unsigned hits = kernel_unpacked(&walk->boxes, &walk->scales, node, walk->state->tmax_above, ret_near);
    return __builtin_expect(walk->boxes.parallel_axes != 0, 0) ? boxtest_beside_unpacked(&walk->boxes, node, hits)
                                                               : hits;
}

/* Pushes the inner children in the slots `inner`, with the farthest along the ray's octant on top. */
BOXTEST_AVX2_INLINE uint32_t *push_inner(const struct portable_node *node, unsigned inner, unsigned backward,
                                         uint32_t *top)
{
    /* Keeps the compiler from precomputing values of the octant, which does not pay for a ray that meets few nodes. */
    __asm__("" : "+r"(backward));
    for (unsigned i = 0; i < 8; i++)
        if (inner >> (i ^ backward) & 1)
            *top++ = inner_child(node, i ^ backward);
    return top;
}

BOXTEST_AVX2_INLINE uint32_t *push_unpacked_inner(const struct unpacked_node *nodes, const struct unpacked_node *node,
                                                  unsigned inner, unsigned backward, uint32_t *top)
{
    __asm__("" : "+r"(backward));
    for (unsigned i = 0; i < 8; i++)
        if (inner >> (i ^ backward) & 1) {
            const uint32_t index = node->children[i ^ backward] & CHILD_INDEX_MASK;
            for (unsigned k = 0; k < 4; k++)
                __builtin_prefetch((const char *)&nodes[index] + 64 * k);
            *top++ = index;
        }
    return top;
}

/* Returns the slots of an unpacked node's inner children. */
BOXTEST_AVX2_INLINE unsigned inner_slots(const struct unpacked_node *node)
{
    __m256 children = _mm256_loadu_ps((const float *)(const void *)node->children);
    __m256 next = _mm256_castsi256_ps(_mm256_slli_epi32(_mm256_castps_si256(children), 1));
    return (unsigned)_mm256_movemask_ps(_mm256_and_ps(children, next));
}

/* Returns the stack entry of the child in a slot. */
BOXTEST_AVX2_INLINE uint32_t child_in_slot(const struct portable_node *node, unsigned slot)
{
    if (node->inner_mask >> slot & 1)
        return inner_child(node, slot) | (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
    /* The unary counts 1, 3, 7 become 0, 1, 2. */
    uint32_t meta = node->meta[slot], kind = (meta >> 6) - (meta >> 7);
    return kind << CHILD_KIND_SHIFT | (node->first_record + (meta & 31));
}

/*
 * Packs a child and its distance into one number that orders like the distance, unless the distance is negative: then
 * the order differs.
 */
static inline uint64_t to_key(uint32_t near, uint32_t child)
{
    return (uint64_t)near << 32 | child;
}

BOXTEST_AVX2_INLINE float near_of(uint64_t key)
{
    return _mm_cvtss_f32(_mm_castsi128_ps(_mm_cvtsi32_si128((int)(key >> 32))));
}

/* Sorts a child into those that the current node has pushed. Returns the nearer one of it and the nearest so far. */
BOXTEST_AVX2_INLINE uint64_t push_later(const struct avx2_walk *walk, uintptr_t record_rows, uint64_t nearest,
                                        uint64_t other, const uint64_t *base, uint64_t **top)
{
    uint64_t later = nearest > other ? nearest : other, *at = (*top)++;
    for (; at > base && at[-1] < later; at--)
        at[0] = at[-1];
    *at = later;
    prefetch_child(walk, record_rows, (uint32_t)later);
    return nearest > other ? other : nearest;
}

/* Pushes all `hits` but the nearest, with the nearest of them on top, and returns the nearest. */
BOXTEST_AVX2_INLINE uint64_t push_all_but_nearest(const struct avx2_walk *walk, uintptr_t record_rows,
                                                  const uint32_t near[8], const struct portable_node *node,
                                                  unsigned hits, uint64_t **top)
{
    unsigned slot = (unsigned)__builtin_ctz(hits);
    uint64_t nearest = to_key(near[slot], child_in_slot(node, slot)), *base = *top;
    while (hits &= hits - 1) {
        slot = (unsigned)__builtin_ctz(hits);
        nearest = push_later(walk, record_rows, nearest, to_key(near[slot], child_in_slot(node, slot)), base, top);
    }
    return nearest;
}

BOXTEST_AVX2_INLINE uint64_t push_unpacked(const struct avx2_walk *walk, uintptr_t record_rows, const uint32_t near[8],
                                           const struct unpacked_node *node, unsigned hits, uint64_t **top)
{
    unsigned slot = (unsigned)__builtin_ctz(hits);
    uint64_t nearest = to_key(near[slot], node->children[slot]), *base = *top;
    while (hits &= hits - 1) {
        slot = (unsigned)__builtin_ctz(hits);
        nearest = push_later(walk, record_rows, nearest, to_key(near[slot], node->children[slot]), base, top);
    }
    return nearest;
}

/* Takes the next child that is near enough from the stack. Returns false if there is none. */
BOXTEST_AVX2_INLINE bool pop_child(const struct avx2_walk *walk, const uint64_t *stack, uint64_t **top,
                                   uint32_t *ret_child)
{
    while (*top > stack)
        if (near_of(*--*top) <= walk->state->tmax_above) {
            *ret_child = (uint32_t) * *top;
            return true;
        }
    return false;
}

#endif
#endif

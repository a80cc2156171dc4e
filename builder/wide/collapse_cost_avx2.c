/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse_cost_avx2.c - collapse_cost_of for machines with AVX2: the same sums and minima, with eight costs in a
 * register. Here branches on leaves pay, because a processor that predicts right need not wait for the row before.
 */
#include <math.h>

#include "builder/wide/collapse_cost.h"

#if defined(__x86_64__)
#include <immintrin.h>

#define WIDE __attribute__((target("avx2")))
#define WIDE_INLINE WIDE static inline __attribute__((always_inline))

WIDE_INLINE __m128 sides_of(const struct box *box, __m128 scale)
{
    __m128 end = _mm_loadu_ps(box->min + 2), max = _mm_permute_ps(end, _MM_SHUFFLE(3, 3, 2, 1));
    return _mm_sub_ps(_mm_mul_ps(max, scale), _mm_mul_ps(_mm_loadu_ps(box->min), scale));
}

/* Returns the measures of two siblings, over all motion keys, in the two lowest lanes. */
WIDE_INLINE __m128 measure_pair(const struct collapse_table *table, uint32_t first)
{
    const __m128 scale = _mm_set1_ps(table->scale);
    __m128 sum = _mm_setzero_ps();
    for (uint32_t key = 0; key < table->ir->key_count; key++) {
        const struct box *boxes = &table->ir->boxes[key][first];
        __m128 left = sides_of(&boxes[0], scale), right = sides_of(&boxes[1], scale);
        __m128 x = _mm_unpacklo_ps(left, right), y = _mm_movehl_ps(x, x), z = _mm_unpackhi_ps(left, right), own;
        if (table->lengths)
            own = _mm_add_ps(_mm_add_ps(x, y), z);
        else
            own = _mm_add_ps(_mm_add_ps(_mm_mul_ps(x, y), _mm_mul_ps(y, z)), _mm_mul_ps(z, x));
        sum = key == 0 ? own : _mm_add_ps(sum, own);
    }
    return _mm_mul_ps(sum, _mm_set1_ps(table->inverse));
}

/* Broadcasts one lane of a half that is the same in both halves. */
#define LANE(halves, i) _mm256_permute_ps(halves, _MM_SHUFFLE(i, i, i, i))

/* Stores the costs; the last lane is the number. */
WIDE_INLINE void store_cost(__m256 costs, __m256i number, struct collapse_cost *ret)
{
    _mm256_storeu_ps(ret->as, _mm256_blend_ps(costs, _mm256_castsi256_ps(number), 0x80));
}

/* Completes a node's row, and returns its costs. */
WIDE_INLINE __m256 worth(const struct collapse_table *table, struct collapse_cost *own, __m256 area, uint32_t refs)
{
    __m256 forest = _mm256_loadu_ps(own->as);
    __m256 one = _mm256_add_ps(_mm256_add_ps(area, _mm256_set1_ps(table->node_cost)),
                               LANE(_mm256_permute2f128_ps(forest, forest, 0x11), 2));
    __m256i leaf_refs = _mm256_setzero_si256();
    if (refs <= table->leaf_max) {
        __m256i count = _mm256_set1_epi32((int32_t)refs);
        __m256 leaf = _mm256_mul_ps(_mm256_mul_ps(area, _mm256_cvtepi32_ps(count)), _mm256_set1_ps(table->leaf_cost));
        leaf_refs = _mm256_and_si256(_mm256_castps_si256(_mm256_cmp_ps(leaf, one, _CMP_LE_OQ)), count);
        one = _mm256_min_ps(leaf, one);
    }
    __m256 shifted = _mm256_permutevar8x32_ps(forest, _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6));
    __m256 costs = _mm256_min_ps(one, _mm256_blend_ps(shifted, one, 1));
    store_cost(costs, leaf_refs, own);
    return costs;
}

/* The costs of the right side for the rest of a budget, when the left side has taken `taken` trees more than one. */
#define REST(right, taken)                                                                                             \
    _mm256_blend_ps(_mm256_permutevar8x32_ps(right, _mm256_setr_epi32(0 - taken, 1 - taken, 2 - taken, 3 - taken,      \
                                                                      4 - taken, 5 - taken, 6 - taken, 7 - taken)),    \
                    infinity, (1 << taken) - 1)

WIDE_INLINE __m256 combine(__m256 left, __m256 right)
{
    const __m256 infinity = _mm256_set1_ps(INFINITY);
    const __m256 low = _mm256_permute2f128_ps(left, left, 0x00), high = _mm256_permute2f128_ps(left, left, 0x11);
    __m256 a = _mm256_add_ps(LANE(low, 0), right), b = _mm256_add_ps(LANE(low, 1), REST(right, 1));
    __m256 c = _mm256_add_ps(LANE(low, 2), REST(right, 2)), d = _mm256_add_ps(LANE(low, 3), REST(right, 3));
    __m256 e = _mm256_add_ps(LANE(high, 0), REST(right, 4)), f = _mm256_add_ps(LANE(high, 1), REST(right, 5));
    __m256 g = _mm256_add_ps(LANE(high, 2), REST(right, 6));
    __m256 ab = _mm256_min_ps(a, b), cd = _mm256_min_ps(c, d), ef = _mm256_min_ps(e, f);
    return _mm256_min_ps(_mm256_min_ps(ab, cd), _mm256_min_ps(ef, g));
}

/* Returns the costs of an inner node whose row has been made. */
WIDE_INLINE __m256 inner_of(const struct collapse_table *table, const struct ir_node *node, __m128 measure,
                            uint32_t *refs)
{
    struct collapse_cost *own = &table->costs[node->first / 2];
    *refs = own->leaf_refs;
    return worth(table, own, _mm256_broadcastss_ps(measure), *refs);
}

/* Returns the costs of a leaf: it is one tree, at the same cost for any budget. */
WIDE_INLINE __m256 leaf_of(const struct collapse_table *table, const struct ir_node *node, __m128 measure,
                           uint32_t *refs)
{
    *refs = node->count;
    __m128 cost =
        _mm_mul_ss(_mm_mul_ss(measure, _mm_cvtsi32_ss(measure, (int32_t)node->count)), _mm_set_ss(table->leaf_cost));
    return _mm256_broadcastss_ps(cost);
}

/* A leaf takes one tree and leaves the rest of the budget to its sibling, which is never worse. */
WIDE static void cost_of(const struct collapse_table *table, uint32_t row)
{
    const struct ir_node *pair = &table->ir->nodes[2 * row + 1];
    __m128 measures = measure_pair(table, 2 * row + 1), second = _mm_movehdup_ps(measures);
    uint32_t refs[2];
    __m256 forest;
    if (pair[0].count) {
        __m256 left = leaf_of(table, &pair[0], measures, &refs[0]);
        if (pair[1].count)
            forest = _mm256_add_ps(left, leaf_of(table, &pair[1], second, &refs[1]));
        else
            forest = _mm256_add_ps(left, inner_of(table, &pair[1], second, &refs[1]));
    } else {
        __m256 left = inner_of(table, &pair[0], measures, &refs[0]);
        if (pair[1].count)
            forest = _mm256_add_ps(left, leaf_of(table, &pair[1], second, &refs[1]));
        else
            forest = combine(left, inner_of(table, &pair[1], second, &refs[1]));
    }
    store_cost(forest, _mm256_set1_epi32((int32_t)(refs[0] + refs[1])), &table->costs[row]);
    table->counts[row] = refs[0] + refs[1];
}

collapse_cost_function *collapse_cost_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? cost_of : collapse_cost_of;
}

#else

collapse_cost_function *collapse_cost_avx2(void)
{
    return collapse_cost_of;
}

#endif

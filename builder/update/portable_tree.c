/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/portable_tree.h"

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#include <emmintrin.h>
#endif

/* Leaves are written in order and without gaps, from the first record on, and so are the records of the next node. */
static bool records_are_in_order(const struct portable_view *view, uint32_t node, unsigned records)
{
    const struct portable_header *header = view->header;
    const uint32_t first = portable_node_at(view, node)->first_record,
                   next = node + 1 < header->node_count ? portable_node_at(view, node + 1)->first_record
                                                        : header->record_count;
    return (node > 0 || first == 0) && first <= header->record_count && records <= header->record_count - first &&
           first + records == next;
}

static bool children_are_inside(const struct portable_node *own, uint32_t node, uint32_t end, unsigned inner)
{
    unsigned count = (unsigned)__builtin_popcount(inner);
    return count == 0 || (own->first_child > node && own->first_child <= end && count <= end - own->first_child);
}

bool portable_tree_read(const struct portable_view *view, uint32_t node, uint32_t end, struct portable_shape *ret)
{
    static const uint8_t counts[8] = {[1] = 1, [3] = 2, [7] = 3};
    const struct portable_node *own = portable_node_at(view, node);
    const unsigned inner = own->inner_mask;
    unsigned occupied = 0, leaves = 0, records = 0;
    for (unsigned slot = 0; slot < 8; slot++) {
        const unsigned meta = own->meta[slot], count = inner >> slot & 1 ? 0 : counts[meta >> 5];
        occupied |= (unsigned)(meta != 0) << slot;
        leaves |= (unsigned)(count != 0) << slot;
        ret->counts[slot] = (uint8_t)count;
        records += count;
    }
    ret->occupied = occupied;
    ret->inner = inner;
    ret->records = records;
    return occupied != 0 && occupied == (inner | leaves) && children_are_inside(own, node, end, inner) &&
           records_are_in_order(view, node, records);
}

/* Returns where the descendants of the next sibling begin, or `end` if no sibling from `child` on has any. */
static uint32_t descendants_from(const struct portable_view *view, uint32_t child, uint32_t siblings_end, uint32_t end)
{
    for (; child < siblings_end; child++)
        if (portable_node_at(view, child)->inner_mask != 0)
            return portable_node_at(view, child)->first_child;
    return end;
}

/* Cuts the subtree of `node`, whose descendants are [begin, end). */
static bool cut(const struct portable_view *view, struct subtrees *subtrees, uint32_t node, uint32_t begin,
                uint32_t end, int level)
{
    const struct portable_node *own = portable_node_at(view, node);
    const uint32_t count = (uint32_t)__builtin_popcount(own->inner_mask);
    subtrees_add_top(subtrees, node);
    if (count == 0)
        return begin == end;
    if (own->first_child != begin || begin > end || end - begin < count || level > PORTABLE_MAX_DEPTH)
        return false;
    if (end - begin <= subtrees->limit) {
        subtrees_add_range(subtrees, begin, end);
        return true;
    }
    uint32_t next = begin + count;
    for (uint32_t child = begin; child < begin + count; child++) {
        bool has_children = portable_node_at(view, child)->inner_mask != 0;
        uint32_t last = has_children ? descendants_from(view, child + 1, begin + count, end) : next;
        if (last > end || !cut(view, subtrees, child, next, last, level + 1))
            return false;
        next = last;
    }
    return next == end;
}

bool portable_tree_cut(const struct portable_view *view, struct subtrees *subtrees)
{
    return cut(view, subtrees, 0, 1, view->header->node_count, 1);
}

static double step_of(uint8_t exponent)
{
    uint64_t bits = exponent == 0 ? 0 : (uint64_t)(exponent + 1023 - 127) << 52;
    double step;
    memcpy(&step, &bits, sizeof step);
    return step;
}

/* The bytes of a node's boxes at one key, by axis and slot. */
struct node_bytes {
    const uint8_t (*lo)[8], (*hi)[8];
};

static inline struct node_bytes start_bytes(const struct portable_node *node)
{
    return (struct node_bytes){node->lo, node->hi};
}

static inline struct node_bytes end_bytes(const struct portable_moving_node *node)
{
    return (struct node_bytes){node->end_lo, node->end_hi};
}

/* The sums over all slots of the areas of two sides, in steps: of inner children, and of each record in leaves. */
struct side_sums {
    int32_t inner, leaves;
};

/* The sums are of whole numbers, so that they are exact, in any order. Both versions give the same. */
#if defined(__SSE2__) && !defined(BVHD_SCALAR)

static inline __m128i lengths_of(const struct node_bytes *bytes, int axis)
{
    const __m128i zero = _mm_setzero_si128();
    const __m128i lo = _mm_loadl_epi64((const __m128i *)(const void *)bytes->lo[axis]),
                  hi = _mm_loadl_epi64((const __m128i *)(const void *)bytes->hi[axis]);
    return _mm_sub_epi16(_mm_unpacklo_epi8(hi, zero), _mm_unpacklo_epi8(lo, zero));
}

static inline int32_t sum_of(__m128i four)
{
    four = _mm_add_epi32(four, _mm_shuffle_epi32(four, _MM_SHUFFLE(1, 0, 3, 2)));
    return _mm_cvtsi128_si32(_mm_add_epi32(four, _mm_shuffle_epi32(four, _MM_SHUFFLE(2, 3, 0, 1))));
}

static inline struct side_sums sum_sides(const struct node_bytes *bytes, const struct portable_shape *shape, int axis,
                                         int other)
{
    const __m128i bits = _mm_setr_epi16(1, 2, 4, 8, 16, 32, 64, 128);
    const __m128i is_inner = _mm_cmpeq_epi16(_mm_and_si128(_mm_set1_epi16((short)shape->inner), bits), bits);
    const __m128i counts =
        _mm_unpacklo_epi8(_mm_loadl_epi64((const __m128i *)(const void *)shape->counts), _mm_setzero_si128());
    const __m128i first = lengths_of(bytes, axis), second = lengths_of(bytes, other);
    return (struct side_sums){sum_of(_mm_madd_epi16(_mm_and_si128(first, is_inner), second)),
                              sum_of(_mm_madd_epi16(_mm_mullo_epi16(first, counts), second))};
}

#else

static inline struct side_sums sum_sides(const struct node_bytes *bytes, const struct portable_shape *shape, int axis,
                                         int other)
{
    struct side_sums sums = {0, 0};
    for (int slot = 0; slot < 8; slot++) {
        const int32_t area =
            (bytes->hi[axis][slot] - bytes->lo[axis][slot]) * (bytes->hi[other][slot] - bytes->lo[other][slot]);
        sums.inner += area * (int32_t)(shape->inner >> slot & 1);
        sums.leaves += area * shape->counts[slot];
    }
    return sums;
}

#endif

double portable_tree_node_cost(const struct portable_node *node, bool moves, const struct portable_shape *shape,
                               double leaf_cost)
{
    const struct node_bytes start = start_bytes(node);
    double cost = 0;
    for (int axis = 0; axis < 3; axis++) {
        const int other = axis == 2 ? 0 : axis + 1;
        struct side_sums sums = sum_sides(&start, shape, axis, other);
        if (moves) {
            const struct node_bytes end = end_bytes((const struct portable_moving_node *)(const void *)node);
            const struct side_sums more = sum_sides(&end, shape, axis, other);
            sums = (struct side_sums){sums.inner + more.inner, sums.leaves + more.leaves};
        }
        cost +=
            (sums.inner + leaf_cost * sums.leaves) * (step_of(node->exponent[axis]) * step_of(node->exponent[other]));
    }
    return cost;
}

/* Returns the length of the box round all children, in steps; empty slots do not make it longer. */
static int32_t length_of_all(const struct node_bytes *bytes, int axis)
{
    int32_t low = 255, high = 0;
    for (int slot = 0; slot < 8; slot++) {
        low = bytes->lo[axis][slot] < low ? bytes->lo[axis][slot] : low;
        high = bytes->hi[axis][slot] > high ? bytes->hi[axis][slot] : high;
    }
    return high - low;
}

double portable_tree_moving_area(const struct portable_moving_node *node)
{
    const struct node_bytes keys[2] = {start_bytes(&node->start), end_bytes(node)};
    double area = 0;
    for (int key = 0; key < 2; key++)
        for (int axis = 0; axis < 3; axis++) {
            const int other = axis == 2 ? 0 : axis + 1;
            area += length_of_all(&keys[key], axis) * length_of_all(&keys[key], other) *
                    (step_of(node->start.exponent[axis]) * step_of(node->start.exponent[other]));
        }
    return area;
}

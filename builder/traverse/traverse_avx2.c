/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_avx2.c - traces rays through triangles, eight boxes at a time. Nearly all rays take this path, so it is one
 * piece of code. It gives the same results as the loops of traverse_loops.c with leaves of triangles, with fewer
 * instructions and fewer unpredictable branches.
 *
 * A child on the stack is a node, or a leaf: the two highest bits are 3, or the number of its records less 1; below
 * them is the node, or the first record. So of children at equal distances leaves come first.
 */
#include "builder/traverse/boxtest_setup.h"
#include "builder/traverse/traverse_walk.h"
#include "builder/traverse/triangle_avx2.h"

#ifdef BOXTEST_AVX2

/* Each level leaves at most 7 siblings on the stack; the last one can add all 8. */
enum { STACK_SIZE = 7 * PORTABLE_MAX_DEPTH + 1 };

enum { CHILD_KIND_SHIFT = 30, CHILD_INDEX_MASK = (1 << CHILD_KIND_SHIFT) - 1, CHILD_NODE = 3 };

_Static_assert(PORTABLE_LEAF_MAX <= 3 && PORTABLE_MAX_ROWS - 1 <= (int)CHILD_INDEX_MASK, "a child fits into 32 bits");

/* The data of one ray through triangles. */
struct avx2_walk {
    struct traverse_state *state;
    const struct portable_view *view;
    struct boxtest_ray boxes;
    struct triangle_avx2_ray triangles;
};

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
BOXTEST_AVX2_INLINE void prefetch_child(const struct portable_view *view, uintptr_t record_rows, uint32_t child)
{
    enum { ROW = 16 };
    const uintptr_t node_rows = sizeof *view->nodes / ROW, index = child & CHILD_INDEX_MASK;
    const bool is_node = child >= (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
    const uintptr_t rows = (uintptr_t)(is_node ? (const void *)view->nodes : view->records);
    const uintptr_t address = rows + ROW * (index * (is_node ? node_rows : record_rows));
    __builtin_prefetch((const void *)address);
    __builtin_prefetch((const void *)(address + 64)); /* a node can end in another cache line than it begins in */
}

/*
 * Tests the records whose bits are set, counted from `first`. Returns false if the ray is finished. It is compiled once
 * for each value of is_indexed.
 */
BOXTEST_AVX2_INLINE bool meet_records(const struct avx2_walk *walk, uint32_t first, uint32_t bits, bool is_indexed)
{
    const struct portable_view *view = walk->view;
    struct traverse_state *state = walk->state;
    for (; bits != 0; bits &= bits - 1) {
        uint32_t record = first + (uint32_t)__builtin_ctz(bits);
        const float *corners[3];
        uint32_t id = is_indexed ? traverse_corners_indexed(view, record, corners)
                                 : traverse_corners_stored(view, record, corners);
        struct triangle_hit hit;
        state->counters.triangles++;
        if (triangle_avx2_intersect(&walk->triangles, &state->triangle_ray, corners, &hit) &&
            hit.t > state->ray->tmin && hit.t <= state->tmax) {
            traverse_leaf_hit(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, &hit);
            if (state->is_done)
                return false;
        }
    }
    return true;
}

BOXTEST_AVX2_INLINE bool meet(const struct avx2_walk *walk, uint32_t first, uint32_t bits, bool is_indexed)
{
    return is_indexed ? meet_records(walk, first, bits, true) : meet_records(walk, first, bits, false);
}

/* Returns the children that the ray meets; empty slots can be among them. */
BOXTEST_AVX2_INLINE unsigned test_boxes(const struct avx2_walk *walk, const struct portable_node *node,
                                        float ret_near[8])
{
    unsigned hits = kernel_avx2_slots(&walk->boxes, node, walk->state->tmax_above, ret_near);
    return __builtin_expect(walk->boxes.parallel_axes != 0, 0) ? boxtest_beside(&walk->boxes, node, hits) : hits;
}

/*
 * Goes slot by slot, not by the bits that are set: the processor can then fetch a predicted leaf before its box test is
 * decided. Returns false if the ray is finished.
 */
BOXTEST_AVX2_INLINE bool meet_leaves(const struct avx2_walk *walk, const struct portable_node *node, unsigned leaves,
                                     bool is_indexed)
{
    for (unsigned slot = 0; slot < 8; slot++) {
        const uint32_t meta = node->meta[slot]; /* the count is in unary: that many bits are set */
        if (leaves >> slot & 1 && !meet(walk, node->first_record + (meta & 31), meta >> 5, is_indexed))
            return false;
    }
    return true;
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

/*
 * Finds any hit. Leaves come first, then the inner children farthest along the ray's octant: most rays of this kind
 * start on a surface, which is near, and search for another one.
 */
BOXTEST_AVX2 static void find_any(struct avx2_walk *walk)
{
    const struct portable_node *nodes = walk->view->nodes;
    const bool is_indexed = walk->view->header->content == PORTABLE_INDEXED_TRIANGLES;
    uint32_t stack[STACK_SIZE], *top = stack;
    uint64_t visited = 0;
    float near[8];
    *top++ = 0;
    while (top > stack) {
        const struct portable_node *node = &nodes[*--top];
        unsigned hits = test_boxes(walk, node, near), leaves = hits & ~(unsigned)node->inner_mask;
        visited++;
        if (leaves != 0 && !meet_leaves(walk, node, leaves, is_indexed))
            break;
        const unsigned inner = hits & node->inner_mask;
        if (inner != 0)
            top = push_inner(node, inner, walk->boxes.backward, top);
    }
    walk->state->counters.nodes += visited;
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

/* Pushes all `hits` but the nearest, with the nearest of them on top, and returns the nearest. */
BOXTEST_AVX2_INLINE uint64_t push_all_but_nearest(const struct avx2_walk *walk, uintptr_t record_rows,
                                                  const uint32_t near[8], const struct portable_node *node,
                                                  unsigned hits, uint64_t **top)
{
    unsigned slot = (unsigned)__builtin_ctz(hits);
    uint64_t nearest = to_key(near[slot], child_in_slot(node, slot)), *base = *top;
    while (hits &= hits - 1) {
        slot = (unsigned)__builtin_ctz(hits);
        uint64_t other = to_key(near[slot], child_in_slot(node, slot)), later = nearest > other ? nearest : other,
                 *at = (*top)++;
        nearest = nearest > other ? other : nearest;
        for (; at > base && at[-1] < later; at--)
            at[0] = at[-1];
        *at = later;
        prefetch_child(walk->view, record_rows, (uint32_t)later);
    }
    return nearest;
}

BOXTEST_AVX2 static void find_closest(struct avx2_walk *walk)
{
    const struct portable_node *nodes = walk->view->nodes;
    const bool is_indexed = walk->view->header->content == PORTABLE_INDEXED_TRIANGLES;
    const uintptr_t record_rows = is_indexed ? 1 : 3; /* in units of 16 bytes */
    uint64_t stack[STACK_SIZE], *top = stack, visited = 0;
    uint32_t child = (uint32_t)CHILD_NODE << CHILD_KIND_SHIFT;
    for (;;) {
        uint32_t kind = child >> CHILD_KIND_SHIFT, index = child & CHILD_INDEX_MASK;
        if (kind == CHILD_NODE) {
            uint32_t near[8];
            const struct portable_node *node = &nodes[index];
            __m256i meta = load_bytes(node->meta);
            unsigned hits = test_boxes(walk, node, (float *)near);
            hits &= (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpgt_epi32(meta, _mm256_setzero_si256())));
            visited++;
            if (hits) {
                child = (uint32_t)push_all_but_nearest(walk, record_rows, near, node, hits, &top);
                continue;
            }
        } else if (!meet(walk, index, (2u << kind) - 1, is_indexed)) {
            break;
        }
        do {
            if (top == stack)
                goto end;
            top--;
        } while (!(near_of(*top) <= walk->state->tmax_above));
        child = (uint32_t)*top;
    }
end:
    walk->state->counters.nodes += visited;
}

BOXTEST_AVX2_INLINE void find(struct avx2_walk *walk)
{
    if (walk->state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        find_any(walk);
    else
        find_closest(walk);
}

BOXTEST_AVX2 bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view)
{
    struct avx2_walk walk;
    walk.state = state;
    walk.view = view;
    if (!boxtest_init_avx2(state->origin, state->direction, state->ray->tmin, view->header->bounds, &walk.boxes))
        return false;
    triangle_avx2_spread(&state->triangle_ray, &walk.triangles);
    find(&walk);
    return true;
}

BOXTEST_AVX2 bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view)
{
    struct avx2_walk walk;
    __m128 origin = _mm_loadu_ps(state->ray->origin), direction = _mm_loadu_ps(state->ray->direction);
    walk.state = state;
    walk.view = view;
    if (!setup_floats(origin, direction, state->ray->tmin, view->header->bounds, &walk.boxes))
        return false;
    triangle_avx2_init(origin, direction, &state->triangle_ray, &walk.triangles);
    find(&walk);
    return true;
}

#else

bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view)
{
    (void)state;
    (void)view;
    return false;
}

bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view)
{
    return traverse_avx2_triangles(state, view);
}

#endif

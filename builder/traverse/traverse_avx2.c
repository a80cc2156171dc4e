/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_avx2.c - traces rays through triangles, eight boxes at a time. Nearly all rays take this path, so it is one
 * piece of code. It gives the same results as the loops of traverse_loops.c with leaves of triangles, with fewer
 * instructions and fewer unpredictable branches.
 */
#include "builder/traverse/avx2_steps.h"

#ifdef BOXTEST_AVX2

/* The size of triangle records, in units of 16 bytes. */
enum { INDEXED_ROWS = 1, STORED_ROWS = 3 };

/*
 * Tests the records whose bits are set, counted from `first`. Returns false if the ray is finished. It is compiled once
 * for each value of is_indexed.
 */
BOXTEST_AVX2_INLINE bool meet_records(struct avx2_walk *walk, uint32_t first, uint32_t bits, bool is_indexed)
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

BOXTEST_AVX2_INLINE bool meet(struct avx2_walk *walk, uint32_t first, uint32_t bits, bool is_indexed)
{
    return is_indexed ? meet_records(walk, first, bits, true) : meet_records(walk, first, bits, false);
}

/* Does the same for stored triangles; `is_lazy` says that the ray may not be prepared for triangles yet. */
BOXTEST_AVX2_INLINE bool meet_stored(struct avx2_walk *walk, uint32_t first, uint32_t bits, bool is_lazy)
{
    if (is_lazy && !walk->has_triangles)
        avx2_walk_init_triangles(walk);
    return meet_records(walk, first, bits, false);
}

/*
 * Goes slot by slot, not by the bits that are set: the processor can then fetch a predicted leaf before its box test is
 * decided. Returns false if the ray is finished.
 */
BOXTEST_AVX2_INLINE bool meet_leaves(struct avx2_walk *walk, const struct portable_node *node, unsigned leaves,
                                     bool is_indexed)
{
    for (unsigned slot = 0; slot < 8; slot++) {
        const uint32_t meta = node->meta[slot]; /* the count is in unary: that many bits are set */
        if (leaves >> slot & 1 && !meet(walk, node->first_record + (meta & 31), meta >> 5, is_indexed))
            return false;
    }
    return true;
}

/* Does the same for an unpacked node. */
BOXTEST_AVX2_INLINE bool meet_unpacked_leaves(struct avx2_walk *walk, const struct unpacked_node *node, unsigned leaves,
                                              bool is_lazy)
{
    for (unsigned slot = 0; slot < 8; slot++) {
        const uint32_t child = node->children[slot];
        const uint32_t bits = (2u << (child >> CHILD_KIND_SHIFT)) - 1;
        if (leaves >> slot & 1 && !meet_stored(walk, child & CHILD_INDEX_MASK, bits, is_lazy))
            return false;
    }
    return true;
}

/*
 * Finds any hit. Leaves come first, then the inner children farthest along the ray's octant: most rays of this kind
 * start on a surface, which is near, and search for another one.
 */
BOXTEST_AVX2 static void find_any(struct avx2_walk *walk)
{
    const struct portable_node *nodes = walk->view->nodes;
    const bool is_indexed = walk->view->header->content == PORTABLE_INDEXED_TRIANGLES;
    uint32_t stack[AVX2_STACK_SIZE], *top = stack;
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

BOXTEST_AVX2 void traverse_avx2_any_instances(struct traverse_walk *walk, const struct boxtest_ray *ray,
                                              traverse_leaf leaf)
{
    const struct portable_node *nodes = walk->view->nodes; /* a leaf changes the walk's view */
    uint32_t stack[AVX2_STACK_SIZE], *top = stack;
    float near[8];
    *top++ = 0;
    while (top > stack) {
        const struct portable_node *node = &nodes[*--top];
        const unsigned hits = kernel_avx2(ray, node, walk->state.tmax_above, near), inner = hits & node->inner_mask;
        walk->state.counters.nodes++;
        for (unsigned leaves = hits & ~inner; leaves != 0; leaves &= leaves - 1) {
            const uint32_t meta = node->meta[__builtin_ctz(leaves)];
            leaf(walk, node->first_record + (meta & 31), (uint32_t)__builtin_popcount(meta >> 5));
            if (walk->state.is_done)
                return;
        }
        if (inner != 0)
            top = push_inner(node, inner, ray->backward, top);
    }
}

BOXTEST_AVX2_INLINE void find_any_unpacked(struct avx2_walk *walk, uint32_t start, bool is_lazy)
{
    const struct unpacked_node *nodes = walk->unpacked;
    uint32_t stack[AVX2_STACK_SIZE], *top = stack;
    uint64_t visited = 0;
    float near[8];
    *top++ = start;
    while (top > stack) {
        const struct unpacked_node *node = &nodes[*--top];
        const unsigned hits = test_unpacked(walk, node, near);
        visited++;
        if (hits == 0)
            continue;
        const unsigned inners = inner_slots(node), leaves = hits & ~inners, inner = hits & inners;
        if (leaves != 0 && !meet_unpacked_leaves(walk, node, leaves, is_lazy))
            break;
        if (inner != 0)
            top = push_unpacked_inner(nodes, node, inner, walk->boxes.backward, top);
    }
    walk->state->counters.nodes += visited;
}

BOXTEST_AVX2 void avx2_walk_any(struct avx2_walk *walk, uint32_t start)
{
    find_any_unpacked(walk, start, false);
}

/* Tests a node; pushes the children that are met but the nearest, which it returns in *ret_child. */
BOXTEST_AVX2_INLINE bool open_node(const struct avx2_walk *walk, uint32_t index, uintptr_t record_rows, uint64_t **top,
                                   uint32_t *ret_child)
{
    uint32_t near[8];
    const struct portable_node *node = &walk->view->nodes[index];
    __m256i meta = load_bytes(node->meta);
    unsigned hits = test_boxes(walk, node, (float *)near);
    hits &= (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpgt_epi32(meta, _mm256_setzero_si256())));
    if (hits)
        *ret_child = (uint32_t)push_all_but_nearest(walk, record_rows, near, node, hits, top);
    return hits != 0;
}

BOXTEST_AVX2_INLINE bool open_unpacked(const struct avx2_walk *walk, uint32_t index, uintptr_t record_rows,
                                       uint64_t **top, uint32_t *ret_child)
{
    uint32_t near[8];
    const struct unpacked_node *node = &walk->unpacked[index];
    unsigned hits = test_unpacked(walk, node, (float *)near);
    if (hits)
        *ret_child = (uint32_t)push_unpacked(walk, record_rows, near, node, hits, top);
    return hits != 0;
}

BOXTEST_AVX2_INLINE void find_closest_in(struct avx2_walk *walk, uint32_t child, bool is_unpacked, bool is_lazy)
{
    const bool is_indexed = !is_unpacked && walk->view->header->content == PORTABLE_INDEXED_TRIANGLES;
    const uintptr_t record_rows = is_indexed ? INDEXED_ROWS : STORED_ROWS;
    uint64_t stack[AVX2_STACK_SIZE], *top = stack, visited = 0;
    for (;;) {
        uint32_t kind = child >> CHILD_KIND_SHIFT, index = child & CHILD_INDEX_MASK;
        if (kind == CHILD_NODE) {
            visited++;
            if (is_unpacked ? open_unpacked(walk, index, record_rows, &top, &child)
                            : open_node(walk, index, record_rows, &top, &child))
                continue;
        } else if (is_unpacked ? !meet_stored(walk, index, (2u << kind) - 1, is_lazy)
                               : !meet(walk, index, (2u << kind) - 1, is_indexed)) {
            break;
        }
        if (!pop_child(walk, stack, &top, &child))
            break;
    }
    walk->state->counters.nodes += visited;
}

BOXTEST_AVX2 static void find_closest(struct avx2_walk *walk)
{
    find_closest_in(walk, CHILD_ROOT, false, false);
}

BOXTEST_AVX2 void avx2_walk_closest(struct avx2_walk *walk, uint32_t child)
{
    find_closest_in(walk, child, true, false);
}

BOXTEST_AVX2 bool avx2_walk_on_closest(struct avx2_walk *walk, struct avx2_cursor *cursor)
{
    uint64_t *top = cursor->closest.top;
    uint32_t child = cursor->closest.child;
    for (;;) {
        const uint32_t kind = child >> CHILD_KIND_SHIFT, index = child & CHILD_INDEX_MASK;
        if (kind == CHILD_NODE) {
            walk->state->counters.nodes++;
            if (open_unpacked(walk, index, STORED_ROWS, &top, &child))
                break;
        } else if (!meet(walk, index, (2u << kind) - 1, false)) {
            return false;
        }
        if (!pop_child(walk, cursor->closest.stack, &top, &child))
            return false;
    }
    prefetch_child(walk, STORED_ROWS, child);
    cursor->closest.top = top;
    cursor->closest.child = child;
    return true;
}

BOXTEST_AVX2 bool avx2_walk_on_any(struct avx2_walk *walk, struct avx2_cursor *cursor)
{
    const struct unpacked_node *node = cursor->any.node;
    uint32_t *top = cursor->any.top;
    unsigned hits;
    float near[8];
    for (unsigned rest = cursor->any.leaves; rest != 0; rest &= rest - 1) {
        const uint32_t child = node->children[__builtin_ctz(rest)];
        if (!meet(walk, child & CHILD_INDEX_MASK, (2u << (child >> CHILD_KIND_SHIFT)) - 1, false))
            return false;
    }
    do {
        if (top == cursor->any.stack)
            return false;
        node = &walk->unpacked[*--top];
        hits = test_unpacked(walk, node, near);
        walk->state->counters.nodes++;
    } while (hits == 0);
    const unsigned inner = hits & inner_slots(node), leaves = hits & ~inner;
    for (unsigned rest = leaves; rest != 0; rest &= rest - 1)
        prefetch_child(walk, STORED_ROWS, node->children[__builtin_ctz(rest)]);
    cursor->any.top = inner ? push_unpacked_inner(walk->unpacked, node, inner, walk->boxes.backward, top) : top;
    cursor->any.leaves = leaves;
    cursor->any.node = node;
    return true;
}

BOXTEST_AVX2_INLINE void find(struct avx2_walk *walk)
{
    const bool is_any = walk->state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
    if (walk->unpacked && is_any)
        avx2_walk_any(walk, 0);
    else if (walk->unpacked)
        avx2_walk_closest(walk, CHILD_ROOT);
    else if (is_any)
        find_any(walk);
    else
        find_closest(walk);
}

BOXTEST_AVX2 bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view,
                                          const struct unpacked_node *unpacked)
{
    struct avx2_walk walk;
    if (!avx2_walk_init_object(&walk, state, view, unpacked))
        return false;
    find(&walk);
    return true;
}

BOXTEST_AVX2 bool traverse_avx2_plain(struct traverse_state *state, const struct portable_view *view,
                                      const struct unpacked_node *unpacked)
{
    struct avx2_walk walk;
    if (!avx2_walk_init_nodes(&walk, state, view, unpacked))
        return false;
    if (state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT) {
        avx2_walk_init_triangles(&walk);
        find_any_unpacked(&walk, 0, false);
    } else {
        find_closest_in(&walk, CHILD_ROOT, true, true);
    }
    return true;
}

BOXTEST_AVX2 bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view,
                                      const struct unpacked_node *unpacked)
{
    struct avx2_walk walk;
    if (!avx2_walk_init(&walk, state, view, unpacked))
        return false;
    find(&walk);
    return true;
}

#else

void traverse_avx2_any_instances(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf)
{
    traverse_loop_avx2(walk, ray, leaf);
}

bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view,
                             const struct unpacked_node *unpacked)
{
    (void)state;
    (void)view;
    (void)unpacked;
    return false;
}

bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked)
{
    return traverse_avx2_triangles(state, view, unpacked);
}

bool traverse_avx2_plain(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked)
{
    return traverse_avx2_triangles(state, view, unpacked);
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moving_avx2.c - traces single rays through unpacked structures of motion triangles with AVX2. It gives the same
 * results as the loops of traverse_loops.c with leaves of motion triangles.
 */
#include "builder/traverse/avx2_steps.h"
#include "builder/traverse/boxtest_moving.h"
#include "builder/traverse/leaf_kind.h"

#ifdef BOXTEST_AVX2

enum { NODE_LINES = 7 }; /* lines of the cache */

/* Does for a moving node what boxtest_beside_unpacked() does. */
BOXTEST_AVX2 __attribute__((noinline)) static unsigned beside(const struct avx2_walk *walk,
                                                              const struct unpacked_moving_node *node, unsigned hits)
{
    struct unpacked_node still;
    const __m256 time = _mm256_broadcast_ss(&walk->at.end);
    for (int plane = 0; plane < 6; plane++)
        _mm256_storeu_ps(still.planes[plane], moving_planes_at(node, (uint32_t)(plane * sizeof still.planes[0]), time));
    return boxtest_beside_unpacked(&walk->boxes, &still, hits);
}

/* Does for a moving node what kernel_unpacked() does, with parallel axes. */
BOXTEST_AVX2_INLINE unsigned test_moving(const struct avx2_walk *walk, const struct unpacked_moving_node *node,
                                         uint32_t ret_near[8])
{
    const struct boxtest_ray *ray = &walk->boxes;
    const struct boxtest_scales *scales = &walk->scales;
    const __m256 time = _mm256_broadcast_ss(&walk->at.end);
    __m256i near[3], far[3];
    for (int axis = 0; axis < 3; axis++) {
        const __m256 origin = _mm256_broadcast_ss(&ray->origin[axis]), slack = _mm256_broadcast_ss(&ray->slack[axis]);
        const __m256 first = _mm256_sub_ps(moving_planes_at(node, scales->near_at[axis], time), origin),
                     last = _mm256_sub_ps(moving_planes_at(node, scales->far_at[axis], time), origin);
        near[axis] = _mm256_castps_si256(_mm256_fmsub_ps(first, _mm256_broadcast_ss(&scales->inner[axis]), slack));
        far[axis] = _mm256_castps_si256(_mm256_fmadd_ps(last, _mm256_broadcast_ss(&scales->outer[axis]), slack));
    }
    const __m256i tmin = _mm256_castps_si256(_mm256_set1_ps(ray->tmin)),
                  tmax = _mm256_castps_si256(_mm256_broadcast_ss(&walk->state->tmax_above));
    const __m256i first = _mm256_max_epi32(_mm256_max_epi32(near[0], near[1]), _mm256_max_epi32(near[2], tmin)),
                  last = _mm256_min_epi32(_mm256_min_epi32(far[0], far[1]), _mm256_min_epi32(far[2], tmax));
    _mm256_storeu_si256((__m256i *)(void *)ret_near, first);
    const unsigned hits =
        (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(_mm256_castsi256_ps(first), _mm256_castsi256_ps(last), _CMP_LE_OQ));
    return __builtin_expect(ray->parallel_axes != 0, 0) ? beside(walk, node, hits) : hits;
}

/* Tests some records. Returns false if the ray is finished. */
BOXTEST_AVX2_INLINE bool meet(struct avx2_walk *walk, uint32_t child)
{
    if (!walk->has_triangles)
        avx2_walk_init_triangles(walk);
    struct traverse_state *state = walk->state;
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t record = first; record < first + count; record++) {
        const struct unpacked_moving_triangle *triangle = &walk->moving_triangles[record];
        const __m128 corners[3] = {moving_corner_at(triangle, 0, walk->at), moving_corner_at(triangle, 1, walk->at),
                                   moving_corner_at(triangle, 2, walk->at)};
        struct triangle_hit hit;
        state->counters.triangles++;
        if (triangle_avx2_intersect_loaded(&walk->triangles, &state->triangle_ray, corners, NULL, &hit) &&
            hit.t > state->ray->tmin && hit.t <= state->tmax) {
            traverse_leaf_hit(state, record, triangle->id & PORTABLE_ID_MASK, triangle->id & PORTABLE_ID_OPAQUE, &hit);
            if (state->is_done)
                return false;
        }
    }
    return true;
}

BOXTEST_AVX2_INLINE void prefetch_lines(const void *at, unsigned lines)
{
    for (unsigned i = 0; i < lines; i++)
        __builtin_prefetch((const char *)at + 64 * i);
}

/* Prefetches the beginning of a child that is pushed on the stack, or so much of one that is next. */
BOXTEST_AVX2_INLINE void prefetch_moving(const struct avx2_walk *walk, uint32_t child, unsigned lines)
{
    const uint32_t index = child & CHILD_INDEX_MASK;
    const bool is_node = child >= CHILD_ROOT;
    const uintptr_t from = (uintptr_t)(is_node ? (const void *)walk->moving_nodes : walk->moving_triangles);
    prefetch_lines(
        (const void *)(from + index * (is_node ? sizeof *walk->moving_nodes : sizeof *walk->moving_triangles)), lines);
}

/* Pushes all `hits` but the nearest, with the nearest of them on top, and returns the nearest. */
BOXTEST_AVX2_INLINE uint32_t push_moving(const struct avx2_walk *walk, const uint32_t near[8],
                                         const uint32_t children[8], unsigned hits, uint64_t **top)
{
    unsigned slot = (unsigned)__builtin_ctz(hits);
    uint64_t nearest = to_key(near[slot], children[slot]), *base = *top;
    while (hits &= hits - 1) {
        slot = (unsigned)__builtin_ctz(hits);
        const uint64_t other = to_key(near[slot], children[slot]);
        uint64_t later = nearest > other ? nearest : other, *at = (*top)++;
        for (; at > base && at[-1] < later; at--)
            at[0] = at[-1];
        *at = later;
        prefetch_moving(walk, (uint32_t)later, 2);
        nearest = nearest > other ? other : nearest;
    }
    return (uint32_t)nearest;
}

BOXTEST_AVX2 void moving_walk_closest(struct avx2_walk *walk, uint32_t child)
{
    uint64_t stack[AVX2_STACK_SIZE], *top = stack, visited = 0;
    for (;;) {
        if (child >= CHILD_ROOT) {
            uint32_t near[8];
            const struct unpacked_moving_node *node = &walk->moving_nodes[child & CHILD_INDEX_MASK];
            const unsigned hits = test_moving(walk, node, near);
            visited++;
            if (hits != 0) {
                child = push_moving(walk, near, node->start.children, hits, &top);
                continue;
            }
        } else if (!meet(walk, child)) {
            break;
        }
        if (!pop_child(walk, stack, &top, &child))
            break;
    }
    walk->state->counters.nodes += visited;
}

/* Pushes the inner children in the slots `inner`, with the farthest along the ray's octant on top. */
BOXTEST_AVX2_INLINE uint32_t *push_moving_inner(const struct avx2_walk *walk, const struct unpacked_node *node,
                                                unsigned inner, uint32_t *top)
{
    const unsigned backward = walk->boxes.backward;
    for (unsigned i = 0; inner != 0 && i < 8; i++)
        if (inner >> (i ^ backward) & 1) {
            const uint32_t index = node->children[i ^ backward] & CHILD_INDEX_MASK;
            prefetch_lines(&walk->moving_nodes[index], NODE_LINES);
            *top++ = index;
        }
    return top;
}

/* Finds any hit: the leaves of a node first, then its inner children farthest along the ray's octant. */
BOXTEST_AVX2 void moving_walk_any(struct avx2_walk *walk, uint32_t start)
{
    uint32_t stack[AVX2_STACK_SIZE], *top = stack, near[8];
    uint64_t visited = 0;
    bool is_done = false;
    *top++ = start;
    while (top > stack && !is_done) {
        const struct unpacked_moving_node *node = &walk->moving_nodes[*--top];
        const unsigned hits = test_moving(walk, node, near), inner = hits & inner_slots(&node->start);
        visited++;
        for (unsigned slot = 0; slot < 8 && !is_done; slot++)
            is_done = (hits & ~inner) >> slot & 1 && !meet(walk, node->start.children[slot]);
        top = push_moving_inner(walk, &node->start, inner, top);
    }
    walk->state->counters.nodes += visited;
}

BOXTEST_AVX2 bool moving_walk_on_closest(struct avx2_walk *walk, struct avx2_cursor *cursor)
{
    uint64_t *top = cursor->closest.top;
    uint32_t child = cursor->closest.child;
    for (;;) {
        if (child >= CHILD_ROOT) {
            uint32_t near[8];
            const struct unpacked_moving_node *node = &walk->moving_nodes[child & CHILD_INDEX_MASK];
            const unsigned hits = test_moving(walk, node, near);
            walk->state->counters.nodes++;
            if (hits != 0) {
                child = push_moving(walk, near, node->start.children, hits, &top);
                break;
            }
        } else if (!meet(walk, child)) {
            return false;
        }
        if (!pop_child(walk, cursor->closest.stack, &top, &child))
            return false;
    }
    prefetch_moving(walk, child, NODE_LINES);
    cursor->closest.top = top;
    cursor->closest.child = child;
    return true;
}

BOXTEST_AVX2 bool moving_walk_on_any(struct avx2_walk *walk, struct avx2_cursor *cursor)
{
    const struct unpacked_node *node = cursor->any.node;
    uint32_t *top = cursor->any.top, near[8];
    unsigned hits;
    for (unsigned rest = cursor->any.leaves; rest != 0; rest &= rest - 1)
        if (!meet(walk, node->children[__builtin_ctz(rest)]))
            return false;
    do {
        if (top == cursor->any.stack)
            return false;
        const struct unpacked_moving_node *moving = &walk->moving_nodes[*--top];
        node = &moving->start;
        hits = test_moving(walk, moving, near);
        walk->state->counters.nodes++;
    } while (hits == 0);
    const unsigned inner = hits & inner_slots(node), leaves = hits & ~inner;
    for (unsigned rest = leaves; rest != 0; rest &= rest - 1)
        prefetch_moving(walk, node->children[__builtin_ctz(rest)], 2);
    cursor->any.top = push_moving_inner(walk, node, inner, top);
    cursor->any.leaves = leaves;
    cursor->any.node = node;
    return true;
}

BOXTEST_AVX2 void traverse_avx2_any_moving_instances(struct traverse_walk *walk, const struct boxtest_moving *ray,
                                                     traverse_leaf leaf)
{
    const struct portable_moving_node *nodes =
        (const struct portable_moving_node *)(const void *)walk->view->nodes; /* a leaf changes the walk's view */
    uint32_t stack[AVX2_STACK_SIZE], *top = stack;
    float near[8];
    *top++ = 0;
    while (top > stack) {
        const struct portable_moving_node *moving = &nodes[*--top];
        const struct portable_node *node = &moving->start;
        const unsigned hits = kernel_moving_avx2(ray, moving, walk->state.tmax_above, near),
                       inner = hits & node->inner_mask;
        walk->state.counters.nodes++;
        for (unsigned leaves = hits & ~inner; leaves != 0; leaves &= leaves - 1) {
            const uint32_t meta = node->meta[__builtin_ctz(leaves)];
            leaf(walk, node->first_record + (meta & 31), (uint32_t)__builtin_popcount(meta >> 5));
            if (walk->state.is_done)
                return;
        }
        if (inner != 0)
            top = push_inner(node, inner, ray->still.backward, top);
    }
}

/* Does what is left to prepare a ray, of which the boxes are. */
BOXTEST_AVX2_INLINE void begin(struct avx2_walk *walk, struct traverse_state *state, const struct portable_view *view,
                               const struct unpacked_node *unpacked)
{
    walk->state = state;
    walk->view = view;
    walk->unpacked = NULL;
    walk->has_triangles = false;
    walk->scales = unpacked_scales(&walk->boxes);
    walk->moving_nodes = (const struct unpacked_moving_node *)(const void *)unpacked;
    walk->moving_triangles = unpacked_moving_triangles(view, walk->moving_nodes);
    walk->at = motion_weights_at(state->ray->time);
}

BOXTEST_AVX2 bool moving_walk_init(struct avx2_walk *walk, struct traverse_state *state,
                                   const struct portable_view *view, const struct unpacked_node *unpacked)
{
    if (!boxtest_init_avx2(state->origin, state->direction, state->ray->tmin, view->header->bounds, &walk->boxes))
        return false;
    boxtest_widen(&walk->boxes, view->header->bounds);
    begin(walk, state, view, unpacked);
    triangle_avx2_spread(&state->triangle_ray, &walk->triangles);
    walk->has_triangles = true;
    return true;
}

/* Does the work of boxtest_widen() for unpacked nodes; FLT_MIN is more than what underflows. */
BOXTEST_AVX2_INLINE void widen_floats(struct boxtest_ray *ray, const float bounds[6])
{
    const __m128 min = _mm_loadu_ps(bounds), max = _mm_permute_ps(_mm_loadu_ps(bounds + 2), _MM_SHUFFLE(3, 3, 2, 1));
    const __m128 corner = _mm_max_ps(absolute_xyz(min), absolute_xyz(max)),
                 moved = _mm_fmadd_ps(corner, _mm_set1_ps((float)(1.001 * moving_error)), _mm_set1_ps(FLT_MIN)),
                 size = absolute_xyz(_mm_load_ps(ray->inverse));
    _mm_store_ps(ray->slack, _mm_fmadd_ps(moved, size, _mm_load_ps(ray->slack)));
}

BOXTEST_AVX2 bool moving_walk_init_world(struct avx2_walk *walk, struct traverse_state *state,
                                         const struct portable_view *view, const struct unpacked_node *unpacked)
{
    const struct ray *ray = state->ray;
    const float *bounds = view->header->bounds;
    if (!setup_floats(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), ray->tmin, bounds, &walk->boxes))
        return false;
    if (__builtin_expect(walk->boxes.parallel_axes != 0, 0))
        boxtest_widen(&walk->boxes, bounds);
    else
        widen_floats(&walk->boxes, bounds);
    begin(walk, state, view, unpacked);
    return true;
}

BOXTEST_AVX2_INLINE void find(struct avx2_walk *walk)
{
    if (walk->state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        moving_walk_any(walk, 0);
    else
        moving_walk_closest(walk, CHILD_ROOT);
}

BOXTEST_AVX2 bool traverse_avx2_moving(struct traverse_state *state, const struct portable_view *view,
                                       const struct unpacked_node *unpacked)
{
    struct avx2_walk walk;
    if (!unpacked || !avx2_walk_can_unpack(state) || !moving_walk_init(&walk, state, view, unpacked))
        return false;
    find(&walk);
    return true;
}

BOXTEST_AVX2 bool traverse_avx2_moving_world(struct traverse_state *state, const struct portable_view *view,
                                             const struct unpacked_node *unpacked)
{
    struct avx2_walk walk;
    if (!unpacked || !avx2_walk_can_unpack(state) || !moving_walk_init_world(&walk, state, view, unpacked))
        return false;
    find(&walk);
    return true;
}

#else

void traverse_avx2_any_moving_instances(struct traverse_walk *walk, const struct boxtest_moving *ray,
                                        traverse_leaf leaf)
{
    traverse_loop_moving_avx2(walk, ray, leaf);
}

bool traverse_avx2_moving(struct traverse_state *state, const struct portable_view *view,
                          const struct unpacked_node *unpacked)
{
    (void)state;
    (void)view;
    (void)unpacked;
    return false;
}

bool traverse_avx2_moving_world(struct traverse_state *state, const struct portable_view *view,
                                const struct unpacked_node *unpacked)
{
    return traverse_avx2_moving(state, view, unpacked);
}

#endif

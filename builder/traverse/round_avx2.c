/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_avx2.c - traces single rays through spheres and linear swept spheres with AVX2. It gives the same results as
 * the loops of traverse_loops.c with leaves of leaf_round.c. The records of all leaves of a node are tested together,
 * eight at a time in float; those that float does not dismiss are decided one by one, the nearest first.
 */
#include "builder/traverse/avx2_steps.h"
#include "builder/traverse/round_lanes.h"
#include "builder/traverse/round_records.h"

#ifdef BOXTEST_AVX2

enum { LANES = 8 };

/* One ray through round kinds. */
struct round_walk {
    struct avx2_walk nodes; /* without its triangles */
    bool is_prepared; /* the state and `lanes` are prepared, which they are at the first leaf */
    struct round_lanes_ray lanes;
};

/* The records of one node that a ray may meet. */
struct gathered {
    uint32_t records[PORTABLE_LEAF_MAX * LANES + LANES];
    unsigned count;
};

/* Exchanges the rows and columns of eight registers. */
BOXTEST_AVX2_INLINE void transpose(__m256 rows[8])
{
    __m256 pairs[8], quads[8];
    for (int k = 0; k < 8; k += 2) {
        pairs[k] = _mm256_unpacklo_ps(rows[k], rows[k + 1]);
        pairs[k + 1] = _mm256_unpackhi_ps(rows[k], rows[k + 1]);
    }
    for (int k = 0; k < 8; k += 4)
        for (int half = 0; half < 2; half++) {
            quads[k + 2 * half] = _mm256_shuffle_ps(pairs[k + half], pairs[k + 2 + half], _MM_SHUFFLE(1, 0, 1, 0));
            quads[k + 2 * half + 1] = _mm256_shuffle_ps(pairs[k + half], pairs[k + 2 + half], _MM_SHUFFLE(3, 2, 3, 2));
        }
    for (int k = 0; k < 4; k++) {
        rows[k] = _mm256_permute2f128_ps(quads[k], quads[k + 4], 0x20);
        rows[k + 4] = _mm256_permute2f128_ps(quads[k], quads[k + 4], 0x31);
    }
}

/* Loads eight spheres, or four that get into both halves: four registers with one number of each. */
BOXTEST_AVX2_INLINE void load_spheres(const float *const vertices[LANES], int lanes, __m256 ret_spheres[4])
{
    __m256 rows[4], pairs[4];
    for (int k = 0; k < 4; k++)
        rows[k] = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(vertices[k])),
                                       _mm_loadu_ps(vertices[k + lanes - 4]), 1);
    for (int k = 0; k < 4; k += 2) {
        pairs[k] = _mm256_unpacklo_ps(rows[k], rows[k + 1]);
        pairs[k + 1] = _mm256_unpackhi_ps(rows[k], rows[k + 1]);
    }
    for (int half = 0; half < 2; half++) {
        ret_spheres[2 * half] = _mm256_shuffle_ps(pairs[half], pairs[2 + half], _MM_SHUFFLE(1, 0, 1, 0));
        ret_spheres[2 * half + 1] = _mm256_shuffle_ps(pairs[half], pairs[2 + half], _MM_SHUFFLE(3, 2, 3, 2));
    }
}

/* Returns the length up to which a hit can be the answer. */
static inline float reach_of(const struct round_walk *walk)
{
    const float reach = walk->nodes.state->tmax_above * walk->lanes.speed;
    return reach + 0x1p-18f * fabsf(reach); /* the speed is rounded for positive numbers */
}

/* Decides the records whose bits are set, the nearest first. Returns false if the ray is finished. */
BOXTEST_AVX2_INLINE bool decide(const struct round_walk *walk, const uint32_t *records, unsigned bits,
                                const float near[LANES], bool is_swept)
{
    struct traverse_state *state = walk->nodes.state;
    while (bits != 0) {
        unsigned nearest = (unsigned)__builtin_ctz(bits);
        for (unsigned rest = bits & (bits - 1); rest != 0; rest &= rest - 1) {
            const unsigned lane = (unsigned)__builtin_ctz(rest);
            nearest = near[lane] < near[nearest] ? lane : nearest;
        }
        if (near[nearest] > reach_of(walk))
            return true;
        bits &= ~(1u << nearest);
        (is_swept ? round_meet_swept : round_meet_sphere)(state, walk->nodes.view, records[nearest]);
        if (state->is_done)
            return false;
    }
    return true;
}

__attribute__((noinline)) static void prepare_lanes(struct round_walk *walk, bool is_swept)
{
    round_prepare(walk->nodes.state, is_swept ? MET_SWEPT_SPHERE : MET_SPHERE);
    round_lanes_init(walk->nodes.state, is_swept, &walk->lanes);
    walk->is_prepared = true;
}

/* Returns those of `count` records that the ray may meet, as bits. There are at most as many as `lanes`. */
BOXTEST_AVX2_INLINE unsigned meet_lanes(const struct round_walk *walk, const uint32_t *records, unsigned count,
                                        int lanes, bool is_swept, float ret_near[LANES])
{
    const struct portable_view *view = walk->nodes.view;
    const float *vertices[LANES];
    unsigned bits;
    for (unsigned lane = 0; lane < (unsigned)lanes; lane++)
        vertices[lane] = round_vertex_of(view, round_record_at(view, records[lane < count ? lane : 0]));
    if (is_swept) {
        __m256 ends[8];
        for (int lane = 0; lane < lanes; lane++)
            ends[lane] = _mm256_loadu_ps(vertices[lane]);
        transpose(ends);
        bits = lanes_meet_swept(&walk->lanes, ends, reach_of(walk), ret_near);
    } else {
        __m256 spheres[4];
        load_spheres(vertices, lanes, spheres);
        bits = lanes_meet_spheres(&walk->lanes, spheres, reach_of(walk), ret_near);
    }
    return bits & ((1u << count) - 1);
}

BOXTEST_AVX2_INLINE bool meet_gathered(struct round_walk *walk, struct gathered *gathered, bool is_swept)
{
    if (!walk->is_prepared)
        prepare_lanes(walk, is_swept);
    for (unsigned at = 0; at < gathered->count; at += LANES) {
        const unsigned count = gathered->count - at < LANES ? gathered->count - at : LANES;
        const uint32_t *records = &gathered->records[at];
        float near[LANES];
        /* Most leaves have few spheres. For linear swept spheres, which are larger, another branch costs too much. */
        const bool is_few = !is_swept && count <= LANES / 2;
        const unsigned bits = is_few ? meet_lanes(walk, records, count, LANES / 2, false, near)
                                     : meet_lanes(walk, records, count, LANES, is_swept, near);
        if (bits != 0 && !decide(walk, records, bits, near, is_swept))
            return false;
    }
    return true;
}

BOXTEST_AVX2_INLINE void gather(struct gathered *gathered, uint32_t first, unsigned count)
{
    /* Only the first `count` remain; to store them all needs no loop whose end is unpredictable. */
    for (unsigned i = 0; i < PORTABLE_LEAF_MAX; i++)
        gathered->records[gathered->count + i] = first + i;
    gathered->count += count;
}

/* Tests a node and meets its leaves. Returns its inner children that the ray meets, or sets *ret_is_done. */
BOXTEST_AVX2_INLINE unsigned enter_node(struct round_walk *walk, uint32_t index, uint32_t near[LANES], bool is_unpacked,
                                        bool is_swept, bool *ret_is_done)
{
    const struct portable_node *node = &walk->nodes.view->nodes[index];
    const struct unpacked_node *unpacked = is_unpacked ? &walk->nodes.unpacked[index] : NULL;
    struct gathered gathered;
    unsigned hits, inner;
    gathered.count = 0;
    if (is_unpacked) {
        hits = test_unpacked(&walk->nodes, unpacked, (float *)near);
        inner = hits & inner_slots(unpacked);
    } else {
        hits = test_boxes(&walk->nodes, node, (float *)near);
        inner = hits & node->inner_mask;
    }
    for (unsigned rest = hits & ~inner; rest != 0; rest &= rest - 1) {
        const unsigned slot = (unsigned)__builtin_ctz(rest);
        if (is_unpacked) {
            const uint32_t child = unpacked->children[slot];
            gather(&gathered, child & CHILD_INDEX_MASK, (child >> CHILD_KIND_SHIFT) + 1);
        } else {
            gather(&gathered, node->first_record + (node->meta[slot] & 31),
                   (unsigned)__builtin_popcount(node->meta[slot] >> 5)); /* none if the slot is empty */
        }
    }
    *ret_is_done = gathered.count > 0 && !meet_gathered(walk, &gathered, is_swept);
    return inner;
}

BOXTEST_AVX2_INLINE void find_closest_in(struct round_walk *walk, bool is_unpacked, bool is_swept)
{
    const struct avx2_walk *nodes = &walk->nodes;
    uint64_t stack[AVX2_STACK_SIZE], *top = stack, visited = 0;
    uint32_t child = CHILD_ROOT, near[LANES];
    bool is_done;
    for (;;) {
        const uint32_t index = child & CHILD_INDEX_MASK;
        const unsigned inner = enter_node(walk, index, near, is_unpacked, is_swept, &is_done);
        visited++;
        if (is_done)
            break;
        if (inner != 0) {
            child =
                (uint32_t)(is_unpacked ? push_unpacked(nodes, 0, near, &nodes->unpacked[index], inner, &top)
                                       : push_all_but_nearest(nodes, 0, near, &nodes->view->nodes[index], inner, &top));
            continue;
        }
        if (!pop_child(nodes, stack, &top, &child))
            break;
    }
    nodes->state->counters.nodes += visited;
}

/* Finds any hit, with the inner children farthest along the ray's octant first, as for triangles. */
BOXTEST_AVX2_INLINE void find_any_in(struct round_walk *walk, bool is_unpacked, bool is_swept)
{
    const struct avx2_walk *nodes = &walk->nodes;
    uint32_t stack[AVX2_STACK_SIZE], *top = stack, near[LANES];
    uint64_t visited = 0;
    bool is_done = false;
    *top++ = 0;
    while (top > stack && !is_done) {
        const uint32_t index = *--top;
        const unsigned inner = enter_node(walk, index, near, is_unpacked, is_swept, &is_done);
        visited++;
        if (inner != 0)
            top = is_unpacked
                      ? push_unpacked_inner(nodes->unpacked, &nodes->unpacked[index], inner, nodes->boxes.backward, top)
                      : push_inner(&nodes->view->nodes[index], inner, nodes->boxes.backward, top);
    }
    nodes->state->counters.nodes += visited;
}

BOXTEST_AVX2_INLINE void find_in(struct round_walk *walk, bool is_unpacked, bool is_swept)
{
    if (walk->nodes.state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        find_any_in(walk, is_unpacked, is_swept);
    else
        find_closest_in(walk, is_unpacked, is_swept);
}

BOXTEST_AVX2 static void find_spheres(struct round_walk *walk)
{
    find_in(walk, false, false);
}

BOXTEST_AVX2 static void find_spheres_unpacked(struct round_walk *walk)
{
    find_in(walk, true, false);
}

BOXTEST_AVX2 static void find_swept(struct round_walk *walk)
{
    find_in(walk, false, true);
}

BOXTEST_AVX2 static void find_swept_unpacked(struct round_walk *walk)
{
    find_in(walk, true, true);
}

/* Prepares the box tests. Outside instances the ray is one of floats, which takes less time. */
BOXTEST_AVX2_INLINE bool prepare_boxes(const struct traverse_state *state, const float bounds[6],
                                       struct boxtest_ray *ret_boxes)
{
    const struct ray *ray = state->ray;
    if (!state->object_to_world)
        return setup_floats(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), ray->tmin, bounds, ret_boxes);
    return boxtest_init_avx2(state->origin, state->direction, ray->tmin, bounds, ret_boxes);
}

BOXTEST_AVX2 bool traverse_avx2_round(struct traverse_state *state, const struct portable_view *view,
                                      const struct unpacked_node *unpacked)
{
    struct round_walk walk;
    if (state->options->candidate || !prepare_boxes(state, view->header->bounds, &walk.nodes.boxes))
        return false;
    walk.nodes.state = state;
    walk.nodes.view = view;
    walk.nodes.unpacked = avx2_walk_can_unpack(state) ? unpacked : NULL;
    if (walk.nodes.unpacked)
        walk.nodes.scales = unpacked_scales(&walk.nodes.boxes);
    walk.is_prepared = false;
    const bool is_swept = view->header->content == PORTABLE_SWEPT_SPHERES;
    if (walk.nodes.unpacked)
        (is_swept ? find_swept_unpacked : find_spheres_unpacked)(&walk);
    else
        (is_swept ? find_swept : find_spheres)(&walk);
    return true;
}

#else

bool traverse_avx2_round(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked)
{
    (void)state;
    (void)view;
    (void)unpacked;
    return false;
}

#endif

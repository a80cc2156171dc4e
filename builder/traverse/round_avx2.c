/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_avx2.c - traces single rays through spheres and linear swept spheres with AVX2. It gives the same results as
 * the loops of traverse_loops.c with leaves of leaf_round.c. The records of all leaves of a node are tested together,
 * four at a time.
 */
#include "builder/traverse/round_walk.h"

#include "builder/traverse/avx2_steps.h"
#include "builder/traverse/round_records.h"

#ifdef BOXTEST_AVX2

enum { LANES = 4, SLOTS = 8 };

__attribute__((noinline)) BOXTEST_AVX2 static void prepare_lanes(struct round_walk *walk, bool is_swept)
{
    struct traverse_state *state = walk->nodes.state;
    if (!state->object_to_world)
        traverse_state_to_world(state);
    round_prepare(state, is_swept ? MET_SWEPT_SPHERE : MET_SPHERE);
    const struct round_ray *ray = &state->round_ray;
    const double *d = ray->direction;
    for (int k = 0; k < 3; k++) {
        walk->lanes.origin[k] = _mm256_broadcast_sd(&ray->origin[k]);
        walk->lanes.direction[k] = _mm256_broadcast_sd(&d[k]);
    }
    walk->lanes.squared = _mm256_set1_pd(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    walk->lanes.scale = _mm256_broadcast_sd(&ray->scale);
    walk->lanes.tmin = lanes_least(_mm256_broadcast_sd(&ray->tmin));
    walk->lanes.behind = _mm256_set1_pd(ray->tmin >= 0 ? 0 : -INFINITY);
    walk->is_prepared = true;
}

/* Returns where the numbers of a record are. */
BOXTEST_AVX2_INLINE const float *shape_of(const struct round_walk *walk, uint32_t record, bool is_unpacked,
                                          bool is_swept)
{
    return is_unpacked ? walk->shapes + (uint64_t)(is_swept ? UNPACKED_SWEPT : UNPACKED_SPHERE) * record
                       : round_vertex_of(walk->nodes.view, round_record_at(walk->nodes.view, record));
}

/* Loads the spheres at four places: four registers with one number of each. */
BOXTEST_AVX2_INLINE void load_spheres(const float *const places[LANES], __m256d ret_spheres[4])
{
    __m128 rows[LANES];
    for (int lane = 0; lane < LANES; lane++)
        rows[lane] = _mm_loadu_ps(places[lane]);
    _MM_TRANSPOSE4_PS(rows[0], rows[1], rows[2], rows[3]);
    for (int k = 0; k < 4; k++)
        ret_spheres[k] = _mm256_cvtps_pd(rows[k]);
}

/* Does the same for linear swept spheres. */
BOXTEST_AVX2_INLINE void load_swept(const float *const places[LANES], __m256d ret_first[4], __m256d ret_second[4])
{
    __m256 rows[LANES], pairs[LANES];
    for (int lane = 0; lane < LANES; lane++)
        rows[lane] = _mm256_loadu_ps(places[lane]);
    for (int k = 0; k < LANES; k += 2) {
        pairs[k] = _mm256_unpacklo_ps(rows[k], rows[k + 1]);
        pairs[k + 1] = _mm256_unpackhi_ps(rows[k], rows[k + 1]);
    }
    for (int k = 0; k < 4; k++) {
        const __m256 both = k % 2 == 0 ? _mm256_shuffle_ps(pairs[k / 2], pairs[k / 2 + 2], _MM_SHUFFLE(1, 0, 1, 0))
                                       : _mm256_shuffle_ps(pairs[k / 2], pairs[k / 2 + 2], _MM_SHUFFLE(3, 2, 3, 2));
        ret_first[k] = _mm256_cvtps_pd(_mm256_castps256_ps128(both));
        ret_second[k] = _mm256_cvtps_pd(_mm256_extractf128_ps(both, 1));
    }
}

/* Processes the pairs that hit or are open. Returns false if the ray is finished. */
BOXTEST_AVX2_INLINE bool decide(const struct round_walk *walk, const uint32_t *records,
                                const float *const places[LANES], const struct round_lanes_hits *hits, bool is_unpacked,
                                bool is_swept)
{
    const struct portable_view *view = walk->nodes.view;
    struct traverse_state *state = walk->nodes.state;
    double t[LANES], u[LANES];
    _mm256_storeu_pd(t, hits->t);
    if (is_swept)
        _mm256_storeu_pd(u, hits->u);
    for (unsigned rest = lanes_met(hits); rest != 0; rest &= rest - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(rest);
        if (__builtin_expect(hits->open >> lane & 1, 0)) {
            (is_swept ? round_meet_swept : round_meet_sphere)(state, view, records[lane]);
        } else if (is_swept && !(hits->hits >> lane & 1)) {
            round_meet_cap(state, view, records[lane], hits->ends[1] >> lane & 1);
        } else {
            const uint32_t id =
                is_unpacked ? unpacked_shape_id(places[lane], is_swept) : round_record_at(view, records[lane])->id;
            traverse_leaf_round(state, records[lane], id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, t[lane],
                                is_swept ? u[lane] : 0);
        }
        if (state->is_done)
            return false;
    }
    return true;
}

/* Meets up to four records. Returns false if the ray is finished. */
BOXTEST_AVX2_INLINE bool meet_lanes(struct round_walk *walk, const uint32_t *records, unsigned count, bool is_unpacked,
                                    bool is_swept)
{
    const float *places[LANES];
    const unsigned wanted = _bzhi_u32((1u << LANES) - 1, count);
    const __m256d tmax = _mm256_broadcast_sd(&walk->nodes.state->tmax);
    struct round_lanes_hits hits;
    for (unsigned lane = 0; lane < LANES; lane++)
        places[lane] = shape_of(walk, records[lane], is_unpacked, is_swept);
    if (is_swept) {
        __m256d first[4], second[4];
        load_swept(places, first, second);
        lanes_meet_swept(&walk->lanes, first, second, tmax, wanted, &hits);
    } else {
        __m256d spheres[4];
        load_spheres(places, spheres);
        lanes_meet_spheres(&walk->lanes, spheres, tmax, wanted, &hits);
    }
    return lanes_met(&hits) == 0 || decide(walk, records, places, &hits, is_unpacked, is_swept);
}

BOXTEST_AVX2_INLINE bool meet_gathered(struct round_walk *walk, const uint32_t *records, unsigned count,
                                       bool is_unpacked, bool is_swept)
{
    if (!walk->is_prepared)
        prepare_lanes(walk, is_swept);
    walk->nodes.state->counters.triangles += count;
    if (!meet_lanes(walk, records, count, is_unpacked, is_swept))
        return false;
    for (unsigned at = LANES; __builtin_expect(at < count, 0); at += LANES)
        if (!meet_lanes(walk, &records[at], count - at, is_unpacked, is_swept))
            return false;
    return true;
}

/*
 * Stores the records of a leaf. Those that follow them in a whole register are stored, too: there are always as many,
 * since shapes of an unpacked structure are followed by room (unpacked.h).
 */
BOXTEST_AVX2_INLINE unsigned store_leaf(uint32_t child, uint32_t *ret_records)
{
    _Static_assert(UNPACKED_SHAPES_ROOM >= SLOTS - 1, "rows after the first one");
    const __m256i first = _mm256_set1_epi32((int)(child & CHILD_INDEX_MASK));
    _mm256_storeu_si256((__m256i *)(void *)ret_records,
                        _mm256_add_epi32(first, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)));
    return (child >> CHILD_KIND_SHIFT) + 1;
}

/*
 * Stores the records of leaves, of which there is at least one, and returns their number. A second leaf is stored
 * without a branch, because whether there is one is unpredictable.
 */
BOXTEST_AVX2_INLINE unsigned gather_unpacked(const struct unpacked_node *node, unsigned leaves, uint32_t *ret_records)
{
    unsigned rest = leaves & (leaves - 1);
    unsigned count = store_leaf(node->children[_tzcnt_u32(leaves)], ret_records);
    const unsigned more = store_leaf(node->children[_tzcnt_u32(rest) % SLOTS], ret_records + count);
    count += rest ? more : 0;
    for (rest &= rest - 1; __builtin_expect(rest != 0, 0); rest &= rest - 1)
        count += store_leaf(node->children[_tzcnt_u32(rest)], ret_records + count);
    return count;
}

/* Does the same for a portable node, of which leaves can be empty. Lanes without a record have the last one. */
BOXTEST_AVX2_INLINE unsigned gather_portable(const struct portable_node *node, unsigned leaves, uint32_t *ret_records)
{
    unsigned count = 0;
    for (; leaves != 0; leaves &= leaves - 1) {
        const uint32_t meta = node->meta[_tzcnt_u32(leaves)];
        for (unsigned i = 0; i < (unsigned)__builtin_popcount(meta >> 5); i++)
            ret_records[count++] = node->first_record + (meta & 31) + i;
    }
    for (unsigned lane = 0; count > 0 && lane < LANES - 1; lane++)
        ret_records[count + lane] = ret_records[count - 1];
    return count;
}

BOXTEST_AVX2_INLINE void prefetch_node(const struct unpacked_node *node)
{
    for (unsigned line = 0; line < 4; line++)
        __builtin_prefetch((const char *)node + 64 * line);
}

/*
 * Returns the slots of an unpacked node that the ray meets, with lower bounds of the distances, or with the lengths of
 * the ray in their boxes.
 */
BOXTEST_AVX2_INLINE unsigned test_slots(const struct avx2_walk *walk, const struct unpacked_node *node, bool is_any,
                                        float ret_order[SLOTS])
{
    __m256 first, last;
    const unsigned hits =
        kernel_unpacked_intervals(&walk->boxes, &walk->scales, node, walk->state->tmax_above, &first, &last);
    _mm256_storeu_ps(ret_order, is_any ? _mm256_sub_ps(last, first) : first);
    return __builtin_expect(walk->boxes.parallel_axes != 0, 0) ? boxtest_beside_unpacked(&walk->boxes, node, hits)
                                                               : hits;
}

/*
 * Tests a node and meets its leaves. Returns its inner children that the ray meets, with what test_slots() tells of
 * them, or sets *ret_is_done.
 */
BOXTEST_AVX2_INLINE unsigned enter_node(struct round_walk *walk, uint32_t index, bool is_unpacked, bool is_swept,
                                        bool is_any, uint32_t ret_order[SLOTS], bool *ret_is_done)
{
    /* Keeps the compiler from holding the addresses of the walk's numbers, for which there are too few registers. */
    __asm__("" : "+r"(walk));
    const struct portable_node *node = &walk->nodes.view->nodes[index];
    const struct unpacked_node *unpacked = is_unpacked ? &walk->nodes.unpacked[index] : NULL;
    uint32_t records[(PORTABLE_LEAF_MAX + 1) * SLOTS];
    const unsigned hits = is_unpacked ? test_slots(&walk->nodes, unpacked, is_any, (float *)ret_order)
                                      : test_boxes(&walk->nodes, node, (float *)ret_order);
    const unsigned inners = is_unpacked ? inner_slots(unpacked) : node->inner_mask, leaves = hits & ~inners;
    if (leaves != 0) {
        const unsigned count =
            is_unpacked ? gather_unpacked(unpacked, leaves, records) : gather_portable(node, leaves, records);
        if ((is_unpacked || count > 0) && !meet_gathered(walk, records, count, is_unpacked, is_swept))
            *ret_is_done = true;
    }
    return hits & inners;
}

/* Pushes all inner children in the slots `inner` but the nearest, which it returns, with the nearest of them on top. */
BOXTEST_AVX2_INLINE uint64_t push_farther(const struct unpacked_node *nodes, uint32_t index, const uint32_t near[SLOTS],
                                          unsigned inner, uint64_t **top)
{
    const uint32_t *children = nodes[index].children;
    uint64_t nearest = to_key(near[_tzcnt_u32(inner)], children[_tzcnt_u32(inner)]), *base = *top;
    while (inner &= inner - 1) {
        const unsigned slot = _tzcnt_u32(inner);
        const uint64_t key = to_key(near[slot], children[slot]), later = nearest > key ? nearest : key;
        uint64_t *at = (*top)++;
        nearest = nearest > key ? key : nearest;
        for (; at > base && at[-1] < later; at--)
            at[0] = at[-1];
        *at = later;
        prefetch_node(&nodes[(uint32_t)later & CHILD_INDEX_MASK]);
    }
    return nearest;
}

BOXTEST_AVX2_INLINE void find_closest_in(struct round_walk *walk, uint32_t start, bool is_unpacked, bool is_swept)
{
    const struct avx2_walk *nodes = &walk->nodes;
    uint64_t stack[AVX2_STACK_SIZE], *top = stack, visited = 0;
    uint32_t child = CHILD_ROOT | start, near[SLOTS];
    bool is_done = false;
    for (;;) {
        const uint32_t index = child & CHILD_INDEX_MASK;
        const unsigned inner = enter_node(walk, index, is_unpacked, is_swept, false, near, &is_done);
        visited++;
        if (is_done)
            break;
        if (inner != 0)
            child =
                (uint32_t)(is_unpacked ? push_farther(nodes->unpacked, index, near, inner, &top)
                                       : push_all_but_nearest(nodes, 0, near, &nodes->view->nodes[index], inner, &top));
        else if (!pop_child(nodes, stack, &top, &child))
            break;
    }
    nodes->state->counters.nodes += visited;
}

/*
 * Finds any hit in an unpacked structure. The child in whose box the ray is longest comes first, since that is where a
 * hit is most likely: rays in hair visit a seventh of the nodes less than in the order of their octant.
 */
BOXTEST_AVX2_INLINE void find_any_in(struct round_walk *walk, bool is_swept)
{
    const struct unpacked_node *nodes = walk->nodes.unpacked;
    uint32_t stack[AVX2_STACK_SIZE], *top = stack, lengths[SLOTS], index = 0;
    uint64_t visited = 0;
    bool is_done = false;
    for (;;) {
        unsigned inner = enter_node(walk, index, true, is_swept, true, lengths, &is_done);
        visited++;
        if (is_done)
            break;
        if (inner == 0) {
            if (top == stack)
                break;
            index = *--top;
            continue;
        }
        const uint32_t *children = nodes[index].children;
        uint64_t best = to_key(lengths[_tzcnt_u32(inner)], children[_tzcnt_u32(inner)]);
        while (inner &= inner - 1) {
            const unsigned slot = _tzcnt_u32(inner);
            const uint64_t key = to_key(lengths[slot], children[slot]);
            *top = (uint32_t)(key > best ? best : key) & CHILD_INDEX_MASK;
            best = key > best ? key : best;
            prefetch_node(&nodes[*top++]);
        }
        index = (uint32_t)best & CHILD_INDEX_MASK;
    }
    walk->nodes.state->counters.nodes += visited;
}

BOXTEST_AVX2 static void find_portable(struct round_walk *walk, bool is_swept)
{
    if (is_swept)
        find_closest_in(walk, 0, false, true);
    else
        find_closest_in(walk, 0, false, false);
}

BOXTEST_AVX2 static void closest_sphere(struct round_walk *walk, uint32_t node)
{
    find_closest_in(walk, node, true, false);
}

BOXTEST_AVX2 static void any_sphere(struct round_walk *walk)
{
    find_any_in(walk, false);
}

BOXTEST_AVX2 static void closest_swept(struct round_walk *walk, uint32_t node)
{
    find_closest_in(walk, node, true, true);
}

BOXTEST_AVX2 static void any_swept(struct round_walk *walk)
{
    find_any_in(walk, true);
}

static bool is_swept(const struct portable_view *view)
{
    return view->header->content == PORTABLE_SWEPT_SPHERES;
}

void round_walk_closest(struct round_walk *walk, uint32_t node)
{
    (is_swept(walk->nodes.view) ? closest_swept : closest_sphere)(walk, node);
}

static void find_unpacked(struct round_walk *walk)
{
    if (walk->nodes.state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        (is_swept(walk->nodes.view) ? any_swept : any_sphere)(walk);
    else
        round_walk_closest(walk, 0);
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

/* Begins a ray in an unpacked structure. */
BOXTEST_AVX2_INLINE void begin_unpacked(struct round_walk *walk, const struct unpacked_node *unpacked)
{
    walk->nodes.unpacked = unpacked;
    walk->nodes.scales = unpacked_scales(&walk->nodes.boxes);
    walk->shapes = unpacked_shapes(walk->nodes.view, unpacked);
}

BOXTEST_AVX2 bool traverse_avx2_round(struct traverse_state *state, const struct portable_view *view,
                                      const struct unpacked_node *unpacked)
{
    struct round_walk walk;
    if (state->options->candidate || !prepare_boxes(state, view->header->bounds, &walk.nodes.boxes))
        return false;
    walk.nodes.state = state;
    walk.nodes.view = view;
    walk.nodes.unpacked = NULL;
    walk.is_prepared = false;
    if (unpacked && avx2_walk_can_unpack(state)) {
        begin_unpacked(&walk, unpacked);
        find_unpacked(&walk);
    } else {
        find_portable(&walk, is_swept(view));
    }
    return true;
}

BOXTEST_AVX2 bool round_walk_begin(struct round_walk *walk, struct traverse_state *state,
                                   const struct portable_view *view, const struct unpacked_node *unpacked)
{
    const struct ray *ray = state->ray;
    if (!setup_floats(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), ray->tmin, view->header->bounds,
                      &walk->nodes.boxes))
        return false;
    walk->nodes.state = state;
    walk->nodes.view = view;
    walk->is_prepared = false;
    begin_unpacked(walk, unpacked);
    return true;
}

BOXTEST_AVX2 bool traverse_avx2_round_plain(struct traverse_state *state, const struct portable_view *view,
                                            const struct unpacked_node *unpacked)
{
    struct round_walk walk;
    if (!round_walk_begin(&walk, state, view, unpacked))
        return false;
    find_unpacked(&walk);
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

bool traverse_avx2_round_plain(struct traverse_state *state, const struct portable_view *view,
                               const struct unpacked_node *unpacked)
{
    return traverse_avx2_round(state, view, unpacked);
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_avx2.c - traces up to eight rays at once through unpacked structures. The rays have one octant: their
 * directions have the same signs. Through motion triangles they have one time. Each of them gets the answer that it
 * gets alone.
 *
 * A node is first tested against the bundle of all rays, eight boxes at a time, and the children that remain against
 * the rays, eight rays at a time. Where few rays are left they go on alone. At an instance the rays that meet it are
 * put into its space, where those of one octant go on together.
 */
#include "builder/traverse/packet_setup.h"

#ifdef BOXTEST_AVX2

/* The kind of structure that a packet walks through. The walk is compiled once for each kind. */
enum packet_kind { PACKET_TRIANGLES, PACKET_MOVING, PACKET_TOP };

enum { ALONE = 1 }; /* up to ALONE rays go on alone; more share steps, since each would have to be prepared again */

/* Returns a node; of motion triangles the one at t = 0, with which it begins. */
BOXTEST_AVX2_INLINE const struct unpacked_node *node_at(const struct packet *packet, uint32_t index,
                                                        enum packet_kind kind)
{
    return kind == PACKET_MOVING ? &packet->moving_nodes[index].start : &packet->nodes[index];
}

/* Returns a row of a node's planes, at the time of the packet. */
BOXTEST_AVX2_INLINE __m256 row_of(const struct packet *packet, const struct unpacked_node *node, uint32_t row,
                                  enum packet_kind kind)
{
    if (kind == PACKET_MOVING)
        return moving_planes_at((const struct unpacked_moving_node *)(const void *)node,
                                row * (uint32_t)sizeof node->planes[0], _mm256_broadcast_ss(&packet->at.end));
    return _mm256_loadu_ps(node->planes[row]);
}

/* The planes of a node's children relative to the origins of the bundle: those that rays meet first, and last. */
struct moved_planes {
    float near[3][8], far[3][8];
};

/* Returns the slots whose boxes the bundle meets, lower bounds of where, and the planes for test_lanes(). */
BOXTEST_AVX2_INLINE unsigned test_bundle(const struct packet *packet, const struct unpacked_node *node,
                                         enum packet_kind kind, uint32_t ret_near[8], struct moved_planes *ret_planes)
{
    __m256 near = _mm256_set1_ps(-INFINITY), far = _mm256_set1_ps(INFINITY);
    for (int axis = 0; axis < 3; axis++) {
        const __m256 least = _mm256_broadcast_ss(&packet->least[axis]),
                     greatest = _mm256_broadcast_ss(&packet->greatest[axis]);
        const __m256 first = _mm256_sub_ps(row_of(packet, node, packet->planes.near[axis], kind),
                                           _mm256_broadcast_ss(&packet->near_origin[axis]));
        const __m256 last = _mm256_sub_ps(row_of(packet, node, packet->planes.far[axis], kind),
                                          _mm256_broadcast_ss(&packet->far_origin[axis]));
        _mm256_storeu_ps(ret_planes->near[axis], first);
        _mm256_storeu_ps(ret_planes->far[axis], last);
        near = _mm256_max_ps(near, _mm256_min_ps(_mm256_mul_ps(first, least), _mm256_mul_ps(first, greatest)));
        far = _mm256_min_ps(far, _mm256_max_ps(_mm256_mul_ps(last, least), _mm256_mul_ps(last, greatest)));
    }
    const __m256 slack = _mm256_broadcast_ss(&packet->bundle_slack);
    near = _mm256_max_ps(_mm256_fmsub_ps(near, _mm256_set1_ps(1 - boxtest_gamma), slack),
                         _mm256_broadcast_ss(&packet->bundle_tmin));
    far = _mm256_fmadd_ps(far, _mm256_set1_ps(1 + boxtest_gamma), slack);
    _mm256_storeu_ps((float *)ret_near, near);
    return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ));
}

/* Returns the lanes that meet a child's box. */
BOXTEST_AVX2_INLINE uint32_t test_lanes(const struct packet *packet, const struct moved_planes *planes, unsigned slot)
{
    __m256 first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = _mm256_fmsub_ps(_mm256_broadcast_ss(&planes->near[axis][slot]), packet->inverse[axis],
                                      packet->near_moved[axis]);
        last[axis] = _mm256_fmsub_ps(_mm256_broadcast_ss(&planes->far[axis][slot]), packet->inverse[axis],
                                     packet->far_moved[axis]);
    }
    __m256 near = _mm256_max_ps(_mm256_max_ps(first[0], first[1]), first[2]),
           far = _mm256_min_ps(_mm256_min_ps(last[0], last[1]), last[2]);
    near = _mm256_max_ps(_mm256_fmsub_ps(near, _mm256_set1_ps(1 - boxtest_gamma), packet->slack), packet->tmin);
    far = _mm256_min_ps(_mm256_fmadd_ps(far, _mm256_set1_ps(1 + boxtest_gamma), packet->slack), packet->tmax);
    return (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ));
}

/* Returns the walk of a lane that goes on alone, prepared when it is first needed. */
BOXTEST_AVX2_INLINE struct avx2_walk *lane_walk(struct packet *packet, unsigned lane, enum packet_kind kind)
{
    struct avx2_walk *walk = &packet->walks[lane];
    if (!(packet->ready >> lane & 1)) {
        packet->ready |= 1u << lane;
        packet->work.cost += COST_ALONE;
        struct traverse_state *state = &packet->states[lane].state;
        if (kind == PACKET_MOVING) {
            moving_walk_init_world(walk, state, packet->view, &packet->moving_nodes->start);
            avx2_walk_init_triangles(walk);
        } else if (packet->object_to_world) {
            traverse_state_to_object(state, packet->object_to_world);
            triangle_ray_init(state->origin, state->direction, &state->triangle_ray);
            avx2_walk_init_object(walk, state, packet->view, packet->nodes);
        } else {
            avx2_walk_init(walk, state, packet->view, packet->nodes);
        }
    }
    return walk;
}

/* Takes the end of a lane's interval from its state, after a hit. */
BOXTEST_AVX2_INLINE void lane_limit(struct packet *packet, unsigned lane)
{
    const struct traverse_state *state = &packet->states[lane].state;
    const __m256 limit = _mm256_set1_ps(state->is_done ? -1 : state->tmax_above);
    packet->tmax = _mm256_blendv_ps(packet->tmax, limit, lane_mask(1u << lane));
    packet->live &= ~((uint32_t)state->is_done << lane);
}

/* The hits of four rays at one triangle. */
struct packet_hits {
    double t[4], u[4], v[4], sum[4];
    uint32_t maybe, is_clear; /* lanes: the ray can meet the triangle; the numbers above are its hit */
};

BOXTEST_AVX2_INLINE __m256d spread(const float *from)
{
    return _mm256_cvtps_pd(_mm_broadcast_ss(from));
}

/* Returns a coordinate of a corner relative to the rays' origins, along the k-th axis in each ray's order. */
BOXTEST_AVX2_INLINE __m256d move_along(const struct packet_triangles *ray, const int *const orders[3], bool is_mixed,
                                       int k, const float *corner)
{
    __m256d at = spread(&corner[orders[0][k]]);
    if (is_mixed)
        at = choose(at, spread(&corner[orders[1][k]]), spread(&corner[orders[2][k]]), ray);
    return _mm256_sub_pd(at, ray->origin[k]);
}

/* Does the work of triangle_avx2_intersect() for four rays and one triangle, with the same operations. */
BOXTEST_AVX2_INLINE void meet_four(const struct packet_triangles *ray, const int *const orders[3], bool is_mixed,
                                   const float *const corners[3], uint32_t lanes, struct packet_hits *ret_hits)
{
    const __m256d sign = _mm256_set1_pd(-0.0);
    __m256d x[3], y[3], z[3], left[3], right[3], below, above;
    for (int k = 0; k < 3; k++) {
        const __m256d depth = move_along(ray, orders, is_mixed, 2, corners[k]);
        x[k] = _mm256_sub_pd(move_along(ray, orders, is_mixed, 0, corners[k]), _mm256_mul_pd(ray->shear[0], depth));
        y[k] = _mm256_sub_pd(move_along(ray, orders, is_mixed, 1, corners[k]), _mm256_mul_pd(ray->shear[1], depth));
        z[k] = _mm256_mul_pd(ray->shear[2], depth);
    }
    below = above = _mm256_setzero_pd();
    __m256d is_signed = _mm256_castsi256_pd(_mm256_set1_epi64x(-1));
    for (int k = 0; k < 3; k++) {
        const int from = (k + 1) % 3, to = (k + 2) % 3;
        left[k] = _mm256_mul_pd(x[to], y[from]);
        right[k] = _mm256_mul_pd(y[to], x[from]);
        const __m256d is_below = _mm256_cmp_pd(left[k], right[k], _CMP_LT_OQ),
                      is_above = _mm256_cmp_pd(left[k], right[k], _CMP_GT_OQ);
        below = _mm256_or_pd(below, is_below);
        above = _mm256_or_pd(above, is_above);
        is_signed = _mm256_and_pd(is_signed, _mm256_or_pd(is_below, is_above));
    }
    ret_hits->maybe = ~(uint32_t)_mm256_movemask_pd(_mm256_and_pd(below, above)) & lanes;
    if (ret_hits->maybe == 0)
        return;
    __m256d edges[3], sizes[3];
    for (int k = 0; k < 3; k++) {
        edges[k] = _mm256_sub_pd(left[k], right[k]);
        sizes[k] = _mm256_add_pd(_mm256_andnot_pd(sign, left[k]), _mm256_andnot_pd(sign, right[k]));
    }
    const __m256d sum = _mm256_add_pd(_mm256_add_pd(edges[0], edges[1]), edges[2]), size = _mm256_andnot_pd(sign, sum),
                  products = _mm256_add_pd(_mm256_add_pd(sizes[0], sizes[1]), sizes[2]);
    const __m256d is_large =
        _mm256_cmp_pd(size, _mm256_mul_pd(_mm256_set1_pd(2 * triangle_cancellation), products), _CMP_GE_OQ);
    const __m256d is_finite = _mm256_cmp_pd(size, _mm256_set1_pd(DBL_MAX), _CMP_LE_OQ);
    ret_hits->is_clear = (uint32_t)_mm256_movemask_pd(_mm256_and_pd(is_signed, _mm256_and_pd(is_large, is_finite)));
    for (int k = 0; k < 3; k++)
        edges[k] = _mm256_div_pd(edges[k], sum);
    _mm256_storeu_pd(ret_hits->t,
                     _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(edges[0], z[0]), _mm256_mul_pd(edges[1], z[1])),
                                   _mm256_mul_pd(edges[2], z[2])));
    _mm256_storeu_pd(ret_hits->u, edges[1]);
    _mm256_storeu_pd(ret_hits->v, edges[2]);
    _mm256_storeu_pd(ret_hits->sum, sum);
}

/*
 * Gives the corners of a triangle, at the packet's time, and returns its id. Those of motion triangles are computed
 * into `room`.
 */
BOXTEST_AVX2_INLINE uint32_t corners_of(const struct packet *packet, uint32_t record, enum packet_kind kind,
                                        float room[3][4], const float *ret_corners[3])
{
    if (kind != PACKET_MOVING)
        return traverse_corners_stored(packet->view, record, ret_corners);
    const struct unpacked_moving_triangle *triangle = &packet->moving_triangles[record];
    for (int k = 0; k < 3; k++) {
        _mm_storeu_ps(room[k], moving_corner_at(triangle, k, packet->at));
        ret_corners[k] = room[k];
    }
    return triangle->id;
}

BOXTEST_AVX2_INLINE void meet_triangle(struct packet *packet, uint32_t record, uint32_t lanes, bool is_mixed,
                                       enum packet_kind kind)
{
    float room[3][4];
    const float *corners[3];
    const uint32_t id = corners_of(packet, record, kind, room, corners);
    packet->work.counters.triangles += (unsigned)__builtin_popcount(lanes);
    for (unsigned half = 0; half < 2; half++) {
        struct packet_hits hits;
        if (!(lanes >> 4 * half & 15))
            continue;
        meet_four(&packet->triangles[half], packet->orders, is_mixed, corners, lanes >> 4 * half & 15, &hits);
        for (uint32_t rest = hits.maybe; rest != 0; rest &= rest - 1) {
            const unsigned at = (unsigned)__builtin_ctz(rest), lane = 4 * half + at;
            struct traverse_state *state = &packet->states[lane].state;
            struct triangle_hit hit = {hits.t[at], hits.u[at], hits.v[at], hits.sum[at] > 0};
            if (__builtin_expect(!(hits.is_clear >> at & 1), 0) &&
                !triangle_intersect(&lane_walk(packet, lane, kind)->state->triangle_ray, corners[0], corners[1],
                                    corners[2], &hit))
                continue;
            if (!(hit.t > state->ray->tmin && hit.t <= state->tmax))
                continue;
            traverse_leaf_hit(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, &hit);
            lane_limit(packet, lane);
        }
    }
}

BOXTEST_AVX2_INLINE void meet_records(struct packet *packet, uint32_t child, uint32_t lanes, bool is_mixed,
                                      enum packet_kind kind)
{
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t i = 0; i < count && lanes != 0; i++, lanes &= packet->live)
        meet_triangle(packet, first + i, lanes, is_mixed, kind);
}

/* Tests the triangles of a leaf. It is compiled once for each value of is_mixed. */
BOXTEST_AVX2_INLINE void meet_leaf(struct packet *packet, uint32_t child, uint32_t lanes, enum packet_kind kind)
{
    if (packet->is_mixed)
        meet_records(packet, child, lanes, true, kind);
    else
        meet_records(packet, child, lanes, false, kind);
}

/* A child with the lanes that meet it, and their least distance in the highest bits. */
BOXTEST_AVX2_INLINE uint64_t pack(uint32_t near, uint32_t lanes, uint32_t child)
{
    return (uint64_t)((near & ~UINT32_C(0xff)) | lanes) << 32 | child;
}

BOXTEST_AVX2_INLINE void prefetch_child(const struct packet *packet, uint32_t child, enum packet_kind kind)
{
    const bool is_node = child >= CHILD_ROOT, moves = kind == PACKET_MOVING;
    const uintptr_t node_size = moves ? sizeof *packet->moving_nodes : sizeof *packet->nodes;
    const uintptr_t record_size = moves ? sizeof *packet->moving_triangles : packet->record_size;
    const void *nodes = moves ? (const void *)packet->moving_nodes : packet->nodes;
    const void *records = moves ? (const void *)packet->moving_triangles : packet->view->records;
    const uintptr_t size = is_node ? node_size : record_size, index = child & CHILD_INDEX_MASK;
    const uintptr_t at = (uintptr_t)(is_node ? nodes : records) + size * index;
    for (unsigned line = 0; line < 4; line++)
        __builtin_prefetch((const void *)(at + 64 * line));
}

/* Counts the visit of a node by lanes. */
BOXTEST_AVX2_INLINE void count_step(struct packet *packet, uint32_t lanes)
{
    packet->work.counters.nodes += (unsigned)__builtin_popcount(lanes);
    packet->work.cost += packet->step_cost;
}

BOXTEST_AVX2 static void meet_instances(struct packet *packet, uint32_t child, uint32_t lanes);

BOXTEST_AVX2_INLINE void meet(struct packet *packet, uint32_t child, uint32_t lanes, enum packet_kind kind)
{
    if (kind == PACKET_TOP)
        meet_instances(packet, child, lanes);
    else
        meet_leaf(packet, child, lanes, kind);
}

/*
 * Finds the closest hits: children nearest first, by the distance of the bundle. It is compiled once for each value of
 * kind.
 */
BOXTEST_AVX2_INLINE void find_closest(struct packet *packet, uint32_t lanes, enum packet_kind kind)
{
    uint64_t stack[AVX2_STACK_SIZE], *top = stack;
    uint32_t child = CHILD_ROOT;
    for (;;) {
        if (child < CHILD_ROOT) {
            meet(packet, child, lanes, kind);
        } else if (kind != PACKET_TOP && __builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                unsigned lane = (unsigned)__builtin_ctz(lanes);
                (kind == PACKET_MOVING ? moving_walk_closest : avx2_walk_closest)(lane_walk(packet, lane, kind), child);
                lane_limit(packet, lane);
            }
        } else {
            const struct unpacked_node *node = node_at(packet, child & CHILD_INDEX_MASK, kind);
            struct moved_planes planes;
            uint32_t near[8];
            unsigned slots = test_bundle(packet, node, kind, near, &planes);
            uint64_t *base = top;
            count_step(packet, lanes);
            for (; slots != 0; slots &= slots - 1) {
                unsigned slot = (unsigned)__builtin_ctz(slots);
                uint32_t met = test_lanes(packet, &planes, slot) & lanes;
                if (met == 0)
                    continue;
                uint64_t entry = pack(near[slot], met, node->children[slot]), *at = top++;
                for (; at > base && at[-1] < entry; at--)
                    at[0] = at[-1];
                *at = entry;
                prefetch_child(packet, node->children[slot], kind);
            }
        }
        do {
            if (top == stack)
                return;
            top--;
            uint32_t bits = (uint32_t)(*top >> 32) & ~UINT32_C(0xff);
            __m256 near = _mm256_castsi256_ps(_mm256_set1_epi32((int)bits));
            lanes = (uint32_t)(*top >> 32) & 0xff &
                    (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(near, packet->tmax, _CMP_LE_OQ));
            child = (uint32_t)*top;
        } while (lanes == 0);
    }
}

/*
 * Finds any hits in the order of avx2_walk_any() and traverse_avx2_any_instances(), which depends on the octant alone:
 * so each ray finds the hit that it finds alone. It is compiled once for each kind.
 */
BOXTEST_AVX2_INLINE void find_any(struct packet *packet, uint32_t root_lanes, enum packet_kind kind)
{
    uint64_t stack[AVX2_STACK_SIZE], *top = stack;
    *top++ = (uint64_t)root_lanes << 32;
    while (top > stack) {
        top--;
        uint32_t lanes = (uint32_t)(*top >> 32) & packet->live, index = (uint32_t)*top;
        if (kind != PACKET_TOP && __builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                unsigned lane = (unsigned)__builtin_ctz(lanes);
                (kind == PACKET_MOVING ? moving_walk_any : avx2_walk_any)(lane_walk(packet, lane, kind), index);
                lane_limit(packet, lane);
            }
            continue;
        }
        const struct unpacked_node *node = node_at(packet, index, kind);
        struct moved_planes planes;
        uint32_t met[8], near[8];
        unsigned slots = test_bundle(packet, node, kind, near, &planes);
        count_step(packet, lanes);
        unsigned inner = 0;
        for (; slots != 0; slots &= slots - 1) {
            unsigned slot = (unsigned)__builtin_ctz(slots);
            met[slot] = test_lanes(packet, &planes, slot) & lanes & packet->live;
            if (met[slot] == 0)
                continue;
            if (node->children[slot] < CHILD_ROOT)
                meet(packet, node->children[slot], met[slot], kind);
            else
                inner |= 1u << slot;
        }
        for (unsigned i = 0; inner != 0 && i < 8; i++) {
            unsigned slot = i ^ packet->backward;
            if (inner >> slot & 1)
                *top++ = (uint64_t)met[slot] << 32 | (node->children[slot] & CHILD_INDEX_MASK);
        }
    }
}

BOXTEST_AVX2 static void packet_walk(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_TRIANGLES);
    else
        find_closest(packet, lanes, PACKET_TRIANGLES);
}

/* Adds the work of a packet to other work. */
static void count(const struct packet *packet, struct packet_work *work)
{
    work->counters.nodes += packet->work.counters.nodes;
    work->counters.triangles += packet->work.counters.triangles;
    work->counters.instances += packet->work.counters.instances;
    work->cost += packet->work.cost;
}

/* Starts a packet in a structure. Its rays are missing. */
BOXTEST_AVX2_INLINE void packet_begin(struct packet *packet, struct traverse_walk *states,
                                      const struct portable_view *view, const struct unpacked_node *nodes)
{
    packet->states = states;
    packet->view = view;
    packet->nodes = nodes;
    packet->record_size = view->header->content == PORTABLE_INSTANCES ? sizeof(struct portable_instance)
                                                                      : sizeof(struct portable_triangle);
    packet->step_cost = COST_STEP;
    packet->work = (struct packet_work){.cost = 0};
    packet->ready = 0;
}

/* Does what is left to start a packet of rays with one time in motion triangles. */
BOXTEST_AVX2_INLINE void packet_begin_moving(struct packet *packet, float time)
{
    packet->moving_nodes = (const struct unpacked_moving_node *)(const void *)packet->nodes;
    packet->moving_triangles = unpacked_moving_triangles(packet->view, packet->moving_nodes);
    packet->at = motion_weights_at(time);
}

/* Returns those of the lanes whose rays see an instance with this mask. */
static uint32_t lanes_that_see(const struct packet *packet, uint32_t lanes, uint32_t mask)
{
    uint32_t seeing = 0;
    for (uint32_t rest = lanes; rest != 0; rest &= rest - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(rest);
        seeing |= (uint32_t)((packet->states[lane].state.ray->cull_mask & mask) != 0) << lane;
    }
    return seeing;
}

/* Traces lanes through an instance one by one. */
BOXTEST_AVX2 static void meet_instance_alone(struct packet *packet, uint32_t row, uint32_t lanes)
{
    for (; lanes != 0; lanes &= lanes - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(lanes);
        traverse_walk_instance(&packet->states[lane], row);
        lane_limit(packet, lane);
    }
}

/* Tells the states of lanes in which instance their next hits are. */
static void enter_instance(struct packet *packet, const struct traverse_instance *instance, uint32_t lanes)
{
    packet->work.counters.instances += (unsigned)__builtin_popcount(lanes);
    for (; lanes != 0; lanes &= lanes - 1)
        traverse_state_settle(&packet->states[__builtin_ctz(lanes)].state, instance, RAY_SKIP_TRIANGLES, true);
}

/* Traces lanes through an instance of triangles together. */
BOXTEST_AVX2 static void meet_instance_together(struct packet *packet, const struct traverse_instance *instance,
                                                uint32_t lanes)
{
    const struct traverse_walk *first = &packet->states[__builtin_ctz(lanes)];
    const struct scene *scene = first->scene;
    const struct portable_instance *record = (const struct portable_instance *)scene->top->records + instance->record;
    const bool is_any = first->state.ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
    struct packet inner;
    packet_begin(&inner, packet->states, scene->bottoms[instance->bottom], scene->unpacked[instance->bottom]);
    packet_to_object(&inner, packet, record->object_to_world);
    const uint32_t entered = packet_init(&inner, lanes);
    inner.live = entered;
    meet_instance_alone(packet, instance->record, lanes & ~entered);
    enter_instance(&inner, instance, entered);
    for (uint32_t rest = entered, same; rest != 0; rest &= ~same) {
        same = packet_octant(&inner, rest);
        packet_bundle(&inner, same);
        packet_triangles_init(&inner, same);
        packet_walk(&inner, same, is_any);
    }
    packet->tmax = _mm256_blendv_ps(packet->tmax, inner.tmax, lane_mask(entered));
    packet->live &= ~(entered & ~inner.live);
    count(&inner, &packet->work);
}

BOXTEST_AVX2 static void meet_instance(struct packet *packet, uint32_t row, uint32_t lanes)
{
    const struct scene *scene = packet->states[__builtin_ctz(lanes)].scene;
    const struct portable_instance *record = (const struct portable_instance *)scene->top->records + row;
    const uint32_t bottom = scene->rows ? scene->rows[record->handle] : record->handle;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    if (bottom >= scene->bottom_count || !scene->bottoms[bottom])
        return;
    lanes = lanes_that_see(packet, lanes, record->custom_and_mask >> 24);
    const bool is_unpacked = scene->unpacked[bottom] && scene->bottoms[bottom]->header->content == PORTABLE_TRIANGLES;
    if (__builtin_popcount(lanes) <= ALONE || !is_unpacked)
        meet_instance_alone(packet, row, lanes);
    else
        meet_instance_together(packet, &instance, lanes);
}

BOXTEST_AVX2 static void meet_instances(struct packet *packet, uint32_t child, uint32_t lanes)
{
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t i = 0; i < count && lanes != 0; i++, lanes &= packet->live)
        meet_instance(packet, first + i, lanes);
}

BOXTEST_AVX2 static void packet_walk_moving(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_MOVING);
    else
        find_closest(packet, lanes, PACKET_MOVING);
}

BOXTEST_AVX2 static void packet_walk_top(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_TOP);
    else
        find_closest(packet, lanes, PACKET_TOP);
}

BOXTEST_AVX2 uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[LANES],
                                        uint32_t lanes, const struct scene *scene, struct packet_work *work)
{
    const bool is_top = scene->top != NULL, is_any = rays[0]->flags & RAY_TERMINATE_ON_FIRST_HIT;
    struct packet packet;
    packet_begin(&packet, states, is_top ? scene->top : scene->bottoms[0],
                 is_top ? scene->unpacked_top : scene->unpacked[0]);
    const bool moves = packet.view->header->content == PORTABLE_MOVING_TRIANGLES;
    if (moves)
        packet_begin_moving(&packet, rays[0]->time);
    packet_to_world(&packet, rays);
    lanes = packet_init(&packet, lanes);
    if (lanes == 0)
        return 0;
    packet.live = lanes;
    packet.tmax = _mm256_blendv_ps(_mm256_set1_ps(-1), packet.tmax, lane_mask(lanes));
    if (moves)
        packet_widen(&packet);
    packet_bundle(&packet, lanes);
    if (is_top) {
        packet_walk_top(&packet, lanes, is_any);
    } else {
        packet_triangles_init(&packet, lanes);
        (moves ? packet_walk_moving : packet_walk)(&packet, lanes, is_any);
    }
    count(&packet, work);
    return lanes;
}

#else

uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[8], uint32_t lanes,
                           const struct scene *scene, struct packet_work *work)
{
    (void)states;
    (void)rays;
    (void)lanes;
    (void)scene;
    (void)work;
    return 0;
}

#endif

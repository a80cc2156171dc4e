/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_avx2.c - traces up to eight rays at once through unpacked structures. The rays have one octant: their
 * directions have the same signs. Through what moves they may have one time or several. Each of them gets the
 * answer that it gets alone.
 *
 * A node is first tested against the bundle of all rays, eight boxes at a time, and the children that remain against
 * the rays, eight rays at a time. Where few rays are left they go on alone. At an instance the rays that meet it are
 * put into its space, where those of one octant go on together.
 */
#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/packet_instances.h"
#include "builder/traverse/packet_round.h"
#include "builder/traverse/packet_triangle.h"

#ifdef BOXTEST_AVX2

enum { ALONE = 1 }; /* up to ALONE rays go on alone; more share steps, since each would have to be prepared again */

/* Returns a node; of motion triangles the one at t = 0, with which it begins. */
BOXTEST_AVX2_INLINE const struct unpacked_node *node_at(const struct packet *packet, uint32_t index,
                                                        enum packet_kind kind)
{
    return kind_moves(kind) ? &packet->moving_nodes[index].start : &packet->nodes[index];
}

/* Returns a row of a node's planes, at the time of the packet if it has one, else at t = 0. */
BOXTEST_AVX2_INLINE __m256 row_of(const struct packet *packet, const struct unpacked_node *node, uint32_t row,
                                  enum packet_kind kind)
{
    if (kind == PACKET_MOVING || kind == PACKET_MOVING_TOP)
        return moving_planes_at((const struct unpacked_moving_node *)(const void *)node,
                                row * (uint32_t)sizeof node->planes[0], _mm256_broadcast_ss(&packet->at.end));
    return _mm256_loadu_ps(node->planes[row]);
}

/*
 * The planes of a node's children relative to the origins of the bundle: those that rays meet first, and last. For rays
 * of different times they are those at t = 0.
 */
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
        if (kind_has_times(kind)) {
            const struct unpacked_moving_node *moving = (const struct unpacked_moving_node *)(const void *)node;
            const __m256 first_moved = _mm256_loadu_ps(moving->moved[packet->planes.near[axis]]),
                         last_moved = _mm256_loadu_ps(moving->moved[packet->planes.far[axis]]);
            near = _mm256_max_ps(near, times_multiply(&packet->times, first, first_moved, least, greatest).least);
            far = _mm256_min_ps(far, times_multiply(&packet->times, last, last_moved, least, greatest).greatest);
            continue;
        }
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
BOXTEST_AVX2_INLINE uint32_t test_lanes(const struct packet *packet, const struct unpacked_node *node,
                                        const struct moved_planes *planes, unsigned slot, enum packet_kind kind)
{
    const struct unpacked_moving_node *moving = (const struct unpacked_moving_node *)(const void *)node;
    __m256 first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        const float *near_plane = &planes->near[axis][slot], *far_plane = &planes->far[axis][slot];
        __m256 near_at, far_at;
        if (kind_has_times(kind)) {
            near_at = times_plane(&packet->times, near_plane, &moving->moved[packet->planes.near[axis]][slot]);
            far_at = times_plane(&packet->times, far_plane, &moving->moved[packet->planes.far[axis]][slot]);
        } else {
            near_at = _mm256_broadcast_ss(near_plane);
            far_at = _mm256_broadcast_ss(far_plane);
        }
        first[axis] = _mm256_fmsub_ps(near_at, packet->inverse[axis], packet->near_moved[axis]);
        last[axis] = _mm256_fmsub_ps(far_at, packet->inverse[axis], packet->far_moved[axis]);
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
        if (kind_moves(kind)) {
            moving_walk_init_world(walk, state, packet->view, &packet->moving_nodes->start);
            avx2_walk_init_triangles(walk);
        } else if (packet->object_to_world) {
            traverse_state_to_object(state, packet->object_to_world + lane * packet->matrix_step);
            triangle_ray_init(state->origin, state->direction, &state->triangle_ray);
            avx2_walk_init_object(walk, state, packet->view, packet->nodes);
        } else {
            avx2_walk_init(walk, state, packet->view, packet->nodes);
        }
    }
    return walk;
}

/*
 * Gives the corners of a triangle, if all rays have them, and returns its id. Those of motion triangles are computed
 * into `room`.
 */
BOXTEST_AVX2_INLINE uint32_t corners_of(const struct packet *packet, uint32_t record, enum packet_kind kind,
                                        float room[3][4], const float *ret_corners[3])
{
    if (!kind_moves(kind))
        return traverse_corners_stored(packet->view, record, ret_corners);
    const struct unpacked_moving_triangle *triangle = &packet->moving_triangles[record];
    for (int k = 0; k < 3; k++) {
        if (kind == PACKET_MOVING)
            _mm_storeu_ps(room[k], moving_corner_at(triangle, k, packet->at));
        ret_corners[k] = room[k];
    }
    return triangle->id;
}

BOXTEST_AVX2_INLINE void meet_triangle(struct packet *packet, uint32_t record, uint32_t lanes, bool is_mixed,
                                       enum packet_kind kind)
{
    float room[3][4];
    struct packet_corners corners;
    const uint32_t id = corners_of(packet, record, kind, room, corners.corners);
    packet->work.counters.triangles += (unsigned)__builtin_popcount(lanes);
    for (unsigned half = 0; half < 2; half++) {
        struct packet_hits hits;
        if (!(lanes >> 4 * half & 15))
            continue;
        if (kind == PACKET_TIMES)
            times_corners_init(&packet->times, (int)half, &packet->moving_triangles[record], &corners.times);
        meet_four(&packet->triangles[half], packet->orders, is_mixed, &corners, lanes >> 4 * half & 15, kind, &hits);
        for (uint32_t rest = hits.maybe; rest != 0; rest &= rest - 1) {
            const unsigned at = (unsigned)__builtin_ctz(rest), lane = 4 * half + at;
            struct traverse_state *state = &packet->states[lane].state;
            struct triangle_hit hit = {hits.t[at], hits.u[at], hits.v[at], hits.sum[at] > 0};
            if (__builtin_expect(!(hits.is_clear >> at & 1), 0)) {
                if (kind == PACKET_TIMES)
                    times_corners_of(&corners.times, at, room);
                if (!triangle_intersect(&lane_walk(packet, lane, kind)->state->triangle_ray, corners.corners[0],
                                        corners.corners[1], corners.corners[2], &hit))
                    continue;
            }
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
    const bool is_node = child >= CHILD_ROOT, moves = kind_moves(kind), has_corners = moves && !kind_is_top(kind);
    const uintptr_t node_size = moves ? sizeof *packet->moving_nodes : sizeof *packet->nodes;
    const uintptr_t record_size = has_corners ? sizeof *packet->moving_triangles : packet->record_size;
    const void *nodes = moves ? (const void *)packet->moving_nodes : packet->nodes;
    const void *records = has_corners           ? (const void *)packet->moving_triangles
                          : kind_is_round(kind) ? packet->round->shapes
                                                : packet->view->records;
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

BOXTEST_AVX2_INLINE void meet(struct packet *packet, uint32_t child, uint32_t lanes, enum packet_kind kind)
{
    if (kind_is_top(kind))
        packet_instances_meet(packet, child, lanes);
    else if (kind_is_round(kind))
        packet_round_leaf(packet, child, lanes, kind == PACKET_SWEPT);
    else
        meet_leaf(packet, child, lanes, kind);
}

/* Goes on with a lane alone from a child on, which is a node. */
BOXTEST_AVX2_INLINE void go_alone(struct packet *packet, unsigned lane, uint32_t child, bool is_any,
                                  enum packet_kind kind)
{
    if (kind_is_round(kind)) {
        round_walk_closest(packet_round_walk(packet, packet->round, lane), child & CHILD_INDEX_MASK);
    } else if (is_any) {
        (kind_moves(kind) ? moving_walk_any : avx2_walk_any)(lane_walk(packet, lane, kind), child);
    } else {
        (kind_moves(kind) ? moving_walk_closest : avx2_walk_closest)(lane_walk(packet, lane, kind), child);
    }
    lane_limit(packet, lane);
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
        } else if (!kind_is_top(kind) && __builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                go_alone(packet, (unsigned)__builtin_ctz(lanes), child, false, kind);
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
                uint32_t met = test_lanes(packet, node, &planes, slot, kind) & lanes;
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
        if (!kind_is_top(kind) && __builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                go_alone(packet, (unsigned)__builtin_ctz(lanes), index, true, kind);
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
            met[slot] = test_lanes(packet, node, &planes, slot, kind) & lanes & packet->live;
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

BOXTEST_AVX2 static void packet_walk_moving(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_MOVING);
    else
        find_closest(packet, lanes, PACKET_MOVING);
}

BOXTEST_AVX2 static void packet_walk_times(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_TIMES);
    else
        find_closest(packet, lanes, PACKET_TIMES);
}

BOXTEST_AVX2 static void packet_walk_top(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_TOP);
    else
        find_closest(packet, lanes, PACKET_TOP);
}

BOXTEST_AVX2 static void packet_walk_moving_top(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_MOVING_TOP);
    else
        find_closest(packet, lanes, PACKET_MOVING_TOP);
}

BOXTEST_AVX2 static void packet_walk_times_top(struct packet *packet, uint32_t lanes, bool is_any)
{
    if (is_any)
        find_any(packet, lanes, PACKET_TIMES_TOP);
    else
        find_closest(packet, lanes, PACKET_TIMES_TOP);
}

BOXTEST_AVX2 static void packet_walk_spheres(struct packet *packet, uint32_t lanes)
{
    find_closest(packet, lanes, PACKET_SPHERES);
}

BOXTEST_AVX2 static void packet_walk_swept(struct packet *packet, uint32_t lanes)
{
    find_closest(packet, lanes, PACKET_SWEPT);
}

/* Does what is left to trace a packet through a round kind, of which the bundle is ready. */
__attribute__((noinline)) BOXTEST_AVX2 static void trace_round(struct packet *packet, uint32_t lanes)
{
    const bool is_swept = packet->view->header->content == PORTABLE_SWEPT_SPHERES;
    struct packet_round round;
    packet_round_begin(packet, lanes, is_swept, &round);
    (is_swept ? packet_walk_swept : packet_walk_spheres)(packet, lanes);
}

/* Puts the rays of a packet that has begun into its lanes. Returns the lanes that can go on. */
BOXTEST_AVX2_INLINE uint32_t packet_take(struct packet *packet, const struct ray *const rays[LANES], uint32_t lanes)
{
    packet_to_world(packet, rays);
    lanes = packet_init(packet, lanes);
    packet->live = lanes;
    packet->tmax = _mm256_blendv_ps(_mm256_set1_ps(-1), packet->tmax, lane_mask(lanes));
    return lanes;
}

/* Traces a packet through motion triangles, or motion instances. */
BOXTEST_AVX2 static uint32_t trace_moving(struct traverse_walk *states, const struct ray *const rays[LANES],
                                          uint32_t lanes, const struct scene *scene, struct packet_work *work)
{
    const bool is_top = scene->top != NULL, is_any = rays[0]->flags & RAY_TERMINATE_ON_FIRST_HIT;
    struct packet packet;
    packet_begin(&packet, states, is_top ? scene->top : scene->bottoms[0],
                 is_top ? scene->unpacked_top : scene->unpacked[0]);
    packet.moving_nodes = (const struct unpacked_moving_node *)(const void *)packet.nodes;
    packet.moving_triangles = unpacked_moving_triangles(packet.view, packet.moving_nodes);
    packet.at = motion_weights_at(rays[0]->time);
    packet.have_times = times_init(&packet.times, rays);
    lanes = packet_take(&packet, rays, lanes);
    if (lanes == 0)
        return 0;
    packet_widen(&packet);
    packet_bundle(&packet, lanes);
    if (packet.have_times)
        times_widen(&packet, lanes);
    if (is_top) {
        packet.record_size = sizeof(struct portable_moving_instance);
        (packet.have_times ? packet_walk_times_top : packet_walk_moving_top)(&packet, lanes, is_any);
    } else {
        packet_triangles_init(&packet, lanes);
        packet.step_cost += packet.have_times ? COST_TIMES : 0;
        (packet.have_times ? packet_walk_times : packet_walk_moving)(&packet, lanes, is_any);
    }
    packet_count(&packet, work);
    return lanes;
}

BOXTEST_AVX2 uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[LANES],
                                        uint32_t lanes, const struct scene *scene, struct packet_work *work)
{
    const bool is_top = scene->top != NULL, is_any = rays[0]->flags & RAY_TERMINATE_ON_FIRST_HIT;
    struct packet packet;
    if (leaf_kind_of(is_top ? scene->top : scene->bottoms[0])->moves)
        return trace_moving(states, rays, lanes, scene, work);
    packet_begin(&packet, states, is_top ? scene->top : scene->bottoms[0],
                 is_top ? scene->unpacked_top : scene->unpacked[0]);
    lanes = packet_take(&packet, rays, lanes);
    if (lanes == 0)
        return 0;
    packet_bundle(&packet, lanes);
    if (is_top) {
        packet.record_size = sizeof(struct portable_instance);
        packet_walk_top(&packet, lanes, is_any);
    } else if (leaf_kind_of(packet.view)->shape_floats != 0) {
        trace_round(&packet, lanes);
    } else {
        packet_triangles_init(&packet, lanes);
        packet_walk(&packet, lanes, is_any);
    }
    packet_count(&packet, work);
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

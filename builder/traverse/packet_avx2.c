/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_avx2.c - traces up to eight rays at once through an unpacked structure of triangles. The rays have one octant:
 * their directions have the same signs. Each of them gets the answer that it gets alone.
 *
 * A node is first tested against the bundle of all rays, eight boxes at a time, and the children that remain against
 * the rays, eight rays at a time. Where few rays are left they go on alone.
 *
 * The error bounds are those of boxtest.h, with the largest slack of the axes. A ray meets a plane at p * inverse -
 * origin * inverse, computed with one fused operation. With u = 2^-24 the reciprocal is off by u, the second product by
 * u and the difference by u, so that the distance is off by 2u of itself and u |origin * inverse|: the slack has 2u of
 * the latter, and 8u of the distance are allowed for, which covers the roundings of these sums too. The test of the
 * bundle computes (p - origin) * inverse at the ends of the intervals of origins and reciprocals, between which the
 * products of all rays lie; its error is at most 3u of the distance.
 */
#include "builder/traverse/avx2_walk.h"
#include "builder/traverse/traverse_group.h"

#ifdef BOXTEST_AVX2

enum { LANES = 8, ALONE = 2 }; /* up to ALONE rays go on alone */

/* Four of the rays as struct triangle_ray has one. */
struct packet_triangles {
    __m256d origin[3], shear[3];
    __m256d is_y, is_z; /* the lanes whose main axis is y, or z */
};

/* Some rays, each in a lane of vectors of eight. */
struct packet {
    struct packet_triangles triangles[2];
    const int *orders[3]; /* the axes in the order of triangle_ray, by main axis */
    bool is_mixed; /* the rays have several main axes; else all orders are the same */
    uint32_t triangle_count;
    __m256 origin[3], inverse[3], moved[3]; /* moved is origin * inverse */
    __m256 tmin, tmax, slack;
    struct boxtest_planes planes;
    uint32_t backward;
    /* The bundle: the origins that make near and far planes come nearest and farthest, and the ends of the rest. */
    float near_origin[3], far_origin[3], least[3], greatest[3];
    float bundle_tmin, bundle_slack;
    uint32_t ready; /* the lanes whose walks are prepared */
    uint32_t live; /* the lanes whose rays are not finished */
    bool is_indexed;
    uint32_t record_size;
    const struct portable_view *view;
    const struct unpacked_node *nodes;
    uint32_t visited;
    struct traverse_walk *states;
    struct avx2_walk walks[LANES];
};

BOXTEST_AVX2_INLINE float least_lane(__m256 vector)
{
    __m128 half = _mm_min_ps(_mm256_castps256_ps128(vector), _mm256_extractf128_ps(vector, 1));
    half = _mm_min_ps(half, _mm_movehl_ps(half, half));
    return _mm_cvtss_f32(_mm_min_ss(half, _mm_movehdup_ps(half)));
}

BOXTEST_AVX2_INLINE float greatest_lane(__m256 vector)
{
    __m128 half = _mm_max_ps(_mm256_castps256_ps128(vector), _mm256_extractf128_ps(vector, 1));
    half = _mm_max_ps(half, _mm_movehl_ps(half, half));
    return _mm_cvtss_f32(_mm_max_ss(half, _mm_movehdup_ps(half)));
}

/* Turns the first eight floats of eight rays into eight vectors of one component each. */
BOXTEST_AVX2_INLINE void transpose(const struct ray *const rays[LANES], __m256 ret_components[8])
{
    __m256 row[8], pair[8], quad[8];
    for (int i = 0; i < 8; i++)
        row[i] = _mm256_loadu_ps(rays[i]->origin);
    for (int i = 0; i < 4; i++) {
        pair[2 * i] = _mm256_unpacklo_ps(row[2 * i], row[2 * i + 1]);
        pair[2 * i + 1] = _mm256_unpackhi_ps(row[2 * i], row[2 * i + 1]);
    }
    for (int i = 0; i < 2; i++) {
        quad[4 * i] = _mm256_shuffle_ps(pair[4 * i], pair[4 * i + 2], 0x44);
        quad[4 * i + 1] = _mm256_shuffle_ps(pair[4 * i], pair[4 * i + 2], 0xee);
        quad[4 * i + 2] = _mm256_shuffle_ps(pair[4 * i + 1], pair[4 * i + 3], 0x44);
        quad[4 * i + 3] = _mm256_shuffle_ps(pair[4 * i + 1], pair[4 * i + 3], 0xee);
    }
    for (int i = 0; i < 4; i++) {
        ret_components[i] = _mm256_permute2f128_ps(quad[i], quad[4 + i], 0x20);
        ret_components[4 + i] = _mm256_permute2f128_ps(quad[i], quad[4 + i], 0x31);
    }
}

BOXTEST_AVX2_INLINE __m256 absolute_lanes(__m256 vector)
{
    return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), vector);
}

/* Prepares the rays; returns the lanes for which float tests can be trusted and no axis is parallel. */
BOXTEST_AVX2_INLINE uint32_t packet_init(struct packet *packet, __m256 components[8], uint32_t lanes)
{
    const float *bounds = packet->view->header->bounds;
    __m256 speed = _mm256_setzero_ps(), reach = _mm256_setzero_ps(), at_axis = _mm256_setzero_ps();
    __m256 moved = _mm256_setzero_ps();
    __m256 sizes = _mm256_setzero_ps(), shortest = _mm256_set1_ps(INFINITY);
    float corner = 0;
    for (int axis = 0; axis < 3; axis++) {
        const __m256 origin = components[axis], direction = components[4 + axis], size = absolute_lanes(direction);
        const __m256 inverse = _mm256_div_ps(_mm256_set1_ps(1), direction);
        const __m256 distance = _mm256_max_ps(absolute_lanes(_mm256_sub_ps(_mm256_set1_ps(bounds[axis]), origin)),
                                              absolute_lanes(_mm256_sub_ps(_mm256_set1_ps(bounds[3 + axis]), origin)));
        corner = greater(greater(corner, fabsf(bounds[axis])), fabsf(bounds[3 + axis]));
        sizes = _mm256_castsi256_ps(
            _mm256_max_epi32(_mm256_castps_si256(sizes),
                             _mm256_max_epi32(_mm256_castps_si256(absolute_lanes(origin)), _mm256_castps_si256(size))));
        speed = _mm256_max_ps(speed, size);
        shortest = _mm256_min_ps(shortest, size);
        reach = _mm256_max_ps(reach, distance);
        at_axis = _mm256_max_ps(at_axis, _mm256_mul_ps(distance, absolute_lanes(inverse)));
        packet->origin[axis] = origin;
        packet->inverse[axis] = inverse;
        packet->moved[axis] = _mm256_mul_ps(origin, inverse);
        moved = _mm256_max_ps(moved, absolute_lanes(packet->moved[axis]));
    }
    packet->tmin = components[3];
    if (!(corner >= (float)structure_min && corner <= (float)range_max))
        return 0;
    const __m256 fits = _mm256_castsi256_ps(_mm256_cmpgt_epi32(
        _mm256_castps_si256(_mm256_set1_ps(nextafterf((float)range_max, INFINITY))), _mm256_castps_si256(sizes)));
    const __m256 is_fast = _mm256_cmp_ps(speed, _mm256_set1_ps((float)direction_min), _CMP_GE_OQ);
    const __m256 is_oblique =
        _mm256_cmp_ps(shortest, _mm256_mul_ps(speed, _mm256_set1_ps((float)parallel_ratio)), _CMP_GE_OQ);
    lanes &= (uint32_t)_mm256_movemask_ps(_mm256_and_ps(fits, _mm256_and_ps(is_fast, is_oblique)));
    const __m256 t_reach = _mm256_div_ps(reach, speed);
    const __m256 slack =
        _mm256_fmadd_ps(t_reach, _mm256_set1_ps((float)(1.001 * t_error)), _mm256_set1_ps((float)underflow_error));
    packet->slack = _mm256_fmadd_ps(at_axis, _mm256_set1_ps((float)(1.001 * corner_error)),
                                    _mm256_fmadd_ps(moved, _mm256_set1_ps(0x1p-23f), slack));
    return lanes;
}

static const uint32_t lane_bits[LANES] __attribute__((aligned(32))) = {1, 2, 4, 8, 16, 32, 64, 128};

/* Returns a vector that is all ones in the lanes. */
BOXTEST_AVX2_INLINE __m256 lane_mask(uint32_t lanes)
{
    const __m256i bits = _mm256_load_si256((const __m256i *)(const void *)lane_bits);
    return _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32((int)lanes), bits), bits));
}

/* Finds the bundle around the lanes. */
BOXTEST_AVX2_INLINE void packet_bundle(struct packet *packet, uint32_t lanes)
{
    const __m256 mask = lane_mask(lanes), low = _mm256_set1_ps(-INFINITY), high = _mm256_set1_ps(INFINITY);
    packet->backward = (uint32_t)(_mm256_movemask_ps(packet->inverse[0]) >> __builtin_ctz(lanes) & 1) |
                       (uint32_t)(_mm256_movemask_ps(packet->inverse[1]) >> __builtin_ctz(lanes) & 1) << 1 |
                       (uint32_t)(_mm256_movemask_ps(packet->inverse[2]) >> __builtin_ctz(lanes) & 1) << 2;
    for (int axis = 0; axis < 3; axis++) {
        const bool back = packet->backward >> axis & 1;
        float least = least_lane(_mm256_blendv_ps(high, packet->origin[axis], mask));
        float greatest = greatest_lane(_mm256_blendv_ps(low, packet->origin[axis], mask));
        packet->near_origin[axis] = back ? least : greatest;
        packet->far_origin[axis] = back ? greatest : least;
        packet->least[axis] = least_lane(_mm256_blendv_ps(high, packet->inverse[axis], mask));
        packet->greatest[axis] = greatest_lane(_mm256_blendv_ps(low, packet->inverse[axis], mask));
        packet->planes.near[axis] = (uint32_t)(axis + (back ? 3 : 0));
        packet->planes.far[axis] = (uint32_t)(axis + (back ? 0 : 3));
    }
    packet->bundle_tmin = least_lane(_mm256_blendv_ps(high, packet->tmin, mask));
    packet->bundle_slack = greatest_lane(_mm256_blendv_ps(low, packet->slack, mask));
}

/* Returns the slots whose boxes the bundle meets, and lower bounds of where. */
BOXTEST_AVX2_INLINE unsigned test_bundle(const struct packet *packet, const struct unpacked_node *node,
                                         uint32_t ret_near[8])
{
    __m256 near = _mm256_set1_ps(-INFINITY), far = _mm256_set1_ps(INFINITY);
    for (int axis = 0; axis < 3; axis++) {
        const __m256 least = _mm256_broadcast_ss(&packet->least[axis]),
                     greatest = _mm256_broadcast_ss(&packet->greatest[axis]);
        const __m256 first = _mm256_sub_ps(_mm256_loadu_ps(node->planes[packet->planes.near[axis]]),
                                           _mm256_broadcast_ss(&packet->near_origin[axis]));
        const __m256 last = _mm256_sub_ps(_mm256_loadu_ps(node->planes[packet->planes.far[axis]]),
                                          _mm256_broadcast_ss(&packet->far_origin[axis]));
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
BOXTEST_AVX2_INLINE uint32_t test_lanes(const struct packet *packet, const struct unpacked_node *node, unsigned slot)
{
    __m256 first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = _mm256_fmsub_ps(_mm256_broadcast_ss(&node->planes[packet->planes.near[axis]][slot]),
                                      packet->inverse[axis], packet->moved[axis]);
        last[axis] = _mm256_fmsub_ps(_mm256_broadcast_ss(&node->planes[packet->planes.far[axis]][slot]),
                                     packet->inverse[axis], packet->moved[axis]);
    }
    __m256 near = _mm256_max_ps(_mm256_max_ps(first[0], first[1]), first[2]),
           far = _mm256_min_ps(_mm256_min_ps(last[0], last[1]), last[2]);
    near = _mm256_max_ps(_mm256_fmsub_ps(near, _mm256_set1_ps(1 - boxtest_gamma), packet->slack), packet->tmin);
    far = _mm256_min_ps(_mm256_fmadd_ps(far, _mm256_set1_ps(1 + boxtest_gamma), packet->slack), packet->tmax);
    return (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ));
}

/* Returns the walk of a lane that goes on alone, prepared when it is first needed. */
BOXTEST_AVX2_INLINE struct avx2_walk *lane_walk(struct packet *packet, unsigned lane)
{
    struct avx2_walk *walk = &packet->walks[lane];
    if (!(packet->ready >> lane & 1)) {
        packet->ready |= 1u << lane;
        avx2_walk_init(walk, &packet->states[lane].state, packet->view, packet->nodes);
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

BOXTEST_AVX2_INLINE __m256d half_of(__m256 vector, int half)
{
    return _mm256_cvtps_pd(half ? _mm256_extractf128_ps(vector, 1) : _mm256_castps256_ps128(vector));
}

/* Widens a mask of eight lanes to one of four. */
BOXTEST_AVX2_INLINE __m256d half_mask(__m256 mask, int half)
{
    const __m256i wide = _mm256_castps_si256(mask);
    const __m128i part = half ? _mm256_extracti128_si256(wide, 1) : _mm256_castsi256_si128(wide);
    return _mm256_castsi256_pd(_mm256_cvtepi32_epi64(part));
}

/* Returns the component of each lane that its main axis chooses. */
BOXTEST_AVX2_INLINE __m256d choose(__m256d x, __m256d y, __m256d z, const struct packet_triangles *triangles)
{
    return _mm256_blendv_pd(_mm256_blendv_pd(x, y, triangles->is_y), z, triangles->is_z);
}

/* Prepares the rays for triangles. */
BOXTEST_AVX2_INLINE void packet_triangles_init(struct packet *packet, const __m256 components[8], uint32_t lanes)
{
    const __m256 x = absolute_lanes(components[4]), y = absolute_lanes(components[5]),
                 z = absolute_lanes(components[6]);
    const __m256 is_y = _mm256_cmp_ps(y, x, _CMP_GT_OQ), is_z = _mm256_cmp_ps(z, _mm256_max_ps(x, y), _CMP_GT_OQ);
    const uint32_t z_lanes = (uint32_t)_mm256_movemask_ps(is_z) & lanes,
                   y_lanes = (uint32_t)_mm256_movemask_ps(is_y) & lanes & ~z_lanes;
    packet->is_mixed = z_lanes != lanes && y_lanes != lanes && (z_lanes | y_lanes) != 0;
    for (int longest = 0; longest < 3; longest++)
        packet->orders[longest] = triangle_axis_orders[packet->backward >> longest & 1][longest];
    if (!packet->is_mixed)
        packet->orders[0] = packet->orders[z_lanes ? 2 : y_lanes ? 1 : 0];
    for (int half = 0; half < 2; half++) {
        struct packet_triangles *to = &packet->triangles[half];
        __m256d towards[3];
        to->is_y = half_mask(is_y, half);
        to->is_z = half_mask(is_z, half);
        for (int k = 0; k < 3; k++) {
            const int *const *orders = packet->orders;
            to->origin[k] = half_of(components[orders[0][k]], half);
            towards[k] = half_of(components[4 + orders[0][k]], half);
            if (packet->is_mixed) {
                to->origin[k] = choose(to->origin[k], half_of(components[orders[1][k]], half),
                                       half_of(components[orders[2][k]], half), to);
                towards[k] = choose(towards[k], half_of(components[4 + orders[1][k]], half),
                                    half_of(components[4 + orders[2][k]], half), to);
            }
        }
        to->shear[2] = _mm256_div_pd(_mm256_set1_pd(1), towards[2]);
        to->shear[0] = _mm256_mul_pd(towards[0], to->shear[2]);
        to->shear[1] = _mm256_mul_pd(towards[1], to->shear[2]);
    }
}

/* The hits of four rays at one triangle. */
struct packet_hits {
    double t[4], u[4], v[4], sum[4];
    uint32_t maybe, is_clear; /* lanes: the ray can meet the triangle; the numbers above are its hit */
};

/* Returns a coordinate of a corner relative to the rays' origins, along the k-th axis in each ray's order. */
BOXTEST_AVX2_INLINE __m256d move_along(const struct packet_triangles *ray, const int *const orders[3], bool is_mixed,
                                       int k, const float *corner)
{
    __m256d at = _mm256_set1_pd(corner[orders[0][k]]);
    if (is_mixed)
        at = choose(at, _mm256_set1_pd(corner[orders[1][k]]), _mm256_set1_pd(corner[orders[2][k]]), ray);
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

BOXTEST_AVX2_INLINE void meet_triangle(struct packet *packet, uint32_t record, uint32_t lanes, bool is_mixed)
{
    const float *corners[3];
    const uint32_t id = packet->is_indexed ? traverse_corners_indexed(packet->view, record, corners)
                                           : traverse_corners_stored(packet->view, record, corners);
    packet->triangle_count += (unsigned)__builtin_popcount(lanes);
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
                !triangle_intersect(&lane_walk(packet, lane)->state->triangle_ray, corners[0], corners[1], corners[2],
                                    &hit))
                continue;
            if (!(hit.t > state->ray->tmin && hit.t <= state->tmax))
                continue;
            traverse_leaf_hit(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, &hit);
            lane_limit(packet, lane);
        }
    }
}

BOXTEST_AVX2_INLINE void meet_records(struct packet *packet, uint32_t child, uint32_t lanes, bool is_mixed)
{
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t i = 0; i < count && lanes != 0; i++, lanes &= packet->live)
        meet_triangle(packet, first + i, lanes, is_mixed);
}

/* Tests the triangles of a leaf. It is compiled once for each value of is_mixed. */
BOXTEST_AVX2_INLINE void meet_leaf(struct packet *packet, uint32_t child, uint32_t lanes)
{
    if (packet->is_mixed)
        meet_records(packet, child, lanes, true);
    else
        meet_records(packet, child, lanes, false);
}

/* A child with the lanes that meet it, and their least distance in the highest bits. */
BOXTEST_AVX2_INLINE uint64_t pack(uint32_t near, uint32_t lanes, uint32_t child)
{
    return (uint64_t)((near & ~UINT32_C(0xff)) | lanes) << 32 | child;
}

BOXTEST_AVX2_INLINE void prefetch_child(const struct packet *packet, uint32_t child)
{
    const bool is_node = child >= CHILD_ROOT;
    const uintptr_t size = is_node ? sizeof *packet->nodes : packet->record_size, index = child & CHILD_INDEX_MASK;
    const uintptr_t at = (uintptr_t)(is_node ? (const void *)packet->nodes : packet->view->records) + size * index;
    for (unsigned line = 0; line < 4; line++)
        __builtin_prefetch((const void *)(at + 64 * line));
}

/* Finds the closest hits: children nearest first, by the distance of the bundle. */
BOXTEST_AVX2 static void packet_closest(struct packet *packet)
{
    uint64_t stack[AVX2_STACK_SIZE], *top = stack;
    uint32_t child = CHILD_ROOT, lanes = packet->live;
    for (;;) {
        if (child < CHILD_ROOT) {
            meet_leaf(packet, child, lanes);
        } else if (__builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                unsigned lane = (unsigned)__builtin_ctz(lanes);
                avx2_walk_closest(lane_walk(packet, lane), child);
                lane_limit(packet, lane);
            }
        } else {
            const struct unpacked_node *node = &packet->nodes[child & CHILD_INDEX_MASK];
            uint32_t near[8];
            unsigned slots = test_bundle(packet, node, near);
            uint64_t *base = top;
            packet->visited += (unsigned)__builtin_popcount(lanes);
            for (; slots != 0; slots &= slots - 1) {
                unsigned slot = (unsigned)__builtin_ctz(slots);
                uint32_t met = test_lanes(packet, node, slot) & lanes;
                if (met == 0)
                    continue;
                uint64_t entry = pack(near[slot], met, node->children[slot]), *at = top++;
                for (; at > base && at[-1] < entry; at--)
                    at[0] = at[-1];
                *at = entry;
                prefetch_child(packet, node->children[slot]);
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
 * Finds any hits in the order of avx2_walk_any(), which depends on the octant alone: so each ray finds the hit that it
 * finds alone.
 */
BOXTEST_AVX2 static void packet_any(struct packet *packet)
{
    uint64_t stack[AVX2_STACK_SIZE], *top = stack;
    *top++ = (uint64_t)packet->live << 32;
    while (top > stack) {
        top--;
        uint32_t lanes = (uint32_t)(*top >> 32) & packet->live, index = (uint32_t)*top;
        if (__builtin_popcount(lanes) <= ALONE) {
            for (; lanes != 0; lanes &= lanes - 1) {
                unsigned lane = (unsigned)__builtin_ctz(lanes);
                avx2_walk_any(lane_walk(packet, lane), index);
                lane_limit(packet, lane);
            }
            continue;
        }
        const struct unpacked_node *node = &packet->nodes[index];
        uint32_t met[8], near[8];
        unsigned slots = test_bundle(packet, node, near);
        packet->visited += (unsigned)__builtin_popcount(lanes);
        unsigned inner = 0;
        for (; slots != 0; slots &= slots - 1) {
            unsigned slot = (unsigned)__builtin_ctz(slots);
            met[slot] = test_lanes(packet, node, slot) & lanes & packet->live;
            if (met[slot] == 0)
                continue;
            if (node->children[slot] < CHILD_ROOT)
                meet_leaf(packet, node->children[slot], met[slot]);
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

BOXTEST_AVX2 uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[LANES],
                                        uint32_t lanes, const struct portable_view *view,
                                        const struct unpacked_node *nodes, uint64_t *ret_visited)
{
    struct packet packet;
    packet.view = view;
    packet.nodes = nodes;
    packet.states = states;
    packet.is_indexed = view->header->content == PORTABLE_INDEXED_TRIANGLES;
    packet.record_size =
        packet.is_indexed ? sizeof(struct portable_indexed_triangle) : sizeof(struct portable_triangle);
    __m256 components[8];
    transpose(rays, components);
    lanes = packet_init(&packet, components, lanes);
    if (lanes == 0)
        return 0;
    packet_bundle(&packet, lanes);
    packet_triangles_init(&packet, components, lanes);
    packet.triangle_count = 0;
    packet.ready = packet.visited = 0;
    packet.live = lanes;
    packet.tmax = _mm256_blendv_ps(_mm256_set1_ps(-1), components[7], lane_mask(lanes));
    if (rays[0]->flags & RAY_TERMINATE_ON_FIRST_HIT)
        packet_any(&packet);
    else
        packet_closest(&packet);
    *ret_visited += packet.visited;
    return lanes;
}

#else

uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[8], uint32_t lanes,
                           const struct portable_view *view, const struct unpacked_node *nodes, uint64_t *ret_visited)
{
    (void)states;
    (void)rays;
    (void)lanes;
    (void)view;
    (void)nodes;
    (void)ret_visited;
    return 0;
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_round.h - the leaves of packets through spheres and linear swept spheres: each shape is tested against four
 * rays at once. Internal to packet_avx2.c.
 */
#ifndef BVHD_PACKET_ROUND_H
#define BVHD_PACKET_ROUND_H

#include "builder/traverse/packet_setup.h"
#include "builder/traverse/round_records.h"
#include "builder/traverse/round_walk.h"

#ifdef BOXTEST_AVX2

/* What the rays of a packet need for round kinds. */
struct packet_round {
    struct round_lanes_ray halves[2];
    const float *shapes;
    uint32_t prepared; /* the lanes whose states have their round_ray */
    uint32_t begun; /* the lanes whose walks have begun */
    struct round_walk walks[LANES];
};

/* Prepares four rays with the operations of round_ray_init(). */
BOXTEST_AVX2_INLINE void packet_round_half(const struct packet *packet, int half, struct round_lanes_ray *ret_ray)
{
    __m256d size = _mm256_setzero_pd(), d[3];
    for (int axis = 0; axis < 3; axis++)
        size = _mm256_max_pd(size, lanes_size(packet->exact_direction[axis][half]));
    /* round_ray_scale(), for numbers that are floats. */
    const __m256i exponent = _mm256_set1_epi64x(INT64_C(0x7ff) << 52);
    const __m256d scale = _mm256_castsi256_pd(
        _mm256_and_si256(_mm256_add_epi64(_mm256_castpd_si256(size), _mm256_set1_epi64x(INT64_C(1) << 52)), exponent));
    ret_ray->scale = _mm256_div_pd(_mm256_set1_pd(1), scale);
    for (int axis = 0; axis < 3; axis++) {
        d[axis] = _mm256_mul_pd(packet->exact_direction[axis][half], ret_ray->scale);
        ret_ray->direction[axis] = d[axis];
        ret_ray->origin[axis] = packet->exact_origin[axis][half];
    }
    ret_ray->squared = lanes_dot(d, d);
    ret_ray->tmin = lanes_least(_mm256_mul_pd(half_of(packet->tmin, half), scale));
    ret_ray->behind = _mm256_setzero_pd(); /* as of all plain rays */
}

/* Starts a packet whose rays are ready, except for triangles. It refers to `ret_round` from then on. */
BOXTEST_AVX2_INLINE void packet_round_begin(struct packet *packet, uint32_t lanes, bool is_swept,
                                            struct packet_round *ret_round)
{
    ret_round->shapes = unpacked_shapes(packet->view, packet->nodes);
    ret_round->prepared = ret_round->begun = 0;
    for (int half = 0; half < 2; half++)
        packet_round_half(packet, half, &ret_round->halves[half]);
    for (uint32_t rest = lanes; rest != 0; rest &= rest - 1)
        packet->states[__builtin_ctz(rest)].state.round_kind = is_swept ? MET_SWEPT_SPHERE : MET_SPHERE;
    packet->round = ret_round;
    packet->record_size = (is_swept ? UNPACKED_SWEPT : UNPACKED_SPHERE) * sizeof(float);
    packet->step_cost = COST_ROUND;
}

/* Returns the walk of a lane that goes on alone, prepared when it is first needed. */
BOXTEST_AVX2_INLINE struct round_walk *packet_round_walk(struct packet *packet, struct packet_round *round,
                                                         unsigned lane)
{
    struct round_walk *walk = &round->walks[lane];
    if (!(round->begun >> lane & 1)) {
        round->begun |= 1u << lane;
        packet->work.cost += COST_ALONE;
        round_walk_begin(walk, &packet->states[lane].state, packet->view, packet->nodes);
    }
    return walk;
}

/* Tests a record against one ray: all of it where double cannot decide, or one cap. */
__attribute__((noinline)) static void packet_round_meet_alone(struct packet *packet, struct packet_round *round,
                                                              unsigned lane, uint32_t record, int end, bool is_swept)
{
    struct traverse_state *state = &packet->states[lane].state;
    if (!(round->prepared >> lane & 1)) {
        round->prepared |= 1u << lane;
        traverse_state_to_world(state);
        round_prepare(state, is_swept ? MET_SWEPT_SPHERE : MET_SPHERE);
    }
    if (end >= 0)
        round_meet_cap(state, packet->view, record, (unsigned)end);
    else
        (is_swept ? round_meet_swept : round_meet_sphere)(state, packet->view, record);
}

BOXTEST_AVX2_INLINE __m256d packet_round_spread(const float *from)
{
    return _mm256_cvtps_pd(_mm_broadcast_ss(from));
}

/* Tests a record against four rays, those of `wanted`. */
BOXTEST_AVX2_INLINE void packet_round_meet_four(const struct packet *packet, const struct packet_round *round, int half,
                                                const float *shape, unsigned wanted, bool is_swept,
                                                struct round_lanes_hits *ret_hits)
{
    const __m256d tmax = half_of(packet->tmax, half);
    __m256d first[4], second[4];
    for (int k = 0; k < 4; k++) {
        first[k] = packet_round_spread(&shape[k]);
        if (is_swept)
            second[k] = packet_round_spread(&shape[4 + k]);
    }
    if (is_swept)
        lanes_meet_swept(&round->halves[half], first, second, tmax, wanted, ret_hits);
    else
        lanes_meet_spheres(&round->halves[half], first, tmax, wanted, ret_hits);
}

/* Tests a record. */
BOXTEST_AVX2_INLINE void packet_round_meet(struct packet *packet, uint32_t record, uint32_t lanes, bool is_swept)
{
    struct packet_round *round = packet->round;
    const float *shape = round->shapes + (uint64_t)(is_swept ? UNPACKED_SWEPT : UNPACKED_SPHERE) * record;
    for (int half = 0; half < 2; half++) {
        struct round_lanes_hits hits;
        double t[LANES / 2], u[LANES / 2];
        if (!(lanes >> 4 * half & 15))
            continue;
        packet_round_meet_four(packet, round, half, shape, lanes >> 4 * half & 15, is_swept, &hits);
        if (lanes_met(&hits) == 0)
            continue;
        _mm256_storeu_pd(t, hits.t);
        _mm256_storeu_pd(u, hits.u);
        for (unsigned rest = lanes_met(&hits); rest != 0; rest &= rest - 1) {
            const unsigned at = (unsigned)__builtin_ctz(rest), lane = 4 * (unsigned)half + at;
            const uint32_t id = unpacked_shape_id(shape, is_swept);
            if (hits.hits >> at & 1)
                traverse_leaf_round(&packet->states[lane].state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE,
                                    t[at], u[at]);
            else
                packet_round_meet_alone(packet, round, lane, record,
                                        hits.open >> at & 1 ? -1 : (int)(hits.ends[1] >> at & 1), is_swept);
            lane_limit(packet, lane);
        }
    }
}

/* Tests the records of a leaf. It is compiled once for each value of is_swept. */
BOXTEST_AVX2_INLINE void packet_round_leaf(struct packet *packet, uint32_t child, uint32_t lanes, bool is_swept)
{
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t i = 0; i < count && lanes != 0; i++, lanes &= packet->live) {
        packet->work.counters.triangles += (unsigned)__builtin_popcount(lanes);
        packet_round_meet(packet, first + i, lanes, is_swept);
    }
}

#endif
#endif

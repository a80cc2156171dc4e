/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_setup.h - up to eight rays side by side: their data, and their preparation for boxes and triangles. Internal
 * to packet_avx2.c.
 *
 * The error bounds are those of boxtest.h, with the largest slack of the axes. Planes p and origins o are taken
 * relative to a corner c of the bundle's origins, so that structures far from the origin of their space lose no digits:
 * a ray meets a plane at (p - c) * inverse - (o - c) * inverse, whose first product and difference are one fused
 * operation. With u = 2^-24 the reciprocal, which both products share, is off by u, each bracket by u, the second
 * product by u and the difference by u. As |p - c| is at most |p - o| + |o - c|, the distance is off by 3u of itself
 * and 3u |(o - c) * inverse|: the slack has 4u of the latter, and 8u of the distance are allowed for, which covers the
 * roundings of these sums too. The test of the bundle computes (p - c) * inverse at the ends of the intervals of
 * origins and reciprocals, between which the products of all rays lie; its error is at most 3u of the distance.
 *
 * A ray in an instance's space is known in double. Its reciprocals are computed in double and rounded once, so that
 * they are off by u, too. The rounding of its origins to float, times the reciprocals, is added to the slack, which
 * also covers what the float origins change in the distances from which the rest of the slack is computed.
 */
#ifndef BVHD_PACKET_SETUP_H
#define BVHD_PACKET_SETUP_H

#include "builder/traverse/avx2_walk.h"
#include "builder/traverse/boxtest_moving.h"
#include "builder/traverse/traverse_group.h"

#ifdef BOXTEST_AVX2

enum { LANES = 8 };

/*
 * The costs of packets, in visits of nodes by single rays: of a step of a packet, with its tests in leaves; of a step
 * of rays with several main axes, whose triangles take more instructions and whose branches are hard to predict; what
 * different times add to a step; of a step through spheres or linear swept spheres, where a single ray tests those of
 * all leaves of a node together; and of the second preparation of a ray that goes on alone. They are fitted to times of
 * packets and of single rays in ten scenes, and in hair and a cloud of spheres.
 */
enum { COST_STEP = 3, COST_MIXED = 6, COST_TIMES = 1, COST_ROUND = 4, COST_ALONE = 4 };

/* Four of the rays as struct triangle_ray has one. */
struct packet_triangles {
    __m256d origin[3], shear[3];
    __m256d is_y, is_z; /* the lanes whose main axis is y, or z */
};

/* The times of the rays, with which the starts and the ends of numbers count, and the ends of their interval. */
struct packet_times {
    __m256 start, end;
    float least, greatest;
};

/* Some rays, each in a lane of vectors of eight. */
struct packet {
    struct packet_triangles triangles[2];
    const int *orders[3]; /* the axes in the order of triangle_ray, by main axis */
    bool is_mixed; /* the rays have several main axes; else all orders are the same */
    __m256 origin[3], direction[3], inverse[3];
    __m256 near_moved[3], far_moved[3]; /* the origins relative to near_origin and far_origin, times inverse */
    __m256d exact_origin[3][2], exact_direction[3][2]; /* by axis, and by half of the lanes */
    __m256 rounding; /* in t: how far the rounding of the origins to float moves planes */
    __m256 tmin, tmax;
    __m256 slack_alone, slack; /* without and with what the bundle adds */
    struct boxtest_planes planes;
    uint32_t backward;
    /* The bundle: the origins that make near and far planes come nearest and farthest, and the ends of the rest. */
    float near_origin[3], far_origin[3], least[3], greatest[3];
    float bundle_tmin, bundle_slack;
    uint32_t ready; /* the lanes whose walks are prepared */
    uint32_t live; /* the lanes whose rays are not finished */
    uint32_t record_size;
    const struct portable_view *view;
    const struct unpacked_node *nodes;
    /* Only of motion triangles; `nodes` is not used there. */
    const struct unpacked_moving_node *moving_nodes;
    const struct unpacked_moving_triangle *moving_triangles;
    struct motion_weights at; /* of rays that have one time; else `times` is used */
    struct packet_times times;
    struct packet_round *round; /* only of round kinds */
    bool have_times; /* the rays have different times, and what they are in moves */
    const float *object_to_world; /* the rays are in the space of this instance; NULL: in world space */
    uint32_t matrix_step; /* 0: that is so for all lanes; 12: each has the next matrix */
    uint32_t step_cost; /* of a step of this packet */
    struct packet_work work;
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

/* Puts rays in world space into the lanes. */
BOXTEST_AVX2_INLINE void packet_to_world(struct packet *packet, const struct ray *const rays[LANES])
{
    __m256 components[8];
    transpose(rays, components);
    packet->object_to_world = NULL;
    packet->rounding = _mm256_setzero_ps();
    packet->tmin = components[3];
    packet->tmax = components[7];
    for (int axis = 0; axis < 3; axis++) {
        packet->origin[axis] = components[axis];
        packet->direction[axis] = components[4 + axis];
        packet->inverse[axis] = _mm256_div_ps(_mm256_set1_ps(1), components[4 + axis]);
        for (int half = 0; half < 2; half++) {
            packet->exact_origin[axis][half] = half_of(components[axis], half);
            packet->exact_direction[axis][half] = half_of(components[4 + axis], half);
        }
    }
}

/* Returns a scaled row times a vector, with the operations of traverse_state_to_object(). */
BOXTEST_AVX2_INLINE __m256d scaled_dot(const double row[3], __m256d x, __m256d y, __m256d z, double scale)
{
    const __m256d sum =
        _mm256_add_pd(_mm256_mul_pd(_mm256_set1_pd(row[0]), x), _mm256_mul_pd(_mm256_set1_pd(row[1]), y));
    return _mm256_mul_pd(_mm256_add_pd(sum, _mm256_mul_pd(_mm256_set1_pd(row[2]), z)), _mm256_set1_pd(scale));
}

BOXTEST_AVX2_INLINE __m256 join(__m256d low, __m256d high)
{
    return _mm256_set_m128(_mm256_cvtpd_ps(high), _mm256_cvtpd_ps(low));
}

/* Finds what follows from exact_origin and exact_direction of rays that were put into the space of an instance. */
BOXTEST_AVX2_INLINE void packet_settle(struct packet *packet, const struct packet *world)
{
    const __m256d one = _mm256_set1_pd(1), sign = _mm256_set1_pd(-0.0);
    __m256d rounding[2] = {_mm256_setzero_pd(), _mm256_setzero_pd()};
    for (int axis = 0; axis < 3; axis++) {
        __m256d reciprocal[2], *origin = packet->exact_origin[axis], *direction = packet->exact_direction[axis];
        for (int half = 0; half < 2; half++)
            reciprocal[half] = _mm256_div_pd(one, direction[half]);
        packet->origin[axis] = join(origin[0], origin[1]);
        packet->direction[axis] = join(direction[0], direction[1]);
        packet->inverse[axis] = join(reciprocal[0], reciprocal[1]);
        for (int half = 0; half < 2; half++) {
            const __m256d error = _mm256_sub_pd(origin[half], half_of(packet->origin[axis], half));
            rounding[half] =
                _mm256_max_pd(rounding[half], _mm256_andnot_pd(sign, _mm256_mul_pd(error, reciprocal[half])));
        }
    }
    packet->rounding = join(rounding[0], rounding[1]);
    packet->tmin = world->tmin;
    packet->tmax = world->tmax;
}

/* Puts the rays of a packet in world space into the space of an instance. */
BOXTEST_AVX2_INLINE void packet_to_object(struct packet *packet, const struct packet *world,
                                          const float object_to_world[12])
{
    struct traverse_inverse inverse;
    __m256d offset[3][2];
    traverse_inverse_init(object_to_world, &inverse);
    for (int axis = 0; axis < 3; axis++)
        for (int half = 0; half < 2; half++)
            offset[axis][half] =
                _mm256_sub_pd(world->exact_origin[axis][half], _mm256_set1_pd(object_to_world[4 * axis + 3]));
    for (int axis = 0; axis < 3; axis++) {
        const double *row = inverse.rows[axis];
        for (int half = 0; half < 2; half++) {
            const __m256d(*from)[2] = (const __m256d(*)[2])world->exact_direction;
            packet->exact_origin[axis][half] =
                scaled_dot(row, offset[0][half], offset[1][half], offset[2][half], inverse.scale);
            packet->exact_direction[axis][half] =
                scaled_dot(row, from[0][half], from[1][half], from[2][half], inverse.scale);
        }
    }
    packet->object_to_world = object_to_world;
    packet->matrix_step = 0;
    packet_settle(packet, world);
}

/* Does the same where each lane has a matrix of its own; the other lanes get what the first one has. */
BOXTEST_AVX2_INLINE void packet_to_objects(struct packet *packet, const struct packet *world, uint32_t lanes,
                                           const float (*matrices)[12])
{
    double origin[3][LANES], direction[3][LANES];
    const unsigned first = (unsigned)__builtin_ctz(lanes);
    for (unsigned lane = 0; lane < LANES; lane++) {
        const unsigned from = lanes >> lane & 1 ? lane : first;
        struct traverse_state *state = &packet->states[from].state;
        if (lane <= first || from == lane)
            traverse_state_to_object(state, matrices[from]);
        for (int axis = 0; axis < 3; axis++) {
            origin[axis][lane] = state->origin[axis];
            direction[axis][lane] = state->direction[axis];
        }
    }
    for (int axis = 0; axis < 3; axis++)
        for (int half = 0; half < 2; half++) {
            packet->exact_origin[axis][half] = _mm256_loadu_pd(&origin[axis][4 * half]);
            packet->exact_direction[axis][half] = _mm256_loadu_pd(&direction[axis][4 * half]);
        }
    packet->object_to_world = matrices[0];
    packet->matrix_step = 12;
    packet_settle(packet, world);
}

/*
 * Prepares the rays for boxes; returns the lanes for which float tests can be trusted and no axis is parallel. The
 * limits are stricter than those of boxtest.h by a factor, so that a lane can also go on alone.
 */
BOXTEST_AVX2_INLINE uint32_t packet_init(struct packet *packet, uint32_t lanes)
{
    const float *bounds = packet->view->header->bounds;
    __m256 speed = _mm256_setzero_ps(), reach = _mm256_setzero_ps(), at_axis = _mm256_setzero_ps();
    __m256 sizes = _mm256_setzero_ps(), shortest = _mm256_set1_ps(INFINITY);
    float corner = 0;
    for (int axis = 0; axis < 3; axis++) {
        const __m256 origin = packet->origin[axis], inverse = packet->inverse[axis];
        const __m256 size = absolute_lanes(packet->direction[axis]);
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
    }
    if (!(corner >= (float)structure_min && corner <= (float)range_max))
        return 0;
    const __m256 fits = _mm256_castsi256_ps(
        _mm256_cmpgt_epi32(_mm256_castps_si256(_mm256_set1_ps((float)range_max)), _mm256_castps_si256(sizes)));
    const __m256 is_fast = _mm256_cmp_ps(speed, _mm256_set1_ps(2 * (float)direction_min), _CMP_GE_OQ);
    const __m256 is_oblique =
        _mm256_cmp_ps(shortest, _mm256_mul_ps(speed, _mm256_set1_ps(2 * (float)parallel_ratio)), _CMP_GE_OQ);
    lanes &= (uint32_t)_mm256_movemask_ps(_mm256_and_ps(fits, _mm256_and_ps(is_fast, is_oblique)));
    const __m256 t_reach = _mm256_div_ps(reach, speed);
    const __m256 slack = _mm256_fmadd_ps(
        t_reach, _mm256_set1_ps((float)(1.001 * t_error)),
        _mm256_fmadd_ps(packet->rounding, _mm256_set1_ps(1.001f), _mm256_set1_ps((float)underflow_error)));
    packet->slack_alone = _mm256_fmadd_ps(at_axis, _mm256_set1_ps((float)(1.001 * corner_error)), slack);
    return lanes;
}

static const uint32_t lane_bits[LANES] __attribute__((aligned(32))) = {1, 2, 4, 8, 16, 32, 64, 128};

/* Returns a vector that is all ones in the lanes. */
BOXTEST_AVX2_INLINE __m256 lane_mask(uint32_t lanes)
{
    const __m256i bits = _mm256_load_si256((const __m256i *)(const void *)lane_bits);
    return _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32((int)lanes), bits), bits));
}

/* Takes the end of a lane's interval from its state, after a hit. */
BOXTEST_AVX2_INLINE void lane_limit(struct packet *packet, unsigned lane)
{
    const struct traverse_state *state = &packet->states[lane].state;
    const __m256 limit = _mm256_set1_ps(state->is_done ? -1 : state->tmax_above);
    packet->tmax = _mm256_blendv_ps(packet->tmax, limit, lane_mask(1u << lane));
    packet->live &= ~((uint32_t)state->is_done << lane);
}

/* Returns those of the lanes that have the octant of the first of them. */
BOXTEST_AVX2_INLINE uint32_t packet_octant(const struct packet *packet, uint32_t lanes)
{
    const unsigned first = (unsigned)__builtin_ctz(lanes);
    for (int axis = 0; axis < 3; axis++) {
        const uint32_t back = (uint32_t)_mm256_movemask_ps(packet->inverse[axis]);
        lanes &= back >> first & 1 ? back : ~back;
    }
    return lanes;
}

/* Returns the origins relative to a coordinate, times the reciprocals. */
BOXTEST_AVX2_INLINE __m256 moved_from(const struct packet *packet, int axis, float from)
{
    return _mm256_mul_ps(_mm256_sub_ps(packet->origin[axis], _mm256_set1_ps(from)), packet->inverse[axis]);
}

/* Widens the slack to that of structures that move, as boxtest_widen() does. */
BOXTEST_AVX2_INLINE void packet_widen(struct packet *packet)
{
    const float *bounds = packet->view->header->bounds;
    for (int axis = 0; axis < 3; axis++) {
        const __m256 moved = _mm256_set1_ps((float)(1.001 * boxtest_moved(bounds, axis)));
        packet->slack_alone =
            _mm256_add_ps(packet->slack_alone, _mm256_mul_ps(moved, absolute_lanes(packet->inverse[axis])));
    }
}

/* Finds the bundle around the lanes, which have one octant. */
BOXTEST_AVX2_INLINE void packet_bundle(struct packet *packet, uint32_t lanes)
{
    __m256 moved = _mm256_setzero_ps();
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
        packet->near_moved[axis] = moved_from(packet, axis, packet->near_origin[axis]);
        packet->far_moved[axis] = moved_from(packet, axis, packet->far_origin[axis]);
        moved = _mm256_max_ps(
            moved, _mm256_max_ps(absolute_lanes(packet->near_moved[axis]), absolute_lanes(packet->far_moved[axis])));
    }
    packet->slack = _mm256_fmadd_ps(moved, _mm256_set1_ps(0x1p-22f), packet->slack_alone);
    packet->bundle_tmin = least_lane(_mm256_blendv_ps(high, packet->tmin, mask));
    packet->bundle_slack = greatest_lane(_mm256_blendv_ps(low, packet->slack, mask));
}

/* Returns the component of each lane that its main axis chooses. */
BOXTEST_AVX2_INLINE __m256d choose(__m256d x, __m256d y, __m256d z, const struct packet_triangles *triangles)
{
    return _mm256_blendv_pd(_mm256_blendv_pd(x, y, triangles->is_y), z, triangles->is_z);
}

/* Prepares the rays for triangles, after the bundle. */
BOXTEST_AVX2 static void packet_triangles_init(struct packet *packet, uint32_t lanes)
{
    const __m256d sign = _mm256_set1_pd(-0.0);
    uint32_t y_lanes = 0, z_lanes = 0;
    for (int half = 0; half < 2; half++) {
        struct packet_triangles *to = &packet->triangles[half];
        const __m256d x = _mm256_andnot_pd(sign, packet->exact_direction[0][half]),
                      y = _mm256_andnot_pd(sign, packet->exact_direction[1][half]),
                      z = _mm256_andnot_pd(sign, packet->exact_direction[2][half]);
        to->is_y = _mm256_cmp_pd(y, x, _CMP_GT_OQ);
        to->is_z = _mm256_cmp_pd(z, _mm256_max_pd(x, y), _CMP_GT_OQ);
        y_lanes |= (uint32_t)_mm256_movemask_pd(to->is_y) << 4 * half;
        z_lanes |= (uint32_t)_mm256_movemask_pd(to->is_z) << 4 * half;
    }
    z_lanes &= lanes;
    y_lanes &= lanes & ~z_lanes;
    packet->is_mixed = z_lanes != lanes && y_lanes != lanes && (z_lanes | y_lanes) != 0;
    packet->step_cost = packet->is_mixed ? COST_MIXED : COST_STEP;
    for (int longest = 0; longest < 3; longest++)
        packet->orders[longest] = triangle_axis_orders[packet->backward >> longest & 1][longest];
    if (!packet->is_mixed)
        packet->orders[0] = packet->orders[z_lanes ? 2 : y_lanes ? 1 : 0];
    const int *const *orders = packet->orders;
    for (int half = 0; half < 2; half++) {
        struct packet_triangles *to = &packet->triangles[half];
        __m256d towards[3];
        for (int k = 0; k < 3; k++) {
            to->origin[k] = packet->exact_origin[orders[0][k]][half];
            towards[k] = packet->exact_direction[orders[0][k]][half];
            if (packet->is_mixed) {
                to->origin[k] = choose(to->origin[k], packet->exact_origin[orders[1][k]][half],
                                       packet->exact_origin[orders[2][k]][half], to);
                towards[k] = choose(towards[k], packet->exact_direction[orders[1][k]][half],
                                    packet->exact_direction[orders[2][k]][half], to);
            }
        }
        to->shear[2] = _mm256_div_pd(_mm256_set1_pd(1), towards[2]);
        to->shear[0] = _mm256_mul_pd(towards[0], to->shear[2]);
        to->shear[1] = _mm256_mul_pd(towards[1], to->shear[2]);
    }
}

/* Adds the work of a packet to other work. */
static inline void packet_count(const struct packet *packet, struct packet_work *work)
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
    packet->record_size = sizeof(struct portable_triangle);
    packet->step_cost = COST_STEP;
    packet->work = (struct packet_work){.cost = 0};
    packet->ready = 0;
}

#endif
#endif

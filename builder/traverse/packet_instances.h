/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_instances.h - the leaves of top levels for packets of rays: those that meet an instance are put into its
 * space, where those of one octant go on together. An instance that moves has a place at the time of the rays; where
 * they have different times, each of them is put into a space of its own. Internal to packet_avx2.c.
 */
#ifndef BVHD_PACKET_INSTANCES_H
#define BVHD_PACKET_INSTANCES_H

#include "builder/traverse/motion.h"
#include "builder/traverse/packet_setup.h"

#ifdef BOXTEST_AVX2

/* Walks through triangles that stand still. */
static void packet_walk(struct packet *packet, uint32_t lanes, bool is_any);

/*
 * Up to INSTANCE_ALONE rays go through an instance alone; up to INSTANCE_ALONE_AT_TIMES where each needs a matrix of
 * its own.
 */
enum { INSTANCE_ALONE = 1, INSTANCE_ALONE_AT_TIMES = 3 };

/* Returns those of the lanes whose rays see an instance with this mask. */
BOXTEST_AVX2_INLINE uint32_t lanes_that_see(const struct packet *packet, uint32_t lanes, uint32_t mask)
{
    uint32_t seeing = 0;
    for (uint32_t rest = lanes; rest != 0; rest &= rest - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(rest);
        seeing |= (uint32_t)((packet->states[lane].state.ray->cull_mask & mask) != 0) << lane;
    }
    return seeing;
}

/* Traces lanes through an instance one by one. */
BOXTEST_AVX2 static void meet_alone(struct packet *packet, uint32_t row, uint32_t lanes)
{
    const bool moves = packet->view->header->content == PORTABLE_MOVING_INSTANCES;
    for (; lanes != 0; lanes &= lanes - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(lanes);
        (moves ? traverse_walk_moving_instance : traverse_walk_instance)(&packet->states[lane], row);
        lane_limit(packet, lane);
    }
}

/* Tells the states of lanes in which instance their next hits are. */
BOXTEST_AVX2_INLINE void enter_instance(struct packet *packet, const struct traverse_instance *instance, uint32_t lanes)
{
    packet->work.counters.instances += (unsigned)__builtin_popcount(lanes);
    for (; lanes != 0; lanes &= lanes - 1)
        traverse_state_settle(&packet->states[__builtin_ctz(lanes)].state, instance, RAY_SKIP_TRIANGLES, true);
}

/* Traces lanes through an instance of triangles together, after they have been put into its space. */
BOXTEST_AVX2_INLINE void meet_inside(struct packet *packet, struct packet *inner,
                                     const struct traverse_instance *instance, uint32_t lanes)
{
    const bool is_any = packet->states[__builtin_ctz(lanes)].state.ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
    const uint32_t entered = packet_init(inner, lanes);
    inner->live = entered;
    meet_alone(packet, instance->record, lanes & ~entered);
    enter_instance(inner, instance, entered);
    for (uint32_t rest = entered, same; rest != 0; rest &= ~same) {
        same = packet_octant(inner, rest);
        packet_bundle(inner, same);
        packet_triangles_init(inner, same);
        packet_walk(inner, same, is_any);
    }
    packet->tmax = _mm256_blendv_ps(packet->tmax, inner->tmax, lane_mask(entered));
    packet->live &= ~(entered & ~inner->live);
    packet_count(inner, &packet->work);
}

BOXTEST_AVX2 static void meet_together(struct packet *packet, const struct traverse_instance *instance,
                                       const float object_to_world[12], uint32_t lanes)
{
    const struct scene *scene = packet->states[__builtin_ctz(lanes)].scene;
    struct packet inner;
    packet_begin(&inner, packet->states, scene->bottoms[instance->bottom], scene->unpacked[instance->bottom]);
    packet_to_object(&inner, packet, object_to_world);
    meet_inside(packet, &inner, instance, lanes);
}

/* Does the same for an instance that moves, by rays of different times. */
BOXTEST_AVX2 static void meet_at_times(struct packet *packet, const struct traverse_instance *instance,
                                       const struct portable_moving_instance *record, uint32_t lanes)
{
    const struct scene *scene = packet->states[__builtin_ctz(lanes)].scene;
    float matrices[LANES][12];
    struct packet inner;
    for (uint32_t rest = lanes; rest != 0; rest &= rest - 1) {
        const unsigned lane = (unsigned)__builtin_ctz(rest);
        if (!motion_matrix(record, packet->states[lane].state.ray->time, matrices[lane]))
            lanes &= ~(1u << lane);
    }
    if (lanes == 0)
        return;
    packet_begin(&inner, packet->states, scene->bottoms[instance->bottom], scene->unpacked[instance->bottom]);
    packet_to_objects(&inner, packet, lanes, (const float(*)[12])matrices);
    meet_inside(packet, &inner, instance, lanes);
}

static bool is_unpacked(const struct scene *scene, uint32_t bottom)
{
    return scene->unpacked[bottom] && scene->bottoms[bottom]->header->content == PORTABLE_TRIANGLES;
}

/* Gives the row of an instance's bottom level. Returns false if that is not there. */
static bool find_bottom(const struct scene *scene, uint32_t handle, uint32_t *ret_bottom)
{
    *ret_bottom = scene->rows ? scene->rows[handle] : handle;
    return *ret_bottom < scene->bottom_count && scene->bottoms[*ret_bottom];
}

BOXTEST_AVX2 static void meet_moving(struct packet *packet, uint32_t row, uint32_t lanes)
{
    const struct scene *scene = packet->states[__builtin_ctz(lanes)].scene;
    const struct portable_moving_instance *record = (const struct portable_moving_instance *)scene->top->records + row;
    uint32_t bottom;
    float matrix[12];
    if (!find_bottom(scene, record->handle, &bottom))
        return;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    lanes = lanes_that_see(packet, lanes, record->custom_and_mask >> 24);
    if (__builtin_popcount(lanes) <= (packet->have_times ? INSTANCE_ALONE_AT_TIMES : INSTANCE_ALONE) ||
        !is_unpacked(scene, bottom))
        meet_alone(packet, row, lanes);
    else if (packet->have_times)
        meet_at_times(packet, &instance, record, lanes);
    else if (motion_matrix(record, packet->states[__builtin_ctz(lanes)].state.ray->time, matrix))
        meet_together(packet, &instance, matrix, lanes);
}

BOXTEST_AVX2 static void meet_still(struct packet *packet, uint32_t row, uint32_t lanes)
{
    const struct scene *scene = packet->states[__builtin_ctz(lanes)].scene;
    const struct portable_instance *record = (const struct portable_instance *)scene->top->records + row;
    uint32_t bottom;
    if (!find_bottom(scene, record->handle, &bottom))
        return;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    lanes = lanes_that_see(packet, lanes, record->custom_and_mask >> 24);
    if (__builtin_popcount(lanes) <= INSTANCE_ALONE || !is_unpacked(scene, bottom))
        meet_alone(packet, row, lanes);
    else
        meet_together(packet, &instance, record->object_to_world, lanes);
}

/* Traces lanes through the instances of a leaf. */
BOXTEST_AVX2 static void packet_instances_meet(struct packet *packet, uint32_t child, uint32_t lanes)
{
    const bool moves = packet->view->header->content == PORTABLE_MOVING_INSTANCES;
    const uint32_t first = child & CHILD_INDEX_MASK, count = (child >> CHILD_KIND_SHIFT) + 1;
    for (uint32_t i = 0; i < count && lanes != 0; i++, lanes &= packet->live)
        (moves ? meet_moving : meet_still)(packet, first + i, lanes);
}

#endif
#endif

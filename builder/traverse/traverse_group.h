/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_group.h - traces some rays in one call, which takes less time than one by one. Rays that begin near each
 * other are best given together.
 */
#ifndef BVHD_TRAVERSE_GROUP_H
#define BVHD_TRAVERSE_GROUP_H

#include "builder/traverse/traverse_walk.h"

enum { TRAVERSE_GROUP = 64 }; /* rays: a tile of 8 x 8 pixels */

/* Rays that are traced group by group. */
struct traverse_stream {
    const struct scene *scene;
    const struct traverse_options *options; /* may be NULL */
    struct traverse_counters *counters; /* may be NULL */
    /* These are all 0 at first. */
    uint32_t alone; /* the number of next rays that are best traced alone, because packets did not pay */
    uint32_t pause; /* what `alone` was after the last decision; 0: packets paid */
    uint32_t groups; /* since the last decision; then the visits of their rays in packets, and what these cost */
    uint64_t visits_together, cost;
};

/* The work of packets. */
struct packet_work {
    struct traverse_counters counters; /* of the steps that rays made together */
    uint64_t cost; /* in visits of nodes by single rays */
};

/* Returns whether groups can take less time than single rays. */
bool traverse_groups_pay(const struct traverse_stream *stream);

/*
 * Returns how many of the next rays, of which there are `most`, are best given to traverse() one by one, because
 * packets did not pay for those before them. They then count as given.
 */
uint64_t traverse_next_alone(struct traverse_stream *stream, uint64_t most);

/*
 * Traces up to TRAVERSE_GROUP rays as traverse() does each of them. Returns bit i if ray i hits; then ret_hits[i] is
 * filled, else it is left as it was.
 */
uint64_t traverse_group(struct traverse_stream *stream, const struct ray *rays, uint32_t count,
                        struct ray_hit *ret_hits);

/*
 * Traces a packet (packet_avx2.c): the lanes' rays, all plain, of one octant and one kind; through spheres and linear
 * swept spheres they search the closest hit. Returns the lanes done, and adds to the work.
 */
uint32_t packet_avx2_trace(struct traverse_walk *states, const struct ray *const rays[8], uint32_t lanes,
                           const struct scene *scene, struct packet_work *work);

/*
 * Traces rays alone, but some at a time in turns (turns_avx2.c): those of `which`, all plain, in a scene of one
 * unpacked structure of triangles, or of motion triangles. Returns the rays done, of which ret_hits is filled and the
 * bit of *is_hit set where they hit.
 */
uint64_t turns_avx2_trace(const struct traverse_stream *stream, const struct ray *rays, uint64_t which,
                          struct ray_hit *ret_hits, uint64_t *is_hit);

#endif

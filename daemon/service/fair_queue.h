/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fair_queue.h - who is next, when several clients wait for the same thing: each has a lane, and the lane that has been
 * given least so far goes first, so that one who asks for much at once waits for as much of the others' in turn. A lane
 * that comes, or comes back, starts level with the others. Within a lane priority goes before age. It owns nothing and
 * never fails: entries and lanes lie in their owners' structs. Loop thread only.
 */
#ifndef BVHD_FAIR_QUEUE_H
#define BVHD_FAIR_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

enum { FAIR_PRIORITIES = 3 }; /* 0 goes first */

struct fair_lane;

/* Something that waits. Zeroed: it does not. */
struct fair_entry {
    struct fair_lane *lane; /* NULL: not queued */
    struct fair_entry *previous, *next;
    uint32_t priority;
};

/* A client's. Zeroed: empty. May go when it is empty. */
struct fair_lane {
    struct {
        struct fair_entry *first, *last;
    } lists[FAIR_PRIORITIES];
    uint32_t count;
    bool held; /* its entries wait, whoever's turn it is */
    uint64_t given; /* the sum of its costs, or more where it was raised to start level */
    struct fair_lane *previous, *next; /* the ring of lanes that are not empty, and not held */
};

/* Zeroed: empty. */
struct fair_queue {
    /* the ring; of lanes that have been given equally much the one that comes first from here; NULL: nobody waits */
    struct fair_lane *turn;
    uint32_t count;
    uint64_t level; /* what the last lane that had its turn had been given before it */
};

/* `priority` below FAIR_PRIORITIES. The entry waits nowhere yet. */
void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority);

/* The entry whose turn it is; NULL when nobody waits. */
struct fair_entry *fair_queue_peek(const struct fair_queue *queue);

/* Takes what peek gave; `cost` is what its lane is given by that. All costs together stay below 2^64. */
void fair_queue_pop(struct fair_queue *queue, uint64_t cost);

/* Passes a lane over, or no longer does. */
void fair_queue_hold(struct fair_queue *queue, struct fair_lane *lane, bool held);

/* Takes an entry out, wherever it waits; harmless when it does not. */
void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry);

#endif

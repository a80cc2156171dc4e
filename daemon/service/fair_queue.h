/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fair_queue.h - decides who is next when several clients wait for the same resource, so that a client that asks for
 * much does not delay the others.
 *
 * Each client has a lane, and the lane that has been given least so far goes first. A lane that comes, or comes back,
 * starts level with the others. Within a lane, higher priorities go first, and older entries first among equal ones.
 * The queue owns nothing and never fails: entries and lanes lie in their owners' structs. For the loop thread only.
 */
#ifndef BVHD_FAIR_QUEUE_H
#define BVHD_FAIR_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/list.h"

enum { FAIR_PRIORITIES = 3 }; /* 0 goes first */

struct fair_lane;

/* Something that can wait. Zeroed means that it does not. */
struct fair_entry {
    struct fair_lane *lane; /* NULL: not queued */
    struct list_link link;
    uint32_t priority;
};

/* One client's entries. Zeroed means empty; an empty lane may be freed. */
struct fair_lane {
    struct list lists[FAIR_PRIORITIES];
    uint32_t count;
    bool held; /* the queue passes it over */
    uint64_t given; /* the sum of its costs, or more where it was raised to start level */
    struct fair_lane *previous, *next; /* the ring of lanes that are neither empty nor held */
};

/* Zeroed means empty. */
struct fair_queue {
    /* where the ring begins: of lanes that have been given equally much, the first from here is next; NULL: no lane */
    struct fair_lane *ring;
    uint32_t count; /* of entries, including those of held lanes */
    uint64_t level; /* what the lane of the last entry that was taken had been given before */
};

/* Queues an entry that waits nowhere yet. `priority` is below FAIR_PRIORITIES. */
void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority);

/* Returns the entry that is next; NULL when there is none. */
struct fair_entry *fair_queue_peek(const struct fair_queue *queue);

/*
 * Takes the entry that fair_queue_peek returned; `cost` is what its lane is given by that. The sum of all costs stays
 * below 2^64.
 */
void fair_queue_pop(struct fair_queue *queue, uint64_t cost);

/* Makes the queue pass a lane over, or no longer. */
void fair_queue_hold(struct fair_queue *queue, struct fair_lane *lane, bool held);

/* Takes an entry out. Does nothing if it is not queued. */
void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fair_queue.h - decides who is next when several clients wait for the same resource, so that a client that asks for
 * much does not delay the others.
 *
 * Each client has a lane. The lane that has been given least so far goes first, in any unit that callers use for costs
 * (memory_queue.h counts bytes). A lane that comes, or comes back, starts level with the others: it gets no advantage
 * from the time in which it was empty or held. Within a lane, higher priorities go first, and older entries first among
 * equal ones. The queue owns nothing and never fails: entries and lanes are members of their owners' structs. For the
 * loop thread only.
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
    bool held; /* the queue takes nothing from it */
    uint64_t given; /* the costs of its entries so far; raised to queue->level when the lane comes back */
    struct fair_lane *previous, *next; /* the ring of lanes that are neither empty nor held */
};

/* Zeroed means empty. */
struct fair_queue {
    /* where the ring begins: of lanes that have been given equally much, the first from here is next; NULL: no lane */
    struct fair_lane *ring;
    uint32_t count; /* of entries, including those of held lanes */
    uint64_t level; /* `given` of the lane that was served last, before that entry: where a new lane starts */
};

/* Queues an entry that waits nowhere yet. `priority` is below FAIR_PRIORITIES. */
void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority);

/* Returns the entry that is next; NULL when there is none. */
struct fair_entry *fair_queue_peek(const struct fair_queue *queue);

/*
 * Removes the entry that fair_queue_peek returned, and adds `cost` to what its lane has been given. The sum of all
 * costs stays below 2^64.
 */
void fair_queue_pop(struct fair_queue *queue, uint64_t cost);

/* Holds a lane, or releases it: nothing is taken from a lane that is held. */
void fair_queue_hold(struct fair_queue *queue, struct fair_lane *lane, bool held);

/* Removes an entry. Does nothing if it is not queued. */
void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry);

#endif

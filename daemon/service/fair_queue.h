/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fair_queue.h - decides who is next when several clients wait for the same resource, so that a client that asks for
 * much does not delay the others.
 *
 * Turns are shared along a tree: the queue's root, users, and below each user a lane for each of its connections. At
 * every node the child that has been given least so far goes first, in any unit that callers use for costs
 * (memory_queue.h counts bytes). So a user with many connections has the turns of one user. A child that comes, or
 * comes back, starts level with the others: it gets no advantage from the time in which it was empty or held. Within a
 * lane, higher priorities go first, and older entries first among equal ones. The queue owns nothing and never fails:
 * entries, lanes and nodes are members of their owners' structs. For the loop thread only.
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

/*
 * One that turns are given to: a user, or the lane of a connection. Zeroed means that nothing waits below it; it may
 * then be freed.
 */
struct fair_node {
    struct fair_node *parent; /* set by the owner while nothing waits; NULL: the queue's root */
    /* where the ring of children begins: of those that were given equally much, the first from here is next */
    struct fair_node *ring;
    uint64_t level; /* `given` of the child that was served last, before that entry: where a new child starts */
    uint64_t given; /* the costs of its entries so far; raised to the parent's level when it comes back */
    struct fair_node *previous, *next; /* the ring of siblings that are ready and not held */
    bool ready; /* something waits below it that is not held there */
    bool held; /* the queue takes nothing that is below it */
};

/* One connection's entries. Zeroed means empty; an empty lane may be freed. */
struct fair_lane {
    struct fair_node node; /* without children */
    struct list lists[FAIR_PRIORITIES];
    uint32_t count;
};

/* Zeroed means empty. */
struct fair_queue {
    struct fair_node root;
    uint32_t count; /* of entries, including those of held lanes */
};

/* Queues an entry that waits nowhere yet. `priority` is below FAIR_PRIORITIES. */
void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority);

/* Returns the entry that is next; NULL when there is none. */
struct fair_entry *fair_queue_peek(const struct fair_queue *queue);

/*
 * Removes the entry that fair_queue_peek returned, and adds `cost` to what its lane, and each node above it, has been
 * given. The sum of all costs stays below 2^64.
 */
void fair_queue_pop(struct fair_queue *queue, uint64_t cost);

/* Holds a lane or a user, or releases it: nothing that waits below it is taken while it is held. */
void fair_queue_hold(struct fair_queue *queue, struct fair_node *node, bool held);

/* Removes an entry. Does nothing if it is not queued. */
void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry);

/*
 * Returns whether an entry that came now would have its turn earlier in `lane` than in `other`, as far as that depends
 * on what their users, or both lanes of one user, have been given.
 */
bool fair_queue_is_earlier(const struct fair_queue *queue, const struct fair_lane *lane, const struct fair_lane *other);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * memory_queue.h - the steps of one kind (prepares or builds) that wait until memory can be promised to them.
 *
 * Each admission class has a queue of its own, so that a small step never waits behind a large one. Within a class,
 * users get memory in fair shares, and so do the connections of each user (fair_queue.h): the step that is next keeps
 * its place until its claim can be promised. The queue owns nothing and never fails: waiters, lanes and turns are
 * members of their owners' structs. For the loop thread only.
 */
#ifndef BVHD_MEMORY_QUEUE_H
#define BVHD_MEMORY_QUEUE_H

#include "daemon/service/admission.h"
#include "daemon/service/fair_queue.h"

/*
 * One user's turns in a queue, which all connections of the user share: a node for each admission class. Zeroed means
 * that nothing waits.
 */
struct memory_turns {
    struct fair_node nodes[ADMISSION_CLASSES];
};

/*
 * One connection's lanes in a queue, one for each admission class. Zeroed means empty; it may be freed when it is
 * empty.
 */
struct memory_lanes {
    struct fair_lane lanes[ADMISSION_CLASSES];
};

/* Makes empty lanes share the turns of a user, which has to outlive them. Lanes without turns count as users. */
static inline void memory_lanes_share(struct memory_lanes *lanes, struct memory_turns *turns)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        lanes->lanes[class].node.parent = &turns->nodes[class];
}

static inline bool memory_lanes_are_held(const struct memory_lanes *lanes)
{
    return lanes->lanes[ADMISSION_LARGE].node.held;
}

/* A step that can wait. It is a member of its owner's struct; zeroed means that it does not wait. */
struct memory_waiter {
    /*
     * Called once the claim has been promised and the waiter has left the queue. The owner ends the promise later, by
     * admission_end.
     */
    void (*start)(struct memory_waiter *waiter);
    struct admission_claim claim;
    int priority; /* PRIORITY_ */
    struct fair_entry entry; /* belongs to the queue */
};

struct memory_queue {
    struct admission *admission;
    enum admission_step step;
    struct fair_queue waiting[ADMISSION_CLASSES]; /* costs are the bytes of the claims */
};

void memory_queue_init(struct memory_queue *queue, struct admission *admission, enum admission_step step);

/* Queues a waiter whose start, claim and priority are filled. It must not wait anywhere else. */
void memory_queue_add(struct memory_queue *queue, struct memory_lanes *lanes, struct memory_waiter *waiter);

/* Removes a waiter from the queue. Does nothing if it does not wait. */
void memory_queue_remove(struct memory_queue *queue, struct memory_waiter *waiter);

/*
 * Hold a connection, or a user's steps of one class, or release them: while they are held none of them starts. They
 * keep their places.
 */
void memory_queue_hold(struct memory_queue *queue, struct memory_lanes *lanes, bool held);
void memory_queue_hold_turns(struct memory_queue *queue, enum admission_class class, struct memory_turns *turns,
                             bool held);

/* Returns whether a step of that class has its turn earlier in `lanes` than in `other` (fair_queue_is_earlier). */
bool memory_queue_is_earlier(const struct memory_queue *queue, enum admission_class class,
                             const struct memory_lanes *lanes, const struct memory_lanes *other);

/* The number of waiters, including held ones. */
uint32_t memory_queue_count(const struct memory_queue *queue);

/* Promises memory to as many waiters as admission control allows, and starts them. */
void memory_queue_start(struct memory_queue *queue);

#endif

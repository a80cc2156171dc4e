/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/memory_queue.h"
#include "proto/base/container_of.h"

void memory_queue_init(struct memory_queue *queue, struct admission *admission, enum admission_step step)
{
    *queue = (struct memory_queue){.admission = admission, .step = step};
}

static uint32_t fair_priority(int priority)
{
    return priority > 0 ? 0 : priority == 0 ? 1 : 2;
}

void memory_queue_add(struct memory_queue *queue, struct memory_lanes *lanes, struct memory_waiter *waiter)
{
    enum admission_class class = waiter->claim.class;
    fair_queue_add(&queue->waiting[class], &lanes->lanes[class], &waiter->entry, fair_priority(waiter->priority));
}

void memory_queue_remove(struct memory_queue *queue, struct memory_waiter *waiter)
{
    fair_queue_remove(&queue->waiting[waiter->claim.class], &waiter->entry);
}

void memory_queue_hold(struct memory_queue *queue, struct memory_lanes *lanes, bool held)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        fair_queue_hold(&queue->waiting[class], &lanes->lanes[class].node, held);
}

void memory_queue_hold_turns(struct memory_queue *queue, enum admission_class class, struct memory_turns *turns,
                             bool held)
{
    fair_queue_hold(&queue->waiting[class], &turns->nodes[class], held);
}

bool memory_queue_is_earlier(const struct memory_queue *queue, enum admission_class class,
                             const struct memory_lanes *lanes, const struct memory_lanes *other)
{
    return fair_queue_is_earlier(&queue->waiting[class], &lanes->lanes[class], &other->lanes[class]);
}

uint32_t memory_queue_count(const struct memory_queue *queue)
{
    uint32_t count = 0;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        count += queue->waiting[class].count;
    return count;
}

static struct memory_waiter *waiter_of(struct fair_entry *entry)
{
    return container_of(entry, struct memory_waiter, entry);
}

static void start_class(struct memory_queue *queue, enum admission_class class)
{
    struct admission_share *share = admission_share_of(queue->admission, queue->step, class);
    struct fair_queue *waiting = &queue->waiting[class];
    struct fair_entry *entry;
    while ((entry = fair_queue_peek(waiting))) {
        struct memory_waiter *waiter = waiter_of(entry);
        if (!admission_may_start(queue->admission, queue->step, &waiter->claim))
            return;
        fair_queue_pop(waiting, waiter->claim.bytes);
        admission_give(share, waiter->claim.bytes);
        waiter->start(waiter);
    }
}

void memory_queue_start(struct memory_queue *queue)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        start_class(queue, (enum admission_class) class);
}

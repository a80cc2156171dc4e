/* SPDX-License-Identifier: Apache-2.0 */
#include "fair_queue.h"

#include <assert.h>
#include <stddef.h>

/* In front of the lane whose turn it is: at the end of the round. */
static void join_ring(struct fair_queue *queue, struct fair_lane *lane)
{
    struct fair_lane *turn = queue->turn;
    if (!turn) {
        lane->previous = lane->next = lane;
        queue->turn = lane;
        return;
    }
    lane->next = turn;
    lane->previous = turn->previous;
    turn->previous->next = lane;
    turn->previous = lane;
}

static void leave_ring(struct fair_queue *queue, struct fair_lane *lane)
{
    if (queue->turn == lane)
        queue->turn = lane->next == lane ? NULL : lane->next;
    lane->previous->next = lane->next;
    lane->next->previous = lane->previous;
    lane->previous = lane->next = NULL;
}

void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority)
{
    assert(!entry->lane && priority < FAIR_PRIORITIES);
    entry->lane = lane;
    entry->priority = priority;
    entry->next = NULL;
    entry->previous = lane->lists[priority].last;
    if (entry->previous)
        entry->previous->next = entry;
    else
        lane->lists[priority].first = entry;
    lane->lists[priority].last = entry;
    if (lane->count++ == 0)
        join_ring(queue, lane);
    queue->count++;
}

struct fair_entry *fair_queue_peek(const struct fair_queue *queue)
{
    for (int i = 0; queue->turn && i < FAIR_PRIORITIES; i++)
        if (queue->turn->lists[i].first)
            return queue->turn->lists[i].first;
    return NULL;
}

void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry)
{
    struct fair_lane *lane = entry->lane;
    if (!lane)
        return;
    if (entry->previous)
        entry->previous->next = entry->next;
    else
        lane->lists[entry->priority].first = entry->next;
    if (entry->next)
        entry->next->previous = entry->previous;
    else
        lane->lists[entry->priority].last = entry->previous;
    *entry = (struct fair_entry){0};
    queue->count--;
    if (--lane->count == 0)
        leave_ring(queue, lane);
}

void fair_queue_pop(struct fair_queue *queue)
{
    struct fair_lane *lane = queue->turn;
    fair_queue_remove(queue, fair_queue_peek(queue));
    if (queue->turn == lane)
        queue->turn = lane->next;
}

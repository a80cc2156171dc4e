/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/fair_queue.h"

#include <assert.h>

#include "proto/base/container_of.h"

/* Inserts a lane at the end of the ring, level with the others at least. */
static void join_ring(struct fair_queue *queue, struct fair_lane *lane)
{
    if (lane->given < queue->level)
        lane->given = queue->level;
    struct fair_lane *first = queue->ring;
    if (!first) {
        lane->previous = lane->next = lane;
        queue->ring = lane;
        return;
    }
    lane->next = first;
    lane->previous = first->previous;
    first->previous->next = lane;
    first->previous = lane;
}

static void leave_ring(struct fair_queue *queue, struct fair_lane *lane)
{
    if (queue->ring == lane)
        queue->ring = lane->next == lane ? NULL : lane->next;
    lane->previous->next = lane->next;
    lane->next->previous = lane->previous;
    lane->previous = lane->next = NULL;
}

void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority)
{
    assert(!entry->lane && priority < FAIR_PRIORITIES);
    entry->lane = lane;
    entry->priority = priority;
    list_append(&lane->lists[priority], &entry->link);
    if (lane->count++ == 0 && !lane->held)
        join_ring(queue, lane);
    queue->count++;
}

void fair_queue_hold(struct fair_queue *queue, struct fair_lane *lane, bool held)
{
    if (lane->held == held)
        return;
    lane->held = held;
    if (lane->count == 0)
        return;
    if (held)
        leave_ring(queue, lane);
    else
        join_ring(queue, lane);
}

static struct fair_lane *next_lane(const struct fair_queue *queue)
{
    struct fair_lane *least = queue->ring;
    for (struct fair_lane *lane = least ? least->next : NULL; lane && lane != queue->ring; lane = lane->next)
        if (lane->given < least->given)
            least = lane;
    return least;
}

static struct fair_entry *first_of(const struct fair_lane *lane)
{
    int i = 0;
    while (!lane->lists[i].first)
        i++;
    return container_of(lane->lists[i].first, struct fair_entry, link);
}

struct fair_entry *fair_queue_peek(const struct fair_queue *queue)
{
    const struct fair_lane *lane = next_lane(queue);
    return lane ? first_of(lane) : NULL;
}

void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry)
{
    struct fair_lane *lane = entry->lane;
    if (!lane)
        return;
    list_remove(&lane->lists[entry->priority], &entry->link);
    *entry = (struct fair_entry){0};
    queue->count--;
    if (--lane->count == 0 && !lane->held)
        leave_ring(queue, lane);
}

void fair_queue_pop(struct fair_queue *queue, uint64_t cost)
{
    struct fair_lane *lane = next_lane(queue);
    queue->ring = lane->next;
    queue->level = lane->given;
    lane->given += cost;
    fair_queue_remove(queue, first_of(lane));
}

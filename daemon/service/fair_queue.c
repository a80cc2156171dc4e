/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/fair_queue.h"

#include <assert.h>

#include "proto/base/container_of.h"

static struct fair_node *parent_of(struct fair_queue *queue, const struct fair_node *node)
{
    return node->parent ? node->parent : &queue->root;
}

/* Inserts a node at the end of its parent's ring, level with its siblings at least. */
static void join_ring(struct fair_node *parent, struct fair_node *node)
{
    if (node->given < parent->level)
        node->given = parent->level;
    struct fair_node *first = parent->ring;
    if (!first) {
        node->previous = node->next = node;
        parent->ring = node;
        return;
    }
    node->next = first;
    node->previous = first->previous;
    first->previous->next = node;
    first->previous = node;
}

static void leave_ring(struct fair_node *parent, struct fair_node *node)
{
    if (parent->ring == node)
        parent->ring = node->next == node ? NULL : node->next;
    node->previous->next = node->next;
    node->next->previous = node->previous;
    node->previous = node->next = NULL;
}

/* A node that is not held has become ready, or a ready one is released: it takes turns, and so do those above it. */
static void begin_turns(struct fair_queue *queue, struct fair_node *node)
{
    for (struct fair_node *parent; node != &queue->root && !node->held; node = parent) {
        parent = parent_of(queue, node);
        join_ring(parent, node);
        if (parent->ready)
            return;
        parent->ready = true;
    }
}

/* The opposite of begin_turns. */
static void end_turns(struct fair_queue *queue, struct fair_node *node)
{
    for (struct fair_node *parent; node != &queue->root && node->next; node = parent) {
        parent = parent_of(queue, node);
        leave_ring(parent, node);
        if (parent->ring)
            return;
        parent->ready = false;
    }
}

void fair_queue_add(struct fair_queue *queue, struct fair_lane *lane, struct fair_entry *entry, uint32_t priority)
{
    assert(!entry->lane && priority < FAIR_PRIORITIES);
    entry->lane = lane;
    entry->priority = priority;
    list_append(&lane->lists[priority], &entry->link);
    queue->count++;
    if (lane->count++ > 0)
        return;
    lane->node.ready = true;
    begin_turns(queue, &lane->node);
}

void fair_queue_hold(struct fair_queue *queue, struct fair_node *node, bool held)
{
    if (node->held == held)
        return;
    node->held = held;
    if (held)
        end_turns(queue, node);
    else if (node->ready)
        begin_turns(queue, node);
}

/* There must be a child below which something waits. */
static struct fair_node *next_child(const struct fair_node *parent)
{
    struct fair_node *least = parent->ring;
    for (struct fair_node *node = least->next; node != parent->ring; node = node->next)
        if (node->given < least->given)
            least = node;
    return least;
}

static struct fair_entry *first_of(struct fair_node *node)
{
    const struct fair_lane *lane = container_of(node, struct fair_lane, node);
    int i = 0;
    while (!lane->lists[i].first)
        i++;
    return container_of(lane->lists[i].first, struct fair_entry, link);
}

struct fair_entry *fair_queue_peek(const struct fair_queue *queue)
{
    struct fair_node *node = queue->root.ring ? next_child(&queue->root) : NULL;
    while (node && node->ring)
        node = next_child(node);
    return node ? first_of(node) : NULL;
}

void fair_queue_remove(struct fair_queue *queue, struct fair_entry *entry)
{
    struct fair_lane *lane = entry->lane;
    if (!lane)
        return;
    list_remove(&lane->lists[entry->priority], &entry->link);
    *entry = (struct fair_entry){0};
    queue->count--;
    if (--lane->count > 0)
        return;
    lane->node.ready = false;
    end_turns(queue, &lane->node);
}

void fair_queue_pop(struct fair_queue *queue, uint64_t cost)
{
    struct fair_node *node = &queue->root;
    while (node->ring) {
        struct fair_node *child = next_child(node);
        node->ring = child->next;
        node->level = child->given;
        child->given += cost;
        node = child;
    }
    fair_queue_remove(queue, first_of(node));
}

/* What a node would have been given if it came now. */
static uint64_t claim_of(const struct fair_node *parent, const struct fair_node *node)
{
    return node->next || node->given > parent->level ? node->given : parent->level;
}

bool fair_queue_is_earlier(const struct fair_queue *queue, const struct fair_lane *lane, const struct fair_lane *other)
{
    const struct fair_node *a = &lane->node, *b = &other->node;
    if (a->parent != b->parent) {
        a = a->parent ? a->parent : a;
        b = b->parent ? b->parent : b;
    }
    const struct fair_node *parent = a->parent ? a->parent : &queue->root;
    return claim_of(parent, a) < claim_of(parent, b);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/pool_queue.h"

#include <stddef.h>

/* Makes the later of two roots the first child of the other. A root has neither `next` nor `previous`. */
static struct pool_job *meld(struct pool_job *a, struct pool_job *b)
{
    if (!a || !b)
        return a ? a : b;
    struct pool_job *root = pool_queue_before(a, b) ? a : b, *child = root == a ? b : a;
    child->next = root->child;
    if (child->next)
        child->next->previous = child;
    child->previous = root;
    root->child = child;
    return root;
}

/* Takes the first job off a list of siblings, and makes it a root. Returns NULL when the list is empty. */
static struct pool_job *take_sibling(struct pool_job **list)
{
    struct pool_job *job = *list;
    if (job) {
        *list = job->next;
        job->next = job->previous = NULL;
    }
    return job;
}

/* Melds siblings in pairs from the front, then all pairs from the back, which keeps the heap flat. */
static struct pool_job *meld_siblings(struct pool_job *list)
{
    struct pool_job *pairs = NULL, *root = NULL;
    while (list) {
        struct pool_job *one = take_sibling(&list), *other = take_sibling(&list);
        one = meld(one, other);
        one->next = pairs;
        pairs = one;
    }
    while (pairs)
        root = meld(root, take_sibling(&pairs));
    return root;
}

void pool_queue_put(struct pool_queue *queue, struct pool_job *job)
{
    unsigned class = pool_queue_class(job->size);
    job->next = job->previous = job->child = NULL;
    queue->first[class] = meld(queue->first[class], job);
    queue->filled |= UINT64_C(1) << class;
}

static void unlink_child(struct pool_job *job)
{
    if (job->previous->child == job)
        job->previous->child = job->next;
    else
        job->previous->next = job->next;
    if (job->next)
        job->next->previous = job->previous;
}

void pool_queue_remove(struct pool_queue *queue, struct pool_job *job)
{
    unsigned class = pool_queue_class(job->size);
    struct pool_job **root = &queue->first[class], *below = meld_siblings(job->child);
    if (*root == job) {
        *root = below;
    } else {
        unlink_child(job);
        *root = meld(*root, below);
    }
    job->next = job->previous = job->child = NULL;
    if (!*root)
        queue->filled &= ~(UINT64_C(1) << class);
}

static struct pool_job *first_of(const struct pool_queue *queue, uint64_t classes)
{
    struct pool_job *first = NULL;
    for (classes &= queue->filled; classes; classes &= classes - 1) {
        struct pool_job *job = queue->first[__builtin_ctzll(classes)];
        first = !first || pool_queue_before(job, first) ? job : first;
    }
    return first;
}

struct pool_job *pool_queue_first(const struct pool_queue *queue)
{
    return first_of(queue, UINT64_MAX);
}

struct pool_job *pool_queue_first_small(const struct pool_queue *queue, uint64_t most)
{
    if (most == 0)
        return NULL;
    unsigned class = pool_queue_class(most);
    struct pool_job *border = queue->first[class];
    uint64_t classes = (UINT64_C(1) << class) - 1;
    return first_of(queue, border && border->size <= most ? classes | UINT64_C(1) << class : classes);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * list.h - a doubly linked list whose links are members of its items.
 *
 * Adding and removing take constant time and no memory. An item has one `struct list_link` for each list that it can be
 * in at the same time; container_of finds the item of a link. A list that is all zero is empty, and a link that is in
 * no list has no meaning: the owner of the item knows whether it is in one. No function locks anything.
 */
#ifndef BVHD_LIST_H
#define BVHD_LIST_H

#include <stddef.h>

struct list_link {
    struct list_link *previous, *next; /* NULL at the ends */
};

struct list {
    struct list_link *first, *last; /* NULL while the list is empty */
};

/* Adds a link at the end, and list_prepend at the beginning; it must not be in a list. */
static inline void list_append(struct list *list, struct list_link *link)
{
    *link = (struct list_link){.previous = list->last};
    *(list->last ? &list->last->next : &list->first) = link;
    list->last = link;
}

static inline void list_prepend(struct list *list, struct list_link *link)
{
    *link = (struct list_link){.next = list->first};
    *(list->first ? &list->first->previous : &list->last) = link;
    list->first = link;
}

/* Adds a link behind `before`, which is in this list; at the beginning if that is NULL. */
static inline void list_insert_after(struct list *list, struct list_link *before, struct list_link *link)
{
    struct list_link *next = before ? before->next : list->first;
    *link = (struct list_link){before, next};
    *(before ? &before->next : &list->first) = link;
    *(next ? &next->previous : &list->last) = link;
}

/* Removes a link, which must be in this list. */
static inline void list_remove(struct list *list, struct list_link *link)
{
    *(link->previous ? &link->previous->next : &list->first) = link->next;
    *(link->next ? &link->next->previous : &list->last) = link->previous;
    *link = (struct list_link){NULL, NULL};
}

/* Removes the first link and returns it; NULL when the list is empty. */
static inline struct list_link *list_take_first(struct list *list)
{
    struct list_link *first = list->first;
    if (first)
        list_remove(list, first);
    return first;
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * deferred.h - calls that are put off to the end of the loop iteration, so that many events of one iteration are
 * reported in one message.
 *
 * The list owns nothing and never fails: a call is a member of its owner's struct, which may be freed once the call has
 * been cancelled or run. For the loop thread only.
 */
#ifndef BVHD_DEFERRED_H
#define BVHD_DEFERRED_H

#include "proto/base/list.h"

/* The owner zeroes it and sets `run`; it is then on no list. */
struct deferred_call {
    void (*run)(struct deferred_call *call);
    struct list_link link; /* belongs to the list */
};

/* Zeroed means empty. */
struct deferred_calls {
    struct list list;
};

/* Appends a call that is on no list. */
void deferred_add(struct deferred_calls *calls, struct deferred_call *call);

/* Takes a call off the list that it is on. */
void deferred_cancel(struct deferred_calls *calls, struct deferred_call *call);

/* Runs all calls in the order in which they were added, each after it has left the list. */
void deferred_run(struct deferred_calls *calls);

#endif

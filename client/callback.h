/* SPDX-License-Identifier: Apache-2.0 */
/*
 * callback.h - calls the program's functions for batches that are done: from dispatch and from calls that wait, never
 * with the client's lock held. All functions require the lock; callback_run drops it for each call.
 */
#ifndef BVHD_CALLBACK_H
#define BVHD_CALLBACK_H

#include <pthread.h>
#include <stdbool.h>

#include <bvhd/bvhd.h>

/* A call of a program's function that is under way; on the stack of its thread. */
struct callback_call {
    struct callback_call *next;
    struct bvhd_batch *batch; /* NULL: the function has destroyed it */
    pthread_t thread;
};

/* The callbacks of one client. */
struct callbacks {
    struct bvhd_batch *first, *last; /* batches that are done and whose function has to be called */
    struct callback_call *running;
    pthread_cond_t returned; /* a function has returned */
};

void callback_init(struct callbacks *callbacks);
void callback_finish(struct callbacks *callbacks);

/* Has the function of a batch called, if it has one: the batch is done. */
void callback_add(struct bvhd_batch *batch);

/* Calls the functions that have to be called. Returns whether there was one. */
bool callback_run(struct bvhd_client *client);

/*
 * Makes sure that the batch's function is not called any more, and waits while another thread is in it. The batch may
 * be freed afterwards.
 */
void callback_forget(struct bvhd_batch *batch);

#endif

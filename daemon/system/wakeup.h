/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wakeup.h - wakes the loop from other threads.
 *
 * This is not uv_async_send: with libuv 1.44, a loop that a sender has woken waits, spinning, until the sender
 * has left that function. Where the loop takes the sender's own processor, that is for as long as libuv spins, 50
 * microseconds for each result.
 */
#ifndef BVHD_WAKEUP_H
#define BVHD_WAKEUP_H

#include <stdatomic.h>
#include <stdbool.h>
#include <uv.h>

struct wakeup {
    uv_poll_t poll;
    int descriptor; /* an eventfd */
    atomic_bool sent; /* and the loop has not yet begun to answer */
    void (*woken)(void *context);
    void *context;
};

/*
 * Prepares the struct, which must not move. Its function is called on the loop, once or more often after each
 * wakeup_send. Returns false when there is no descriptor or no memory for it; nothing has to be closed then.
 */
bool wakeup_init(struct wakeup *wakeup, uv_loop_t *loop, void (*woken)(void *context), void *context);

/* For any thread, until wakeup_finish. What the thread did before is visible to the function. */
void wakeup_send(struct wakeup *wakeup);

/* Closes the descriptor, after the loop has closed its handle. Does nothing if wakeup_init failed or was not called. */
void wakeup_finish(struct wakeup *wakeup);

#endif

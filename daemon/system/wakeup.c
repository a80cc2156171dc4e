/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/wakeup.h"

#include <assert.h>
#include <errno.h>
#include <sys/eventfd.h>
#include <unistd.h>

/* The flag is cleared before the work is collected: who sends later wakes the loop again. */
static void on_readable(uv_poll_t *poll, int status, int events)
{
    struct wakeup *wakeup = poll->data;
    eventfd_t count;
    (void)status;
    (void)events;
    eventfd_read(wakeup->descriptor, &count);
    atomic_exchange_explicit(&wakeup->sent, false, memory_order_acq_rel);
    wakeup->woken(wakeup->context);
}

bool wakeup_init(struct wakeup *wakeup, uv_loop_t *loop, void (*woken)(void *context), void *context)
{
    int descriptor = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (descriptor < 0)
        return false;
    if (uv_poll_init(loop, &wakeup->poll, descriptor) != 0) {
        close(descriptor);
        return false;
    }
    wakeup->poll.data = wakeup;
    wakeup->descriptor = descriptor;
    wakeup->woken = woken;
    wakeup->context = context;
    atomic_init(&wakeup->sent, false);
    uv_poll_start(&wakeup->poll, UV_READABLE, on_readable);
    return true;
}

void wakeup_send(struct wakeup *wakeup)
{
    if (atomic_exchange_explicit(&wakeup->sent, true, memory_order_acq_rel))
        return;
    while (eventfd_write(wakeup->descriptor, 1) != 0 && errno == EINTR)
        continue;
}

void wakeup_finish(struct wakeup *wakeup)
{
    if (!wakeup->woken)
        return;
    assert(uv_is_closing((uv_handle_t *)&wakeup->poll));
    close(wakeup->descriptor);
    wakeup->woken = NULL;
}

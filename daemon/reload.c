/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/reload.h"

#include <signal.h>
#include <string.h>

static void *read_again(void *argument)
{
    struct reload *reload = argument;
    reload->status = config_reload(reload->config, &reload->fresh, &reload->error);
    wakeup_send(&reload->ended);
    return NULL;
}

/* Signals are blocked on the thread, so that the loop takes them. */
static int start_thread(struct reload *reload)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int number = pthread_create(&reload->thread, NULL, read_again, reload);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return number;
}

enum bvhd_status reload_begin(struct reload *reload, struct bvhd_error *error)
{
    reload->again = reload->runs;
    if (reload->runs)
        return BVHD_OK;
    int number = start_thread(reload);
    if (number)
        return bvhd_error_set(error, BVHD_IO, "reload", "no thread to read the options: %s", strerror(number));
    reload->runs = true;
    return BVHD_OK;
}

static void on_ended(void *context)
{
    struct reload *reload = context;
    if (!reload->runs)
        return;
    pthread_join(reload->thread, NULL);
    reload->runs = false;
    if (reload->again && reload_begin(reload, &reload->error) == BVHD_OK)
        return;
    reload->done(reload->context, reload->status, &reload->fresh, &reload->error);
}

bool reload_init(struct reload *reload, uv_loop_t *loop)
{
    return wakeup_init(&reload->ended, loop, on_ended, reload);
}

void reload_finish(struct reload *reload)
{
    if (reload->runs)
        pthread_join(reload->thread, NULL);
    reload->runs = false;
}

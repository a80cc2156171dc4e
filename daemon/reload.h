/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reload.h - reads the options again while the daemon runs, on a thread of its own: the file may be on a file system
 * that takes its time, and the loop must not wait for it. For the loop thread only.
 */
#ifndef BVHD_RELOAD_H
#define BVHD_RELOAD_H

#include <pthread.h>

#include "daemon/config.h"
#include "daemon/system/wakeup.h"

/* Zeroed: nothing was begun. */
struct reload {
    /* filled before the first call */
    const struct config *config; /* whose command line is read again */
    void (*done)(void *context, enum bvhd_status status, const struct config *fresh, const struct bvhd_error *error);
    void *context;
    /* ---- its own ---- */
    struct wakeup ended;
    pthread_t thread;
    bool runs, again;
    enum bvhd_status status;
    struct config fresh;
    struct bvhd_error error;
};

/* Returns false when there is no descriptor for it. The caller ends `ended` after the loop (wakeup.h). */
bool reload_init(struct reload *reload, uv_loop_t *loop);

/*
 * Begins to read; `done` is called later. While one reading is under way the next one waits for its end, so that the
 * last call reads what the file has then. BVHD_IO when the system starts no thread.
 */
enum bvhd_status reload_begin(struct reload *reload, struct bvhd_error *error);

/* Waits for the thread. `done` is not called any more. */
void reload_finish(struct reload *reload);

#endif

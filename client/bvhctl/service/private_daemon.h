/* SPDX-License-Identifier: Apache-2.0 */
/*
 * private_daemon.h - a daemon that serves one user: bvhctl starts it when it is needed, and it exits when it is idle.
 *
 * Its socket is in a directory that only the user can change. Beside the socket are a lock file, so that only one of
 * several processes starts a daemon at a time, and a file with the daemon's messages. A directory of another user is
 * never used, because its owner could answer on the socket instead.
 */
#ifndef BVHCTL_PRIVATE_DAEMON_H
#define BVHCTL_PRIVATE_DAEMON_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

struct private_place {
    char *directory, *socket; /* their paths */
    bool is_ours; /* bvhctl may create the directory: it is not $XDG_RUNTIME_DIR */
    bool is_safe; /* the directory exists, and only the user can change it */
};

/* Finds the place of the user's daemon, which need not run. End with private_place_finish. */
enum bvhd_status private_daemon_place(struct memory *memory, struct private_place *ret_place, struct bvhd_error *error);
void private_place_finish(struct private_place *place, struct memory *memory);

/* Where a daemon that is started keeps results on disk. */
struct private_cache {
    const char *directory; /* NULL: nowhere */
    uint64_t size; /* the most bytes */
};

/*
 * Returns when a daemon answers on place->socket: one that runs already, one that another process starts, or one that
 * this function starts, for which *ret_is_new becomes true and `cache` counts. BVHD_UNAVAILABLE, with the reason, when
 * none answers until `deadline` (clock_ms) or the new one exits at once.
 */
enum bvhd_status private_daemon_start(struct private_place *place, const struct private_cache *cache, double deadline,
                                      struct memory *memory, bool *ret_is_new, struct bvhd_error *error);

#endif

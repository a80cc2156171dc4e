/* SPDX-License-Identifier: Apache-2.0 */
/*
 * private_daemon.h - a daemon of the user's own, started when it is needed and gone when it is idle.
 *
 * Its socket lies in a directory that only the user can change; beside it a lock file, so that of two that start it at
 * once one does, and a file with its messages. Nobody else's directory is taken for it: whoever owns the directory
 * could answer instead.
 */
#ifndef BVHCTL_PRIVATE_DAEMON_H
#define BVHCTL_PRIVATE_DAEMON_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

struct private_place {
    char *directory, *socket;
    bool is_ours; /* may be made: it is not $XDG_RUNTIME_DIR */
    bool is_safe; /* it is there, and the user's alone */
};

/* Where it would be. Ended with private_place_finish. */
enum bvhd_status private_daemon_place(struct memory *memory, struct private_place *ret_place, struct bvhd_error *error);
void private_place_finish(struct private_place *place, struct memory *memory);

/*
 * Returns when a daemon answers on place->socket: one that is there, one that somebody else starts, or a new one.
 * BVHD_UNAVAILABLE, with the reason, when none does until `deadline` (clock_ms) or the new one ends at once.
 * *ret_is_new: it is the new one.
 */
enum bvhd_status private_daemon_start(struct private_place *place, double deadline, struct memory *memory,
                                      bool *ret_is_new, struct bvhd_error *error);

#endif

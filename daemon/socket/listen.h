/* SPDX-License-Identifier: Apache-2.0 */
/* listen.h - the socket that clients connect to: bound to a path, or handed over by a service manager. */
#ifndef BVHD_LISTEN_H
#define BVHD_LISTEN_H

#include <stdbool.h>
#include <sys/types.h>

#include "proto/base/status.h"

enum { LISTEN_PATH_SIZE = 108 }; /* what a Unix socket's address holds, with the NUL */

struct listener {
    int socket; /* non-blocking, close-on-exec */
    char path[LISTEN_PATH_SIZE]; /* "" for a socket that was handed over: its file is the manager's */
    dev_t device; /* which file was bound: nothing else is removed at the end */
    ino_t inode;
};

/*
 * Binds `path` and listens; the file's mode is 0600. A socket without a listener (of a daemon that died) is replaced;
 * where somebody answers, or the file is no socket, it stays: BVHD_BUSY, BVHD_INVALID. Daemons that start at the same
 * time take turns by a lock on the directory.
 */
enum bvhd_status listen_bind(const char *path, struct listener *ret_listener, struct bvhd_error *error);

/* Takes descriptor `socket`, which has to be a listening Unix stream socket: BVHD_INVALID, and it stays open. */
enum bvhd_status listen_adopt(int socket, struct listener *ret_listener, struct bvhd_error *error);

/* Closes, and removes the file if it is still the one that was bound. NULL-safe; harmless when repeated. */
void listen_close(struct listener *listener);

#endif

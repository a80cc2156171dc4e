/* SPDX-License-Identifier: Apache-2.0 */
/* listen.h - the socket that clients connect to. It is bound to a path, or handed over by a service manager. */
#ifndef BVHD_LISTEN_H
#define BVHD_LISTEN_H

#include <stdbool.h>
#include <sys/types.h>

#include "proto/base/status.h"

enum { LISTEN_PATH_SIZE = 108 }; /* the bytes of a path in a Unix socket's address, with the NUL */

struct listener {
    int socket; /* non-blocking, close-on-exec */
    char path[LISTEN_PATH_SIZE]; /* "" for a socket that was handed over: its file belongs to the service manager */
    dev_t device; /* these two identify the file that was bound: no other file is removed at the end */
    ino_t inode;
};

/*
 * Binds `path` and listens; the file's mode is 0600. A socket on which nobody listens, such as that of a daemon that
 * died, is replaced. Errors: BVHD_BUSY when another process listens there or holds the lock; BVHD_INVALID
 * when the path is empty, too long, or a file that is not a socket; BVHD_IO for errors of the system. An existing file
 * stays in these cases. Daemons that start at the same time are serialised by a lock on a file beside the socket,
 * `path`.listen.lock, which only this user can open, and which is removed again; waiting for it blocks the caller for 5
 * seconds at most.
 */
enum bvhd_status listen_bind(const char *path, struct listener *ret_listener, struct bvhd_error *error);

/*
 * Takes over descriptor `socket`. It has to be a listening Unix stream socket, else the result is BVHD_INVALID, and the
 * descriptor stays the caller's.
 */
enum bvhd_status listen_adopt(int socket, struct listener *ret_listener, struct bvhd_error *error);

/*
 * Closes the socket, and removes its file if that is still the one that was bound. `listener` may be NULL; the call may
 * be repeated.
 */
void listen_close(struct listener *listener);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * connect.h - finds the service that the command line names, and starts a private daemon if a build needs one.
 *
 * With --socket, or else $BVHD_SOCKET, it is the service on that socket: bvhctl waits for it and never starts one.
 * Otherwise bvhctl tries the user's socket ($XDG_RUNTIME_DIR/bvhd.sock, or without such a directory bvhd.sock in a
 * directory of $TMPDIR or /tmp that belongs to the user), then /run/bvhd/bvhd.sock. When neither answers, connect_open
 * starts a private daemon on the user's socket, with a remark on stderr if there is a daemon of the machine that this
 * user is not allowed to connect to.
 */
#ifndef BVHCTL_CONNECT_H
#define BVHCTL_CONNECT_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/options.h"

struct connect {
    struct bvhd_client *client;
    char *path; /* of the socket */
    bool is_private; /* it is the user's private daemon; false for a socket that was named */
    bool is_started; /* this process has started the daemon */
    struct memory *memory;
};

/*
 * Connects and waits until the service has answered. BVHD_UNAVAILABLE after options->connect_timeout_ms, with the
 * socket as `where`. End with connect_close.
 */
enum bvhd_status connect_open(const struct options *options, struct memory *memory, struct connect *ret_connect,
                              struct bvhd_error *error);

/* As connect_open, but starts no daemon: BVHD_UNAVAILABLE at once, with all places, where no socket was named. */
enum bvhd_status connect_find(const struct options *options, struct memory *memory, struct connect *ret_connect,
                              struct bvhd_error *error);

/* Returns the socket that --socket or else $BVHD_SOCKET names, or NULL. */
const char *connect_named_socket(const struct options *options);

/* NULL and a zeroed struct are allowed. */
void connect_close(struct connect *connect);

/* Returns whether a process listens on this socket now. */
bool connect_answers(const char *path);

/*
 * Opens a connection of its own to a socket, without a word of the protocol. Returns a descriptor, or -1 with errno.
 */
int connect_raw(const char *path);

/* Where the system's service listens. */
extern const char connect_system_socket[];

#endif

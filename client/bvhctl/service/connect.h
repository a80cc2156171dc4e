/* SPDX-License-Identifier: Apache-2.0 */
/*
 * connect.h - finds the service that the command line names, and starts a private daemon where there is none.
 *
 * With --socket, or else $BVHD_SOCKET, it is the service on that socket: bvhctl waits for it and never starts one.
 * Otherwise bvhctl tries the user's socket ($XDG_RUNTIME_DIR/bvhd.sock, or without such a directory bvhd.sock in a
 * directory of $TMPDIR or /tmp that belongs to the user), then /run/bvhd/bvhd.sock. When neither answers, it starts a
 * private daemon on the user's socket, with a remark on stderr if there is a daemon of the machine that this user is
 * not allowed to connect to.
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

/* NULL and a zeroed struct are allowed. */
void connect_close(struct connect *connect);

/* Returns whether a process listens on this socket now. */
bool connect_answers(const char *path);

#endif

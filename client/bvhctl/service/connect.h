/* SPDX-License-Identifier: Apache-2.0 */
/*
 * connect.h - the service that the command line means.
 *
 * --socket, else $BVHD_SOCKET: that socket, waited for, never started. Otherwise the user's socket
 * ($XDG_RUNTIME_DIR/bvhd.sock, or without such a directory bvhd.sock in a directory of the user's own in $TMPDIR or
 * /tmp), then /run/bvhd/bvhd.sock, whichever answers; and where none does, a private daemon is started on the user's
 * socket; with a remark on stderr where there is a daemon of the machine that this user may not ask.
 */
#ifndef BVHCTL_CONNECT_H
#define BVHCTL_CONNECT_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/options.h"

struct connect {
    struct bvhd_client *client;
    char *path; /* of the socket */
    bool is_private; /* the user's own daemon; false for a socket that was named, whoever listens there */
    bool is_started; /* by this call, which no other did at the same time */
    struct memory *memory;
};

/*
 * Waits until the service has answered. BVHD_UNAVAILABLE after options->connect_timeout_ms, with the socket as `where`.
 * End with connect_close.
 */
enum bvhd_status connect_open(const struct options *options, struct memory *memory, struct connect *ret_connect,
                              struct bvhd_error *error);

/* NULL-safe, idempotent for a zeroed struct. */
void connect_close(struct connect *connect);

/* Whether somebody listens on this socket now. */
bool connect_answers(const char *path);

#endif

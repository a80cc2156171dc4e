/* SPDX-License-Identifier: Apache-2.0 */
/*
 * daemon_end.h - ends a daemon by SIGTERM, after which it finishes what is under way.
 *
 * The kernel says which process listens on a socket, and decides whether this user may end it. A process that is no
 * bvhd is never sent a signal: where a service manager listens for a daemon, that would be the service manager.
 */
#ifndef BVHCTL_DAEMON_END_H
#define BVHCTL_DAEMON_END_H

#include <stdbool.h>
#include <sys/types.h>

#include "proto/base/status.h"

/*
 * Ends the daemon on a socket, and returns when it is gone. BVHD_UNAVAILABLE: nobody listens. BVHD_UNSUPPORTED: it may
 * not be ended this way, and the text says which way there is. BVHD_BUSY: it has not ended after `timeout_ms`.
 */
enum bvhd_status daemon_end(const char *socket, int timeout_ms, pid_t *ret_process, struct bvhd_error *error);

#endif

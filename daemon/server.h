/* SPDX-License-Identifier: Apache-2.0 */
/* server.h - the daemon as a whole: the event loop, signals and timers, from the first client to the last. */
#ifndef BVHD_SERVER_H
#define BVHD_SERVER_H

#include "daemon/config.h"

/*
 * Listens and serves until a signal (SIGTERM, SIGINT) or idleness ends it. The first signal drains: no new client is
 * accepted, all clients are told, and what is under way has config->drain_ms to finish. A second signal ends it at
 * once. Fails only before it has accepted any client.
 */
enum bvhd_status server_run(const struct config *config, struct bvhd_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* server.h - the daemon as a whole: the loop, its signals, from the first client to the last. */
#ifndef BVHD_SERVER_H
#define BVHD_SERVER_H

#include "daemon/config.h"

/*
 * Listens and serves until a signal (SIGTERM, SIGINT) or idleness ends it. A first signal drains: nobody new is let in,
 * clients are told, and what is under way has config->drain_ms to finish; a second one ends at once. Fails only before
 * it has served anybody.
 */
enum bvhd_status server_run(const struct config *config, struct bvhd_error *error);

#endif

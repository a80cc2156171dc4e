/* SPDX-License-Identifier: Apache-2.0 */
/* server.h - the daemon as a whole: the event loop, signals and timers, from the first client to the last. */
#ifndef BVHD_SERVER_H
#define BVHD_SERVER_H

#include "daemon/config.h"

/*
 * Runs the event loop on the calling thread, and serves clients until a signal (SIGTERM, SIGINT), or
 * config->idle_exit_ms without clients, ends it. The first signal drains the daemon: no new client is accepted, all
 * clients get GOODBYE, and work under way has config->drain_ms to finish. A second signal ends it at once. SIGHUP reads
 * the options again, and changes `config` and the daemon as far as it can while it runs. The function fails
 * only at the start, before a client is accepted.
 */
enum bvhd_status server_run(struct config *config, struct bvhd_error *error);

#endif

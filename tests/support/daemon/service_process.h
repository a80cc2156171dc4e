/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_process.h - a daemon of one's own, for tests and benchmarks: started on a socket in a fresh directory,
 * stopped and cleaned away.
 *
 * For test programs only: what cannot be done is said on stderr and ends the program. The daemon dies with its parent.
 */
#ifndef BVHD_SERVICE_PROCESS_H
#define BVHD_SERVICE_PROCESS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

struct service_process {
    pid_t pid;
    char directory[64];
    char socket[96];
    char log[96]; /* its stderr */
};

/*
 * `program`: the path of bvhd; `options`: further words, NULL-terminated, may be NULL. Returns once the socket answers.
 */
void service_process_start(struct service_process *service, const char *program, const char *const *options);

/*
 * SIGTERM, then waits. True when it left with status 0 within ten seconds; otherwise it is killed and its log is shown.
 */
bool service_process_stop(struct service_process *service);

/* SIGKILL, and waits. The directory stays until service_process_stop. */
void service_process_kill(struct service_process *service);

/* Starts it again on the same socket. */
void service_process_restart(struct service_process *service, const char *program, const char *const *options);

bool service_process_runs(struct service_process *service);

/* Of the daemon, from /proc; 0 when it is gone. */
uint64_t service_process_resident(const struct service_process *service);
uint32_t service_process_descriptors(const struct service_process *service);

#endif

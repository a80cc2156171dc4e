/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_process.h - a separate daemon for tests and benchmarks: it is started on a socket in a new directory,
 * stopped, and its directory removed. It keeps nothing on disk, unless its options have --cache.
 *
 * For test programs only: failures on this side are printed to stderr and end the program. The daemon dies with its
 * parent.
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
    char log[96]; /* path of a file with its stderr */
    int status; /* of a process that has ended by itself, as waitpid returns it */
};

/*
 * Starts `program`, the path of bvhd. `options` are further arguments, terminated by NULL, and may be NULL. Returns
 * when the socket answers.
 */
void service_process_start(struct service_process *service, const char *program, const char *const *options);

/* Makes the directory, without a daemon. */
void service_process_init(struct service_process *service);

/*
 * Sends SIGTERM and waits. Returns true when the daemon exits with status 0 within ten seconds; otherwise it is killed
 * and its log is printed.
 */
bool service_process_stop(struct service_process *service);

/* The same, but the directory stays, with the log. */
bool service_process_end(struct service_process *service);

/* Sends SIGKILL and waits. The directory stays until service_process_stop. */
void service_process_kill(struct service_process *service);

/* Starts the daemon again on the same socket. */
void service_process_restart(struct service_process *service, const char *program, const char *const *options);

/* The same, but returns false if the daemon ends, or does not answer for twenty seconds, and is killed then. */
bool service_process_try_restart(struct service_process *service, const char *program, const char *const *options);

bool service_process_runs(struct service_process *service);

/* The daemon's resident memory in bytes and its number of open descriptors, from /proc; 0 when it does not run. */
uint64_t service_process_resident(const struct service_process *service);
uint32_t service_process_descriptors(const struct service_process *service);

#endif

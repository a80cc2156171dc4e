/* SPDX-License-Identifier: Apache-2.0 */
/*
 * process_view.h - what a process holds, as the kernel sees it: descriptors by kind, memory of its own, memory in
 * results. It is independent of what the process says of itself.
 *
 * For test programs only. The process may run meanwhile; what vanishes while it is looked at does not count.
 */
#ifndef BVHD_PROCESS_VIEW_H
#define BVHD_PROCESS_VIEW_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

enum process_kind {
    PROCESS_SOCKET,
    PROCESS_RESULT, /* a memfd that the daemon has made */
    PROCESS_MEMFD, /* another memfd: a pool, a payload */
    PROCESS_EVENT, /* eventfd, epoll, timerfd, signalfd, io_uring */
    PROCESS_PIPE,
    PROCESS_FILE, /* everything else */
    PROCESS_KINDS
};

struct process_descriptors {
    uint32_t count[PROCESS_KINDS];
};

struct process_descriptors process_descriptors(pid_t pid);

/* Writes "3 sockets, 1 memfd, ..." */
void process_descriptors_text(const struct process_descriptors *descriptors, char ret_text[160]);

/*
 * Returns the process's private memory in bytes: what it has allocated and touched, without pages that it has given
 * back to the system and that the system has not needed yet (MADV_FREE).
 */
uint64_t process_private_bytes(pid_t pid);

/* Returns the bytes of the memfds of results that these processes have open, each counted once. */
uint64_t process_result_bytes(const pid_t *pids, uint32_t count);

#endif

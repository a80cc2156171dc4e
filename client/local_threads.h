/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_threads.h - the threads of a client that build in this process, if the program allows any. They are started
 * when there is work for them, and block all signals. Requires the client's lock.
 *
 * One thread drives: it lets the others take items until there are none. Threads that have no item help to build those
 * of the others.
 */
#ifndef BVHD_LOCAL_THREADS_H
#define BVHD_LOCAL_THREADS_H

#include <pthread.h>
#include <stdbool.h>

#include "proto/base/status.h"

struct bvhd_client;

struct local_threads {
    unsigned allowed; /* number of threads; 0: none */
    bool is_started, stop;
    pthread_t driver;
    pthread_cond_t work; /* there is an item to build, or `stop` is set */
};

void local_threads_init(struct local_threads *threads, unsigned allowed);

/* Lets the threads build, and starts them if necessary. Fails with BVHD_NO_MEMORY or BVHD_IO. */
enum bvhd_status local_threads_wake(struct bvhd_client *client, struct bvhd_error *error);

/* Ends the threads and waits for that, without the client's lock. */
void local_threads_finish(struct bvhd_client *client);

#endif

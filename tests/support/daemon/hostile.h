/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile.h - shared by tests with hostile clients: a daemon, whether it still serves others, and its counters.
 *
 * For test programs only. Failures are printed and counted; hostile_end returns their number.
 */
#ifndef BVHD_HOSTILE_H
#define BVHD_HOSTILE_H

#include "tests/support/daemon/raw_client.h"
#include "tests/support/daemon/service_process.h"

struct hostile {
    const char *program; /* path of bvhd */
    struct service_process service;
    uint64_t memory_base, descriptors_base; /* values of the idle daemon */
};

/* Starts a daemon and notes what it holds without clients. */
void hostile_begin(struct hostile *hostile, const char *program, const char *const *options);

/* Checks that the daemon is alive and exits cleanly. Returns the number of failures so far. */
int hostile_end(struct hostile *hostile);

/*
 * Connects, and says HELLO: as that user if this process may connect as others (raw_can_be_others), else as its own.
 * Ends the program when the daemon does not welcome it.
 */
void hostile_connect_as(const struct hostile *hostile, struct raw_client *client, unsigned uid);

/* Prints the text and counts a failure unless `good`. */
__attribute__((format(printf, 2, 3))) void hostile_expect(bool good, const char *format, ...);

/* Checks that a small build of another client is answered within `limit_ms`. Returns how many milliseconds it took. */
double hostile_serves(struct hostile *hostile, const char *when, double limit_ms);

/* The value of a counter, read on a separate connection. */
uint64_t hostile_counter(struct hostile *hostile, const char *name);

/*
 * Checks that connections, memory, pools and descriptors return to their values of the idle daemon within `limit_ms`.
 */
void hostile_expect_clean(struct hostile *hostile, const char *when, double limit_ms);

double hostile_now(void); /* milliseconds of a monotonic clock */

#endif

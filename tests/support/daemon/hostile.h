/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile.h - what tests with hostile clients share: a daemon, whether it still serves others, its counters.
 *
 * For test programs only. Failures are printed and counted; hostile_end returns the exit status.
 */
#ifndef BVHD_HOSTILE_H
#define BVHD_HOSTILE_H

#include "tests/support/daemon/raw_client.h"
#include "tests/support/daemon/service_process.h"

struct hostile {
    const char *program; /* bvhd */
    struct service_process service;
    uint64_t memory_base, descriptors_base; /* of the idle daemon */
};

/* Starts a daemon and notes what it has when nobody is there. */
void hostile_begin(struct hostile *hostile, const char *program, const char *const *options);

/* The daemon must be alive and leave well. Returns the number of failures so far. */
int hostile_end(struct hostile *hostile);

/* Prints the text and counts a failure unless `good`. */
__attribute__((format(printf, 2, 3))) void hostile_expect(bool good, const char *format, ...);

/* Somebody else's small build is answered within `limit_ms`. Says how long it took. */
double hostile_serves(struct hostile *hostile, const char *when, double limit_ms);

/* The value of a counter, by a connection of its own. */
uint64_t hostile_counter(struct hostile *hostile, const char *name);

/* Connections, memory, pools and descriptors are back to what they were, within `limit_ms`. */
void hostile_expect_clean(struct hostile *hostile, const char *when, double limit_ms);

double hostile_now(void); /* milliseconds */

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * library.h - what all clients of a process share: the memory for results, which may outlive their client, and the
 * clock.
 */
#ifndef BVHD_LIBRARY_H
#define BVHD_LIBRARY_H

#include <stdint.h>

#include "proto/base/clock.h"
#include "proto/base/memory.h"

/* The memory of all clients, without a limit. Tests make it fail, and check that nothing is left. */
extern struct memory library_memory;

/* Nanoseconds in a millisecond; and a moment that never comes. */
#define LIBRARY_MS UINT64_C(1000000)
#define LIBRARY_NEVER UINT64_MAX

/* Returns the moment `ms` milliseconds after `now`, in ns; LIBRARY_NEVER if `ms` is negative. */
uint64_t library_after(uint64_t now, int64_t ms);

/*
 * Returns the timeout for poll to wait until `moment`: in milliseconds, rounded up, so that the moment has come
 * afterwards; -1 for LIBRARY_NEVER.
 */
int library_poll_ms(uint64_t now, uint64_t moment);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* library.h - what all clients of a process share: the memory that results may outlive them in, and the clock. */
#ifndef BVHD_LIBRARY_H
#define BVHD_LIBRARY_H

#include <stdint.h>

#include "proto/base/clock.h"
#include "proto/base/memory.h"

/* Without a limit; tests let it fail and count what is left. */
extern struct memory library_memory;

#define LIBRARY_MS UINT64_C(1000000)
#define LIBRARY_NEVER UINT64_MAX

/* The moment `ms` milliseconds after `now`; LIBRARY_NEVER for a negative number. */
uint64_t library_after(uint64_t now, int64_t ms);

/* What poll takes to wait until `moment`: rounded up, so that the moment has come afterwards; -1 for LIBRARY_NEVER. */
int library_poll_ms(uint64_t now, uint64_t moment);

#endif

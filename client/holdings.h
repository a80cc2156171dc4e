/* SPDX-License-Identifier: Apache-2.0 */
/*
 * holdings.h - what the program holds of one connection's results: bytes of mapped descriptors, which count in the
 * daemon until it is told that they are released. Results may outlive their connection and their client, so holdings
 * are shared by reference counting. Functions are for any thread unless they say otherwise.
 */
#ifndef BVHD_HOLDINGS_H
#define BVHD_HOLDINGS_H

#include <stdbool.h>
#include <stdint.h>

struct holdings;

/* Creates holdings with one reference. `most` is how many bytes the program may hold. Returns NULL without memory. */
struct holdings *holdings_create(uint64_t most);

/* `holdings` may be NULL. */
struct holdings *holdings_ref(struct holdings *holdings);
void holdings_unref(struct holdings *holdings);

/*
 * A result has come. Returns whether the program may hold it: if not, the caller copies what it needs, and calls
 * holdings_release at once.
 */
bool holdings_add(struct holdings *holdings, uint64_t size);

/* The program does not hold a result any more. */
void holdings_release(struct holdings *holdings, uint64_t size);

/* Returns the bytes that were released since the last call, and of which the daemon has to be told. */
uint64_t holdings_collect(struct holdings *holdings);

#endif

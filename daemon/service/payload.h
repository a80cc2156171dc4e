/* SPDX-License-Identifier: Apache-2.0 */
/*
 * payload.h - the bytes of geometry that a client sent, wherever they lie: in a frame, in the connection's pool, or in
 * a memfd of their own.
 *
 * A descriptor is checked before it is used. It must be a memfd without huge pages that can be read, has the seals that
 * its use needs, and has exactly the declared size, which need not be a multiple of the page size.
 *
 * * A pool is sealed SHRINK|GROW, so that reading its mapping cannot fault at the end. It is not sealed WRITE, since
 *   then nobody could fill it; prepare.h copes with an owner that writes while it is read. Reading pages that the owner
 *   has left empty allocates them, so the whole size of a pool counts against the limit on all pools.
 * * A one-shot memfd is sealed SHRINK|GROW|WRITE|SEAL and has no holes, so that reading it allocates nothing and its
 *   bytes never change. Pages that were only reserved by fallocate count as holes.
 *
 * Other seals (FUTURE_WRITE, EXEC) are allowed, but replace none of these.
 */
#ifndef BVHD_PAYLOAD_H
#define BVHD_PAYLOAD_H

#include <stdatomic.h>

#include "daemon/system/descriptor_share.h"
#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* Bytes with a count of refs; the last payload_unref unmaps or frees them. Both are for any thread. */
struct payload;

/*
 * A descriptor from a client, and what was declared about it.
 *
 * The two functions that open one are for any thread. They take the descriptor, close it (on failure by
 * release_descriptor), and give back its count. BVHD_INVALID says what is wrong with it ("pool": "not sealed
 * against shrinking"), BVHD_TOO_LARGE means more than `max_size`, BVHD_IO says what the system refused; BVHD_NO_MEMORY.
 */
struct payload_file {
    int descriptor;
    uint64_t size; /* as declared, in bytes; 0 is BVHD_INVALID */
    uint64_t max_size;
    const char *where; /* its name in errors: "pool", "items[3].payload" */
    struct memory *memory; /* for the struct, which it must outlive; mapped bytes are not counted */
    struct descriptor_share *share; /* to which the descriptor is charged; NULL: it is not counted */
};

/* Opens a pool. */
enum bvhd_status payload_open_pool(const struct payload_file *file, struct payload **ret_payload,
                                   struct bvhd_error *error);

/* Opens a one-shot memfd. The search for holes checks the entry of each page, and takes about 10 us per MiB. */
enum bvhd_status payload_open_memfd(const struct payload_file *file, struct payload **ret_payload,
                                    struct bvhd_error *error);

/* Makes a private copy in `memory`, which must outlive it. There may be no bytes at all. BVHD_NO_MEMORY. */
enum bvhd_status payload_copy(struct bytes bytes, struct memory *memory, struct payload **ret_payload,
                              struct bvhd_error *error);

struct payload *payload_ref(struct payload *payload);
void payload_unref(struct payload *payload);

/* The bytes are aligned to 16 at least. Those of a pool may change at any time. */
struct bytes payload_bytes(const struct payload *payload);

#endif

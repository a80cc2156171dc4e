/* SPDX-License-Identifier: Apache-2.0 */
/*
 * payload.h - bytes that a client sent, wherever they lie: in a frame, in the connection's pool, in a memfd of its own.
 *
 * Descriptors are checked before they are used: nothing but a memfd that is no huge page file, has the seals that its
 * use needs, can be read, and has exactly the size that was declared, which need not be a multiple of pages. A pool is
 * sealed SHRINK|GROW (mapping it cannot fault at its end; its owner may still write, which prepare.h allows for) and
 * not WRITE, since nobody could fill it. A one-shot memfd is sealed SHRINK|GROW|WRITE|SEAL and has no holes, so reading
 * it allocates nothing and never changes; pages that were only reserved by fallocate count as holes. Pages of a pool
 * that its owner leaves empty are allocated by reading them: a pool's whole size counts against `pool_bytes`. Other
 * seals (FUTURE_WRITE, EXEC) do no harm and are no substitute.
 */
#ifndef BVHD_PAYLOAD_H
#define BVHD_PAYLOAD_H

#include <stdatomic.h>

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* Shared; the last unref unmaps. ref and unref from any thread. */
struct payload;

/*
 * Each takes the descriptor and closes it, also when it fails, then with release_descriptor; giving back its count is
 * the caller's. From any thread. BVHD_INVALID says what is wrong with it ("pool": "not sealed against shrinking"),
 * BVHD_TOO_LARGE over `max_size`, BVHD_NO_MEMORY, BVHD_IO what the system refused.
 */
struct payload_file {
    int descriptor;
    uint64_t size; /* as declared; 0 is BVHD_INVALID */
    uint64_t max_size;
    const char *where; /* how errors call it: "pool", "items[3].payload" */
    struct memory *memory; /* for the struct; must outlive it. Mapped bytes are not counted in it */
};

enum bvhd_status payload_open_pool(const struct payload_file *file, struct payload **ret_payload,
                                   struct bvhd_error *error);

/* Looks at every page's entry in search of holes: some 10 us for each MiB. */
enum bvhd_status payload_open_memfd(const struct payload_file *file, struct payload **ret_payload,
                                    struct bvhd_error *error);

/* A private copy, from `memory`, which must outlive it. Empty bytes are fine. */
enum bvhd_status payload_copy(struct bytes bytes, struct memory *memory, struct payload **ret_payload,
                              struct bvhd_error *error);

struct payload *payload_ref(struct payload *payload);
void payload_unref(struct payload *payload);

/* 16-byte aligned at least. The bytes of a pool may change at any time. */
struct bytes payload_bytes(const struct payload *payload);

#endif

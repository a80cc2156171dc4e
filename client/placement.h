/* SPDX-License-Identifier: Apache-2.0 */
/*
 * placement.h - places payloads in memory where the daemon can read them.
 *
 * Most payloads lie in the pool: one memfd that daemon and client keep mapped, because making pages costs more than
 * copying. A payload that the pool cannot hold gets its own memfd. (The smallest travel inside frames and need no
 * place.) The pool outlives connections: payloads can be placed before there is one.
 */
#ifndef BVHD_PLACEMENT_H
#define BVHD_PLACEMENT_H

#include "client/arena.h"
#include "proto/base/geometry.h"
#include "proto/base/status.h"

/* The most payload memfds that may exist at once, because each holds a descriptor, and memory as large as a scene. */
enum { PLACEMENT_MAX_MEMFDS = 8 };

enum held_kind { HELD_NOTHING = 0, HELD_POOL, HELD_MEMFD };

/* The place of one payload. */
struct held {
    enum held_kind kind;
    int descriptor; /* HELD_MEMFD */
    uint64_t offset; /* HELD_POOL */
    uint64_t size;
};

/* The pool, and the number of payloads in their own memfds. */
struct placement {
    struct memory *memory;
    uint64_t wanted_size; /* of the pool, from the options */
    uint64_t pool_size; /* the allowed size or, if the pool exists, its size; 0: no pool */
    int descriptor; /* -1: the pool does not exist yet */
    unsigned char *bytes;
    struct arena arena;
    uint64_t touched; /* bytes at the pool's front whose pages exist */
    uint32_t memfds;
    /*
     * the daemon does not take the pool: only payloads that also fit into a frame (FRAME_MAX_INLINE) are placed in it
     */
    bool is_refused;
};

void placement_init(struct placement *placement, struct memory *memory, uint64_t pool_size);

/* Frees the pool and forgets the payloads in it. Payloads in memfds must have been released before. */
void placement_finish(struct placement *placement);

/* Sets whether the daemon refuses the pool. */
void placement_refuse(struct placement *placement, bool is_refused);

/*
 * Limits the pool to `size` bytes, the daemon's maximum. Returns false if an existing pool with payloads in it is
 * larger.
 */
bool placement_limit(struct placement *placement, uint64_t size);

/*
 * Places a copy of the payload of a description (rows_write), `size` bytes, not 0. BVHD_BUSY: there is no room until a
 * payload is released. BVHD_NO_MEMORY, BVHD_IO: waiting would not help.
 */
enum bvhd_status placement_take(struct placement *placement, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error);

/*
 * Place a payload in its own memfd in two steps, so that the copy needs no lock. placement_reserve returns false if too
 * many memfds exist. Otherwise placement_fill may be called from any thread and, if it fails, placement_unreserve.
 */
bool placement_reserve(struct placement *placement);
enum bvhd_status placement_fill(struct memory *memory, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error);
void placement_unreserve(struct placement *placement);

/* Returns the bytes of a payload in the pool. */
const unsigned char *placement_bytes(const struct placement *placement, const struct held *held);

/* Moves a payload from the pool to its own memfd. Fails as placement_take does, and then changes nothing. */
enum bvhd_status placement_move_out(struct placement *placement, struct held *held, struct bvhd_error *error);

/* Releases a payload and sets HELD_NOTHING; a payload that is HELD_NOTHING already is allowed. */
void placement_release(struct placement *placement, struct held *held);

#endif

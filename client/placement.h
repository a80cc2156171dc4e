/* SPDX-License-Identifier: Apache-2.0 */
/*
 * placement.h - where payloads lie until the daemon has read them.
 *
 * Most lie in the pool: one memfd that daemon and client keep mapped, since making pages costs more than copying. What
 * the pool cannot hold gets a memfd of its own. (The smallest travel inside of frames and need no place.) The pool
 * outlives connections: payloads can be placed before there is one.
 */
#ifndef BVHD_PLACEMENT_H
#define BVHD_PLACEMENT_H

#include "client/arena.h"
#include "proto/base/geometry.h"
#include "proto/base/status.h"

/* Memfds of their own that may be out at once: each holds a descriptor, and memory as large as a scene. */
enum { PLACEMENT_MAX_MEMFDS = 8 };

enum held_kind { HELD_NOTHING = 0, HELD_POOL, HELD_MEMFD };

struct held {
    enum held_kind kind;
    int descriptor; /* HELD_MEMFD */
    uint64_t offset; /* HELD_POOL */
    uint64_t size;
};

struct placement {
    struct memory *memory;
    uint64_t wanted_size; /* of the pool, by the options */
    uint64_t pool_size; /* what is allowed; when the pool exists, how large it is. 0: none */
    int descriptor; /* -1: the pool does not exist yet */
    unsigned char *bytes;
    struct arena arena;
    uint64_t touched; /* bytes of the pool, from its front, whose pages exist */
    uint32_t memfds;
    bool is_refused; /* the daemon does not take the pool: it holds only what can leave it by a frame */
};

void placement_init(struct placement *placement, struct memory *memory, uint64_t pool_size);

/* What is out is forgotten, but for memfds, which their holders release before. */
void placement_finish(struct placement *placement);

/* Whether the daemon takes the pool at all. */
void placement_refuse(struct placement *placement, bool is_refused);

/* A daemon takes a pool of at most `size` bytes. False when the one that exists, with payloads in it, is larger. */
bool placement_limit(struct placement *placement, uint64_t size);

/*
 * Copies the payload of a description (rows_write), `size` bytes, not 0. BVHD_BUSY: there is no room until something is
 * released. BVHD_NO_MEMORY, BVHD_IO: it will not get better.
 */
enum bvhd_status placement_take(struct placement *placement, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error);

/*
 * A memfd of its own in two steps, so that the copy needs no lock: false when too many are out; then placement_fill,
 * from any thread, and where that fails placement_unreserve.
 */
bool placement_reserve(struct placement *placement);
enum bvhd_status placement_fill(struct memory *memory, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error);
void placement_unreserve(struct placement *placement);

/* The bytes of a payload in the pool. */
const unsigned char *placement_bytes(const struct placement *placement, const struct held *held);

/* From the pool to a memfd of its own. Fails as placement_take, then nothing has changed. */
enum bvhd_status placement_move_out(struct placement *placement, struct held *held, struct bvhd_error *error);

/* Leaves HELD_NOTHING, from which it does nothing. */
void placement_release(struct placement *placement, struct held *held);

#endif

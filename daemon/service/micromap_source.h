/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micromap_source.h - finds and holds the opacity micromaps that the triangles of an item name, while the item is
 * prepared.
 *
 * Their keys are in the rows of its payload, which a worker reads, but the cache belongs to the loop. So the worker
 * lists the keys and stops; the loop looks them up in memory; and the worker goes on and reads the rest from disk.
 * While an item waits for more memory it holds no micromaps: the loop looks them up again before it goes on.
 */
#ifndef BVHD_MICROMAP_SOURCE_H
#define BVHD_MICROMAP_SOURCE_H

#include "daemon/service/cache.h"
#include "daemon/service/disk.h"
#include "proto/base/geometry.h"

/* The most references of an item that may be micromaps: the loop looks all of them up at once. */
enum { MICROMAP_SOURCES_MOST = 4096 };

struct micromap_source {
    struct key key;
    struct blob *blob; /* a ref; NULL: not found yet, or not there */
    bool is_read; /* the blob has come from disk, and the cache does not know it */
    const void *mapped; /* the bytes of its descriptor, while they are open */
};

/* All 0: nothing is listed. */
struct micromap_sources {
    struct micromap_source *rows; /* from `memory`, sorted by key, each key once */
    uint32_t count;
    struct memory *memory; /* the caller's affair, as is the disk; both outlive the sources */
    struct disk *disk; /* where the rest may be; NULL: nowhere */
};

/* Returns whether an input names micromaps. */
bool micromap_sources_are_named(const struct build_input *input);

/*
 * Lists the keys of the micromaps that the input names; nothing may be listed yet. BVHD_TOO_LARGE for more than
 * MICROMAP_SOURCES_MOST references, BVHD_NO_MEMORY. `index` is the item's, for errors.
 */
enum bvhd_status micromap_sources_list(struct micromap_sources *sources, const struct build_input *input,
                                       uint32_t index, struct bvhd_error *error);

/* Takes from the cache what is there; for the loop thread. */
void micromap_sources_look_up(struct micromap_sources *sources, struct cache *cache);

/*
 * Reads what is missing from disk while all together have at most `room` bytes. *ret_size: the bytes of all that were
 * found; if they are more than `room`, some have not been read. Blocks: for workers. What is not there, or cannot be
 * read, stays missing. BVHD_CANCELLED; BVHD_NO_MEMORY, and BVHD_BUSY without free descriptors.
 */
enum bvhd_status micromap_sources_read(struct micromap_sources *sources, uint64_t room, const atomic_bool *cancel,
                                       uint64_t *ret_size, struct bvhd_error *error);

/*
 * Sets the bytes of those references of an input that are micromaps, up to micromap_sources_close; those that are
 * missing, or were not listed, get none. Returns BVHD_INVALID with the place for the key of another structure, and
 * BVHD_NO_MEMORY without address space; then nothing is open.
 */
enum bvhd_status micromap_sources_open(struct micromap_sources *sources, struct reference *references, uint32_t count,
                                       uint32_t index, struct bvhd_error *error);
void micromap_sources_close(struct micromap_sources *sources);

/* Puts what has come from disk into the cache, and drops all refs; for the loop thread. The list remains. */
void micromap_sources_keep(struct micromap_sources *sources, struct cache *cache);

/* Drops the refs and the list. For any thread. */
void micromap_sources_finish(struct micromap_sources *sources);

#endif

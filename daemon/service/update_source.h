/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_source.h - finds and holds what an update starts from: the blob of its source, and the source's record
 * (builder/update/record.h).
 *
 * The item takes a blob that is in memory when it starts, so that an eviction afterwards does not matter. What is not
 * in memory is read from disk on the worker that prepares the update.
 */
#ifndef BVHD_UPDATE_SOURCE_H
#define BVHD_UPDATE_SOURCE_H

#include "builder/update/build_entry.h"
#include "daemon/service/disk.h"

/* All 0: nothing is updated. */
struct update_source {
    struct blob *blob; /* a ref; NULL: not found yet, or there is none */
    struct disk *disk; /* where the rest may be; NULL: nowhere */
    struct disk_record record; /* of a blob that has none itself; its memory and its room are the caller's affair */
    bool is_read; /* the blob has come from disk, and the cache does not know it */
};

/*
 * The first looks on disk for a blob that is missing; the second, which is called after it, for the blob's record,
 * if record.room suffices. Both block: for workers. A source that was built without ALLOW_UPDATE is found, and has no
 * record. Returns BVHD_SOURCE_LOST, with the key in the text, for a source that is not there, or whose record is not;
 * BVHD_TOO_LARGE, with record.size, for a record that needs more room; BVHD_CANCELLED; BVHD_NO_MEMORY, and BVHD_BUSY
 * without free descriptors. `index` is the item's, for errors.
 */
enum bvhd_status update_source_find(struct update_source *source, const struct key *key, uint32_t index,
                                    const atomic_bool *cancel, struct bvhd_error *error);
enum bvhd_status update_source_find_record(struct update_source *source, const struct key *key, uint32_t index,
                                           const atomic_bool *cancel, struct bvhd_error *error);

/* Returns the record; no bytes: the source was built without ALLOW_UPDATE. */
struct bytes update_source_record(const struct update_source *source);

/*
 * Maps the blob, if there is one, until update_source_close, and describes it for build_entry_make. Returns
 * BVHD_NO_MEMORY without address space.
 */
enum bvhd_status update_source_open(const struct update_source *source, struct build_entry_source *ret_opened,
                                    struct bvhd_error *error);
void update_source_close(const struct update_source *source, const struct build_entry_source *opened);

/* Drops the ref and the record. */
void update_source_finish(struct update_source *source);

#endif

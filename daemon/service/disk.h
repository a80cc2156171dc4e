/* SPDX-License-Identifier: Apache-2.0 */
/*
 * disk.h - the daemon's cache on disk: results that outlive the daemon, in a store (builder/store/store.h).
 *
 * The record of a structure that was built with ALLOW_UPDATE is an entry of its own, under a key that follows from the
 * structure's (content_key_of_record). It has no summary, by which a reader of results knows that it is none.
 *
 * Workers read from it, and a thread of its own writes to it (disk_writer.h), so that neither the loop nor a reply
 * waits for a disk. A disk that fails, is full or holds damaged files costs builds and nothing else.
 */
#ifndef BVHD_DISK_H
#define BVHD_DISK_H

#include "builder/store/store.h"
#include "daemon/service/blob.h"

struct disk_options {
    const char *directory;
    uint64_t budget; /* the most bytes on disk */
    uint64_t queue; /* the most bytes of results that wait to be written */
    uint64_t ready; /* the most bytes of memfds that are ready for results to be read (ready_memfds.h) */
    unsigned readers; /* threads that read */
};

struct disk;

/*
 * Opens the directory, which is made if it is missing, and starts the thread. The errors are those of store_open,
 * BVHD_TOO_LARGE for a directory whose absolute path is longer than CACHE_STATE can say (CONTROL_PATH_SIZE), and
 * BVHD_IO when the system starts no thread, BVHD_BUSY without free descriptors. The results that are read count in
 * `account`, which must outlive the disk.
 */
enum bvhd_status disk_open(const struct disk_options *options, struct blob_account *account, struct disk **ret_disk,
                           struct bvhd_error *error);

/*
 * Writes what is queued, for DISK_CLOSE_MS at most, and closes the store. No other call may be under way or follow.
 * NULL-safe.
 */
enum { DISK_CLOSE_MS = 5000 };
void disk_close(struct disk *disk);

/*
 * Reads the result of a key into a new blob with one ref, and verifies it; a long one on several of the threads of
 * `parallel` (store_get). Blocks: for workers. BVHD_NOT_FOUND;
 * BVHD_CANCELLED after `cancel` was set; BVHD_BUSY without free descriptors; BVHD_NO_MEMORY; BVHD_IO.
 */
enum bvhd_status disk_read(struct disk *disk, const struct key *key, const struct parallel *parallel,
                           const atomic_bool *cancel, struct blob **ret_blob, struct bvhd_error *error);

/* A result that is read if it is not too large. */
struct disk_result {
    uint64_t room; /* bytes; a larger one is not read */
    struct blob *blob; /* out, if it was read: one ref; else NULL */
    uint64_t size; /* out, with BVHD_OK and with BVHD_TOO_LARGE: bytes of the result */
};

/* Reads the result of a key as disk_read does. BVHD_TOO_LARGE: it has more bytes than there is room for. */
enum bvhd_status disk_read_within(struct disk *disk, const struct key *key, const atomic_bool *cancel,
                                  struct disk_result *result, struct bvhd_error *error);

/*
 * Prepares memory for the next results that are read, which takes a while, on a thread. To be called when those that
 * were read have been sent.
 */
void disk_rest(struct disk *disk);

/* A record that is read: how large it may be, and where its bytes go, a block from `memory`. */
struct disk_record {
    uint64_t room; /* bytes; a larger one is not read */
    struct memory *memory;
    struct bytes bytes; /* out, if it was read */
    uint64_t size; /* out, with BVHD_TOO_LARGE: bytes of a record that is larger than `room` */
};

/*
 * Reads the record of a key (builder/update/record.h). Blocks: for workers. The statuses are those of disk_read, and
 * BVHD_TOO_LARGE; the bytes are not trusted.
 */
enum bvhd_status disk_read_record(struct disk *disk, const struct key *key, const atomic_bool *cancel,
                                  struct disk_record *record, struct bvhd_error *error);

/*
 * Queues a result to be written, with its record if it has one, or drops it if too much is queued. Never blocks: for
 * the loop.
 */
void disk_keep(struct disk *disk, struct blob *blob);

/*
 * Removes the least recently used entries until at most `bytes` are left; removes all of them. Results that are queued
 * are written before, so that they do not come afterwards. Both block: for workers.
 * The errors are those of store_trim_to and store_clear, and BVHD_BUSY without free descriptors.
 */
enum bvhd_status disk_trim(struct disk *disk, uint64_t bytes, struct bvhd_error *error);
enum bvhd_status disk_clear(struct disk *disk, struct bvhd_error *error);

struct disk_state {
    struct store_state store;
    uint64_t read_errors; /* entries that could not be read, for other reasons than damage */
    uint64_t dropped; /* results that were not written because too much was queued */
    uint64_t queued, queued_bytes; /* results that wait to be written */
    uint64_t ready_bytes; /* of memfds that are ready for results to be read */
};

/* For any thread. */
struct disk_state disk_state(const struct disk *disk);

/* Returns the directory as an absolute path, without symbolic links. */
const char *disk_directory(const struct disk *disk);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * disk_writer.h - the thread that writes results to the store, counts what is there when it starts, and trims the
 * store.
 *
 * Results wait in a queue that is bounded in number and in bytes. What does not fit is dropped and counted, except that
 * an empty queue takes a result of any size. The queue holds refs, so a result may leave the cache before it is
 * written.
 */
#ifndef BVHD_DISK_WRITER_H
#define BVHD_DISK_WRITER_H

#include "builder/store/store.h"
#include "daemon/service/blob.h"

/*
 * The most results in the queue, and how often the writer checks whether the store needs a trim although nothing was
 * written.
 */
enum { DISK_WRITER_MOST = 4096, DISK_WRITER_CHECK_SECONDS = 60 };

struct disk_writer;

/* Starts the thread. `most_bytes` bounds the queue. BVHD_NO_MEMORY; BVHD_IO when the system starts no thread. */
enum bvhd_status disk_writer_create(struct store *store, uint64_t most_bytes, struct memory *memory,
                                    struct disk_writer **ret_writer, struct bvhd_error *error);

/* Waits until the queue is written, or until `patience_ms` have passed; then drops what is left. NULL-safe. */
void disk_writer_destroy(struct disk_writer *writer, uint64_t patience_ms);

/* Queues a ref to the result, or drops it. For any thread; never blocks on a disk. */
void disk_writer_add(struct disk_writer *writer, struct blob *blob);

/* Waits until everything that is queued now has been written or has failed. Blocks: for workers. */
void disk_writer_flush(struct disk_writer *writer);

struct disk_writer_load {
    uint64_t queued, queued_bytes; /* including the result that is being written */
    uint64_t dropped; /* results so far */
};

struct disk_writer_load disk_writer_load(struct disk_writer *writer);

#endif

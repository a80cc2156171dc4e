/* SPDX-License-Identifier: Apache-2.0 */
/*
 * blob.h - a serialized structure in memory: immutable bytes, their key, and data about the build that made them.
 *
 * A blob of up to BLOB_INLINE_MAX bytes lies in memory and is sent inside frames. A larger one is a memfd sealed
 * SHRINK|GROW|WRITE|SEAL, whose descriptor is sent to every waiter, so that a hit copies nothing. Nobody who holds the
 * descriptor, or opens it again through /proc, can change the bytes. All holders share the file offset, which any of
 * them may move, so readers map the memfd or use pread. They map it with MAP_PRIVATE: before Linux 6.7 a shared mapping
 * of a write-sealed memfd is refused.
 *
 * A blob_writer makes a blob, either as the build_output of one build or of bytes that come in pieces.
 *
 * Of a build: below BLOB_MAPPED_MIN bytes the build writes memory whose pages are
 * warm, and the memfd is written in one go at the end: faults on fresh pages of a memfd cost more than the copy. From
 * that size on, the build writes the mapped pages of the memfd. That is as quick, since pages of memory would be fresh
 * too; it takes half the memory, and the threads that write share the faults.
 *
 * Of pieces: each is copied to the mapped pages of a memfd that was ready, or written to a fresh one as it comes.
 */
#ifndef BVHD_BLOB_H
#define BVHD_BLOB_H

#include "builder/context.h"
#include "daemon/system/descriptors.h"
#include "daemon/system/ready_memfds.h"
#include "proto/base/bytes.h"
#include "proto/base/key.h"
#include "proto/base/summary.h"

enum { BLOB_INLINE_MAX = 64 * 1024, BLOB_MAPPED_MIN = 4 * 1024 * 1024 };

/* Counts all blobs of a service. For any thread. */
struct blob_account {
    struct memory *memory; /* for small blobs and the structs; it has no limit */
    struct descriptors *descriptors;
    /* of all blobs that exist, whether the cache or a reply holds them, and of those that are being written */
    _Atomic uint64_t live_bytes;
    _Atomic uint64_t live_blobs;
};

/* Constant once it is shared. blob_ref and blob_unref are for any thread. */
struct blob {
    atomic_uint refs;
    struct blob_account *account;
    struct key key;
    uint64_t size;
    const unsigned char *bytes; /* NULL if there is a descriptor */
    int descriptor; /* a sealed memfd, in which the blob begins at offset 0; -1 if there are bytes */
    struct summary summary;
    struct bytes
        record; /* what updates of it need (builder/update/record.h), from the account; no bytes: none is known */
    bool is_from_disk; /* it may have a record there */
};

void blob_account_init(struct blob_account *account, struct memory *memory, struct descriptors *descriptors);

struct blob *blob_ref(struct blob *blob);
void blob_unref(struct blob *blob);

/*
 * Used on one thread: blob_writer_init; then build() with context.output = &writer.output, or blob_writer_begin and
 * blob_writer_append; then blob_writer_finish after success, else blob_writer_discard. If the blob will need a
 * descriptor, it is taken from the account when the bytes are allocated, provided that DESCRIPTORS_RESERVE stay free.
 */
struct blob_writer {
    struct build_output output;
    struct blob_account *account;
    unsigned char *bytes; /* where the build or the pieces are written; NULL: nowhere yet, or to the descriptor */
    uint64_t size; /* of the blob; 0 while nothing is allocated */
    uint64_t mapped; /* bytes of the memfd that `bytes` maps; 0: it maps none */
    uint64_t filled; /* bytes that came in pieces */
    int descriptor; /* of the memfd, once there is one; else -1 */
    /* why the build got no bytes: BVHD_NO_MEMORY, BVHD_BUSY without free descriptors, BVHD_IO */
    struct bvhd_error error;
};

void blob_writer_init(struct blob_writer *writer, struct blob_account *account);

/*
 * Allocates a blob of `size` bytes, in a memfd of `ready` if there is one (NULL: there is none); then adds its bytes in
 * order and in pieces, `size` in all. blob_writer_room returns where the next piece will be, so that it can be written
 * there before it is added; NULL: nobody knows yet. The statuses of failures are those of `error` above; the writer
 * must then be discarded.
 */
enum bvhd_status blob_writer_begin(struct blob_writer *writer, uint64_t size, struct ready_memfds *ready,
                                   struct bvhd_error *error);
unsigned char *blob_writer_room(struct blob_writer *writer, uint64_t size);
enum bvhd_status blob_writer_append(struct blob_writer *writer, const void *bytes, uint64_t size,
                                    struct bvhd_error *error);

/*
 * Makes a blob with one ref of what was written, and seals it. The caller fills in key and summary before it shares the
 * blob. On failure, with a status as above, the writer holds nothing.
 */
enum bvhd_status blob_writer_finish(struct blob_writer *writer, struct blob **ret_blob, struct bvhd_error *error);

/* Keeps a copy of the record with a blob that is not shared yet and has none. BVHD_NO_MEMORY. */
enum bvhd_status blob_set_record(struct blob *blob, struct bytes record, struct bvhd_error *error);

/* Frees what was written. Does nothing if nothing is allocated, or after blob_writer_finish. */
void blob_writer_discard(struct blob_writer *writer);

#endif

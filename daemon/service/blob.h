/* SPDX-License-Identifier: Apache-2.0 */
/*
 * blob.h - a built structure: immutable bytes, their key, and what is known about them (side data).
 *
 * Up to BLOB_INLINE_MAX bytes lie in memory and are sent inside frames; larger ones are a memfd sealed
 * SHRINK|GROW|WRITE|SEAL whose descriptor is sent to every waiter, so that a hit copies nothing. Nobody who holds the
 * descriptor, or opens it again through /proc, can change the bytes. All holders share its file offset, which anyone
 * may move: map it (MAP_PRIVATE: before Linux 6.7 a shared mapping of a write-sealed memfd is refused), or pread.
 *
 * blob_writer is the build_output of one build. Below BLOB_MAPPED_MIN bytes the build writes memory whose pages are
 * warm, and the memfd is written at once at the end: faults on fresh pages of a memfd cost more than the copy. From
 * there on the pages are mapped and written in place: as quick, since the memory's own pages would be fresh too, with
 * half the memory, and the threads that write share the faults.
 */
#ifndef BVHD_BLOB_H
#define BVHD_BLOB_H

#include "builder/build.h"
#include "daemon/system/descriptors.h"
#include "proto/base/key.h"

enum { BLOB_INLINE_MAX = 64 * 1024, BLOB_MAPPED_MIN = 4 * 1024 * 1024 };

/* What all blobs of a service count in; from any thread. */
struct blob_account {
    struct memory *memory; /* for small blobs and the structs; has no limit of its own */
    struct descriptors *descriptors;
    /* of all blobs that exist, cached or on their way, and of those that are being written */
    _Atomic uint64_t live_bytes;
    _Atomic uint64_t live_blobs;
};

/* Constant once it is shared; ref and unref from any thread. */
struct blob {
    atomic_uint refs;
    struct blob_account *account;
    struct key key;
    uint64_t size;
    const unsigned char *bytes; /* NULL when there is a descriptor */
    int descriptor; /* -1 when there are bytes; sealed, the blob begins at offset 0 */
    enum target target; /* whose layout the bytes have */
    struct build_stats stats;
    double build_ms; /* of the build that made it */
    uint64_t peak_bytes; /* most memory that building it took */
};

void blob_account_init(struct blob_account *account, struct memory *memory, struct descriptors *descriptors);

struct blob *blob_ref(struct blob *blob);
void blob_unref(struct blob *blob);

/*
 * One build's output, on a worker: init, build() with context.output = &writer.output, then finish when the build
 * succeeded, else discard. A descriptor is taken from the account when bytes are allocated for which one will be
 * needed, DESCRIPTORS_RESERVE kept free.
 */
struct blob_writer {
    struct build_output output;
    struct blob_account *account;
    unsigned char *bytes; /* NULL while there are none */
    uint64_t size;
    int descriptor; /* -1 unless its pages are what is written */
    /* why allocate gave nothing: BVHD_NO_MEMORY, BVHD_BUSY without free descriptors, BVHD_IO */
    struct bvhd_error error;
};

void blob_writer_init(struct blob_writer *writer, struct blob_account *account);

/*
 * Seals what the build wrote. The blob has one ref; key, target, stats, build_ms and peak_bytes are for the caller to
 * fill before it shares the blob. On failure (as above) nothing is held.
 */
enum bvhd_status blob_writer_finish(struct blob_writer *writer, struct blob **ret_blob, struct bvhd_error *error);

/* Harmless when nothing was allocated, and after finish. */
void blob_writer_discard(struct blob_writer *writer);

#endif

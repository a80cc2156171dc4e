/* SPDX-License-Identifier: Apache-2.0 */
/*
 * blob.h - a built structure: immutable bytes, their key, and what is known about them (side data).
 *
 * Up to BLOB_INLINE_MAX bytes lie in memory and are sent inside frames; larger ones are a memfd sealed SHRINK|GROW|WRITE|SEAL whose descriptor
 * is sent to every waiter, so that a hit copies nothing. A build writes straight into its pages: blob_writer is the build_output of one build.
 */
#ifndef BVHD_BLOB_H
#define BVHD_BLOB_H

#include "build.h"
#include "descriptors.h"
#include "key.h"

enum { BLOB_INLINE_MAX = 64 * 1024 };

/* What all blobs of a service count in; from any thread. */
struct blob_account {
    struct memory *memory; /* for small blobs and the structs; has no limit of its own */
    struct descriptors *descriptors;
    _Atomic uint64_t live_bytes; /* of all blobs that exist, cached or on their way */
    _Atomic uint64_t live_blobs;
};

/* Constant once it is made; ref and unref from any thread. */
struct blob {
    atomic_uint refs;
    struct blob_account *account;
    struct key key;
    uint64_t size;
    const unsigned char *bytes; /* NULL when there is a descriptor */
    int descriptor; /* -1 when there are bytes; read only, at offset 0 of the blob's bytes */
    struct build_stats stats;
    double build_ms; /* of the build that made it */
    uint64_t peak_bytes; /* most memory that building it took */
};

struct blob *blob_ref(struct blob *blob);
void blob_unref(struct blob *blob);

/* One build's output, on a worker: init, build() with context.output = &writer.output, then exactly one of finish and discard. */
struct blob_writer {
    struct build_output output;
    struct blob_account *account;
    unsigned char *bytes;
    uint64_t size;
    int descriptor;
    struct bvhd_error error; /* why allocate gave nothing: BVHD_NO_MEMORY, BVHD_BUSY without free descriptors, BVHD_IO */
};

void blob_writer_init(struct blob_writer *writer, struct blob_account *account);

/* Seals what the build wrote. The blob has one ref; key, stats and build_ms are for the caller to fill before it shares the blob. */
enum bvhd_status blob_writer_finish(struct blob_writer *writer, struct blob **ret_blob, struct bvhd_error *error);
void blob_writer_discard(struct blob_writer *writer);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* memfd.h - memory behind a descriptor, to be shared with the daemon. */
#ifndef BVHD_MEMFD_H
#define BVHD_MEMFD_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * A new memfd of `size` bytes (not 0), close-on-exec, open for sealing, mapped for reading and writing; pages come as
 * they are touched. BVHD_NO_MEMORY, BVHD_IO ("memfd").
 */
enum bvhd_status memfd_create_mapped(const char *name, uint64_t size, int *ret_descriptor, unsigned char **ret_bytes,
                                     struct bvhd_error *error);

/* BVHD_IO. */
enum bvhd_status memfd_seal(int descriptor, int seals, struct bvhd_error *error);

/* The same without a size or a mapping: for writing to. */
enum bvhd_status memfd_open(const char *name, int *ret_descriptor, struct bvhd_error *error);

/*
 * Fills a part of a memfd, piece after piece. Where pages do not exist yet writing takes half the time of copying into
 * a mapping: what is written whole is not cleared before, and there are no faults. Small pieces are gathered.
 */
struct memfd_writer {
    struct memory *memory;
    int descriptor; /* the caller's */
    uint64_t offset; /* of what is gathered */
    unsigned char *gathered;
    uint64_t used;
    struct bvhd_error *error; /* of all calls; may be NULL */
};

/* BVHD_NO_MEMORY. */
enum bvhd_status memfd_writer_init(struct memfd_writer *writer, int descriptor, uint64_t offset, struct memory *memory,
                                   struct bvhd_error *error);

/* BVHD_NO_MEMORY, BVHD_IO. */
enum bvhd_status memfd_writer_put(struct memfd_writer *writer, struct bytes piece);

/*
 * Writes what is still gathered, unless `status` says that something failed before; the outcome of all. The writer is
 * finished.
 */
enum bvhd_status memfd_writer_finish(struct memfd_writer *writer, enum bvhd_status status);

#endif

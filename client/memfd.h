/* SPDX-License-Identifier: Apache-2.0 */
/* memfd.h - memory behind a descriptor, to be shared with the daemon. */
#ifndef BVHD_MEMFD_H
#define BVHD_MEMFD_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Creates a memfd of `size` bytes (not 0), close-on-exec, that can be sealed, and maps it for reading and writing. Its
 * pages are allocated when they are touched. Fails with BVHD_NO_MEMORY or BVHD_IO ("memfd").
 */
enum bvhd_status memfd_create_mapped(const char *name, uint64_t size, int *ret_descriptor, unsigned char **ret_bytes,
                                     struct bvhd_error *error);

/* Adds F_SEAL_ flags. Fails with BVHD_NO_MEMORY or BVHD_IO. */
enum bvhd_status memfd_seal(int descriptor, int seals, struct bvhd_error *error);

/* Creates such a memfd with size 0 and without a mapping, for a memfd_writer. */
enum bvhd_status memfd_open(const char *name, int *ret_descriptor, struct bvhd_error *error);

/*
 * Fills a range of a memfd piece by piece. If the pages do not exist yet, writing takes half the time of copying into a
 * mapping: pages that are written as a whole need not be cleared first, and there are no page faults. Small pieces are
 * gathered.
 */
struct memfd_writer {
    struct memory *memory;
    int descriptor; /* belongs to the caller */
    uint64_t offset; /* of the first gathered byte */
    unsigned char *gathered;
    uint64_t used;
    struct bvhd_error *error; /* for all calls; may be NULL */
};

/* Starts a writer at `offset`. Fails with BVHD_NO_MEMORY. */
enum bvhd_status memfd_writer_init(struct memfd_writer *writer, int descriptor, uint64_t offset, struct memory *memory,
                                   struct bvhd_error *error);

/* Appends a piece. Fails with BVHD_NO_MEMORY or BVHD_IO. */
enum bvhd_status memfd_writer_put(struct memfd_writer *writer, struct bytes piece);

/*
 * Ends the writer and returns the outcome of all its calls. Gathered bytes are written, unless `status` is an earlier
 * failure.
 */
enum bvhd_status memfd_writer_finish(struct memfd_writer *writer, enum bvhd_status status);

#endif

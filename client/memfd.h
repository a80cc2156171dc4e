/* SPDX-License-Identifier: Apache-2.0 */
/* memfd.h - memory behind a descriptor, to be shared with the daemon. */
#ifndef BVHD_MEMFD_H
#define BVHD_MEMFD_H

#include "bytes.h"
#include "memory.h"
#include "status.h"

/*
 * A new memfd of `size` bytes (not 0), close-on-exec, open for sealing, mapped for reading and writing; pages come as they are touched. BVHD_NO_MEMORY,
 * BVHD_IO ("memfd").
 */
enum bvhd_status memfd_create_mapped(const char *name, uint64_t size, int *ret_descriptor, unsigned char **ret_bytes,
                                     struct bvhd_error *error);

/* BVHD_IO. */
enum bvhd_status memfd_seal(int descriptor, int seals, struct bvhd_error *error);

/*
 * A memfd that is filled from its front. Writing takes half the time of copying into a mapping: pages that are written whole are not cleared before, and
 * there are no faults. Small pieces are gathered.
 */
struct memfd_writer {
    struct memory *memory;
    int descriptor;
    unsigned char *gathered;
    uint64_t used;
    struct bvhd_error *error; /* of all calls; may be NULL */
};

/* Fails as memfd_create_mapped; then nothing is held. */
enum bvhd_status memfd_writer_init(struct memfd_writer *writer, const char *name, struct memory *memory, struct bvhd_error *error);

enum bvhd_status memfd_writer_put(struct memfd_writer *writer, struct bytes piece);

/* The descriptor, with all that was put; the writer is finished, also on failure. */
enum bvhd_status memfd_writer_complete(struct memfd_writer *writer, int *ret_descriptor);

/* Throws away what was written. */
void memfd_writer_finish(struct memfd_writer *writer);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* memfd.h - makes the memfds that hold results, before they are sealed. For any thread. */
#ifndef BVHD_MEMFD_H
#define BVHD_MEMFD_H

#include <stdint.h>

#include "proto/base/status.h"

/* A memfd whose `size` bytes are mapped for writing. */
struct memfd {
    int descriptor;
    unsigned char *bytes;
    uint64_t size;
};

/*
 * Makes an empty memfd. The caller has counted the descriptor (descriptors.h), and closes it. BVHD_NO_MEMORY; BVHD_IO.
 */
enum bvhd_status memfd_make(int *ret_descriptor, struct bvhd_error *error);

/*
 * Makes the pages of `size` bytes from `offset` on exist, and the memfd that long, because a page fault that gets no
 * page ends the process. The statuses are those of memfd_make.
 */
enum bvhd_status memfd_reserve(int descriptor, uint64_t offset, uint64_t size, struct bvhd_error *error);

/* Maps the first `size` bytes for writing. The statuses are those of memfd_make. */
enum bvhd_status memfd_map(int descriptor, uint64_t size, struct memfd *ret_memfd, struct bvhd_error *error);

/* Ends the mapping: a memfd that is mapped for writing cannot be sealed against it. */
void memfd_unmap(const struct memfd *memfd);

/* Returns the status for what errno says about a memfd, and sets the error. */
enum bvhd_status memfd_refused(struct bvhd_error *error, const char *what);

#endif

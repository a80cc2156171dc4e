/* SPDX-License-Identifier: Apache-2.0 */
/* memfd.h - memory behind a descriptor, to be shared with the daemon. */
#ifndef BVHD_MEMFD_H
#define BVHD_MEMFD_H

#include "bytes.h"
#include "status.h"

/*
 * A new memfd of `size` bytes (not 0), close-on-exec, open for sealing, mapped for reading and writing; pages come as they are touched. BVHD_NO_MEMORY,
 * BVHD_IO ("memfd").
 */
enum bvhd_status memfd_create_mapped(const char *name, uint64_t size, int *ret_descriptor, unsigned char **ret_bytes,
                                     struct bvhd_error *error);

/* BVHD_IO. */
enum bvhd_status memfd_seal(int descriptor, int seals, struct bvhd_error *error);

#endif

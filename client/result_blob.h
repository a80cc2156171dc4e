/* SPDX-License-Identifier: Apache-2.0 */
/* result_blob.h - the bytes of a result, shared by whoever holds a ref. Refs from any thread. */
#ifndef BVHD_RESULT_BLOB_H
#define BVHD_RESULT_BLOB_H

#include <bvhd/bvhd.h>

#include "proto/base/bytes.h"
#include "proto/base/status.h"

/* Copies bytes, not none. BVHD_NO_MEMORY. */
enum bvhd_status result_blob_copy(struct bytes bytes, struct bvhd_blob **ret_blob, struct bvhd_error *error);

/*
 * Maps the first `size` bytes, not 0, of a memfd that must be sealed SHRINK|GROW|WRITE and at least as long. Takes the
 * descriptor, also when it fails: BVHD_CORRUPT (what was sent is not that), BVHD_NO_MEMORY, BVHD_IO.
 */
enum bvhd_status result_blob_map(int descriptor, uint64_t size, struct bvhd_blob **ret_blob, struct bvhd_error *error);

#endif

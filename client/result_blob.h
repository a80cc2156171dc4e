/* SPDX-License-Identifier: Apache-2.0 */
/*
 * result_blob.h - the bytes of a result, shared by reference counting. References may be taken and dropped from any
 * thread.
 */
#ifndef BVHD_RESULT_BLOB_H
#define BVHD_RESULT_BLOB_H

#include <bvhd/bvhd.h>

#include "client/holdings.h"
#include "client/result_blocks.h"
#include "proto/base/bytes.h"
#include "proto/base/key.h"
#include "proto/base/status.h"

/* Makes a blob with a copy of `bytes`, at least one. Fails with BVHD_NO_MEMORY. */
enum bvhd_status result_blob_copy(struct bytes bytes, struct bvhd_blob **ret_blob, struct bvhd_error *error);

/* The same, but the copy may share a block with other results. */
enum bvhd_status result_blob_copy_into(struct bytes bytes, struct result_blocks *blocks, struct bvhd_blob **ret_blob,
                                       struct bvhd_error *error);

/*
 * Makes a blob of a block of library_memory. It takes the block over, even if it fails with BVHD_NO_MEMORY.
 */
enum bvhd_status result_blob_take(void *data, uint64_t size, struct bvhd_blob **ret_blob, struct bvhd_error *error);

/*
 * Lets updates in this process find a blob that is not shared yet, as local_source_create says. BVHD_NO_MEMORY. The
 * second function returns the record; no bytes: there is none.
 */
enum bvhd_status result_blob_set_source(struct bvhd_blob *blob, const struct key *key, struct bytes record,
                                        struct bvhd_error *error);
struct bytes result_blob_record(const struct bvhd_blob *blob);

/* Takes another reference, unless the last one is gone already. */
bool result_blob_try_ref(struct bvhd_blob *blob);

/*
 * Makes a blob by mapping the first `size` bytes (not 0) of a memfd, which must be sealed SHRINK|GROW|WRITE and be at
 * least as long. It takes the descriptor over, even if it fails: with BVHD_CORRUPT (the descriptor is not such a
 * memfd), BVHD_NO_MEMORY or BVHD_IO. The bytes count in `holdings` until the blob is freed; they are copied if that
 * exceeds what may be held. `holdings` may be NULL: the daemon does not count them.
 */
enum bvhd_status result_blob_map(int descriptor, uint64_t size, struct holdings *holdings, struct bvhd_blob **ret_blob,
                                 struct bvhd_error *error);

#endif

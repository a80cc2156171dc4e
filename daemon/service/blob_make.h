/* SPDX-License-Identifier: Apache-2.0 */
/*
 * blob_make.h - makes a blob of what a preparation holds, by a build or by an update.
 */
#ifndef BVHD_BLOB_MAKE_H
#define BVHD_BLOB_MAKE_H

#include "daemon/service/blob.h"
#include "daemon/service/preparation.h"

/*
 * Runs the build or the update, for which it maps its source. `context` needs no output. The blob has one ref, the key
 * of the preparation, and, with ALLOW_UPDATE, its record. The preparation can be used again after a failure. Blocks:
 * for workers. Errors are those of build_entry_make and of blob_writer.
 */
enum bvhd_status blob_make(struct preparation *preparation, struct blob_account *account,
                           const struct build_context *context, struct blob **ret_blob, struct bvhd_error *error);

#endif

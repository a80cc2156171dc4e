/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_sources.h - finds by key the structures that were built in this process and may be updated in it. Any of them
 * is found as long as something holds its blob: a batch, or the program.
 *
 * The table belongs to the process, has a lock of its own, and may be used from any thread.
 */
#ifndef BVHD_LOCAL_SOURCES_H
#define BVHD_LOCAL_SOURCES_H

#include <bvhd/bvhd.h>

#include "proto/base/bytes.h"
#include "proto/base/key.h"
#include "proto/base/status.h"

/* What an update needs of a structure beside its bytes. It belongs to the structure's blob. */
struct local_source;

/*
 * Enters a blob that is not shared yet, under its key. `record` (builder/update/record.h) is copied; a structure that
 * was built without ALLOW_UPDATE has no bytes of it. BVHD_NO_MEMORY.
 */
enum bvhd_status local_source_create(struct bvhd_blob *blob, const struct key *key, struct bytes record,
                                     struct local_source **ret_source, struct bvhd_error *error);

/* Removes it, when the last reference to its blob is gone. NULL is allowed. */
void local_source_destroy(struct local_source *source);

struct bytes local_source_record(const struct local_source *source);

/* Returns a new reference to a blob of that key, or NULL. */
struct bvhd_blob *local_sources_find(const struct key *key);

#endif

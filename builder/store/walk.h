/* SPDX-License-Identifier: Apache-2.0 */
/*
 * walk.h - visits all files of a store's directory, of all generations. Files and folders that have none of the store's
 * names are passed over, so that a directory that was named by mistake loses nothing.
 */
#ifndef BVHD_WALK_H
#define BVHD_WALK_H

#include "builder/store/store_internal.h"

enum walk_kind { WALK_ENTRY, WALK_DAMAGED, WALK_TEMPORARY };

struct walk_file {
    enum walk_kind kind;
    const char *generation, *folder, *name; /* its path below the directory */
    int descriptor; /* of its folder */
    uint64_t bytes; /* as store_bytes_of */
    int64_t used_ns; /* its time of modification, since the epoch */
};

struct walk {
    /* Called for each file. A status other than BVHD_OK ends the walk. */
    enum bvhd_status (*visit)(struct walk *walk, const struct walk_file *file, struct bvhd_error *error);
    bool all; /* remove the empty folders of all generations, and not only of other ones than the store's */
};

/*
 * Returns the first status of `visit` that is not BVHD_OK, BVHD_CANCELLED when the store's flag is set, or BVHD_IO when
 * a folder cannot be read. What vanishes meanwhile is no error.
 */
enum bvhd_status walk_run(struct walk *walk, const struct store *store, struct bvhd_error *error);

/* Returns whether this may be a generation's name: "release-" or "development-", then lower-case letters and digits. */
bool walk_is_generation(const char *name);

#endif

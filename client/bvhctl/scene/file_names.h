/* SPDX-License-Identifier: Apache-2.0 */
/*
 * file_names.h - the names of the files that structures of a scene are written to.
 *
 * The file of a bottom level is "SCENE.blas-NAME-DIGEST.as": NAME is that of its mesh or node, and is missing if the
 * file gives it none; DIGEST is a checksum of its geometry and its names. So a name depends on nothing but the
 * structure's own source: it stays when neighbours come and go or are moved in the file, and when the options of the
 * build change. Bottom levels with equal names have equal geometry, and share a file.
 */
#ifndef BVHCTL_FILE_NAMES_H
#define BVHCTL_FILE_NAMES_H

#include "client/bvhctl/scene/import.h"

struct file_names {
    char **files; /* of the bottom levels in the order of the import, then of the top level: bottom_count + 1 */
    uint32_t *first; /* of each: the number of the first one with the same name */
    uint32_t count;
    struct memory *memory;
};

/* Makes the names, with only letters, digits and . _ - in them. BVHD_NO_MEMORY. End with file_names_finish. */
enum bvhd_status file_names_make(const struct import *import, struct file_names *ret_names, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void file_names_finish(struct file_names *names);

/*
 * Returns the scene's name in the form that file names begin with. The caller frees it with memory_free. NULL when
 * there is no memory.
 */
char *file_names_safe(const char *name, struct memory *memory);

#endif

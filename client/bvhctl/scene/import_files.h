/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_files.h - the file system as assimp sees it: reading only, regular files only, and a record of what was read.
 */
#ifndef BVHCTL_IMPORT_FILES_H
#define BVHCTL_IMPORT_FILES_H

#include <assimp/cfileio.h>
#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

struct import_files {
    struct aiFileIO io; /* to hand to assimp */
    char **paths; /* in the order of opening, each once */
    uint32_t count, capacity;
    bool failed; /* no memory for the record */
    struct memory *memory;
};

/* Nothing is held at first; the paths and their array, from `memory`, are the caller's to free. */
void import_files_init(struct import_files *files, struct memory *memory);

#endif

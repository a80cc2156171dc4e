/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_files.h - the file system that assimp gets: it can only read regular files, and it records which ones it read.
 */
#ifndef BVHCTL_IMPORT_FILES_H
#define BVHCTL_IMPORT_FILES_H

#include <assimp/cfileio.h>
#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

struct import_files {
    struct aiFileIO io; /* for assimp */
    char **paths; /* of the files that were opened, in that order, each once */
    uint32_t count, capacity;
    bool failed; /* there was no memory for the record */
    struct memory *memory;
};

/* Prepares an empty record. The caller frees each path and the array with memory_free. */
void import_files_init(struct import_files *files, struct memory *memory);

#endif

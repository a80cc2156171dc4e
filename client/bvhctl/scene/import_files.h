/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_files.h - the files that readers of scenes read: only regular ones, and each is recorded. It is the file
 * system that assimp gets, too.
 */
#ifndef BVHCTL_IMPORT_FILES_H
#define BVHCTL_IMPORT_FILES_H

#include <assimp/cfileio.h>
#include <stdbool.h>
#include <stdint.h>

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

struct import_files {
    struct aiFileIO io; /* for assimp */
    char **paths; /* of the files that were opened, in that order, each once */
    uint32_t count, capacity;
    bool failed; /* there was no memory for the record */
    struct memory *memory;
};

/* Prepares an empty record. The caller frees each path and the array with memory_free. */
void import_files_init(struct import_files *files, struct memory *memory);

/*
 * Maps a whole file, and records it. Others can change the bytes while they are read, and a file that becomes shorter
 * ends the process, which is the child that reads scenes: so each value has to be read once, and checked as a copy. The
 * caller ends the mapping with import_files_unmap. Bytes of an empty file are NULL.
 */
enum bvhd_status import_files_map(struct import_files *files, const char *path, struct bytes *ret_bytes,
                                  struct bvhd_error *error);

/* An empty mapping is allowed. */
void import_files_unmap(struct bytes bytes);

#endif

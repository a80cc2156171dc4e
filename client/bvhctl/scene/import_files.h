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

/* Reads a whole file, and records it. The caller frees *ret_data, which is NULL for an empty file, with memory_free. */
enum bvhd_status import_files_read(struct import_files *files, const char *path, unsigned char **ret_data,
                                   uint64_t *ret_size, struct bvhd_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* files.h - whole files in and out: never half-written, and untouched when nothing changes. */
#ifndef BVHCTL_FILES_H
#define BVHCTL_FILES_H

#include <stdbool.h>

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Reads a regular file of at most `limit` bytes into memory: *ret_data is 64-byte aligned, freed with memory_free, NULL
 * for an empty file. A copy, not a mapping, so that nobody can change or cut it while it is looked at.
 */
enum bvhd_status files_read(const char *path, uint64_t limit, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error);

/*
 * Gives `path` this content: through a temporary file beside it and a rename, so that a reader sees the old or the new
 * bytes, never a part. A file that has these bytes already is not touched, and keeps its time. A symbolic link stays,
 * and what it leads to gets the content; it must lead somewhere. BVHD_IO for what is there and no regular file: a
 * device would be lost. ret_changed may be NULL.
 */
enum bvhd_status files_write(const char *path, struct bytes content, struct memory *memory, bool *ret_changed,
                             struct bvhd_error *error);

/* Makes a directory and those above it, where they are missing. */
enum bvhd_status files_make_directory(const char *path, struct bvhd_error *error);

bool files_is_directory(const char *path);

/* "directory/name", from `memory`; NULL when there is none. */
char *files_join(struct memory *memory, const char *directory, const char *name);

/* A copy of a text, from `memory`; NULL when there is none. */
char *files_copy_text(struct memory *memory, const char *text);

#endif

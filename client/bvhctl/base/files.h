/* SPDX-License-Identifier: Apache-2.0 */
/* files.h - reads and writes whole files. A file is never half-written, and is not touched when nothing changes. */
#ifndef BVHCTL_FILES_H
#define BVHCTL_FILES_H

#include <stdbool.h>

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Reads a regular file of at most `limit` bytes into memory. *ret_data is 64-byte aligned, is NULL for an empty file,
 * and is freed by the caller with memory_free. It is a copy and not a mapping, so that nobody can change or truncate it
 * while it is read.
 */
enum bvhd_status files_read(const char *path, uint64_t limit, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error);

/*
 * Writes `content` to the file `path`, through a temporary file beside it and a rename, so that a reader sees either
 * all old or all new bytes. A file that has these bytes already is not touched and keeps its modification time. A
 * symbolic link stays, and its target, which must exist, gets the content. BVHD_IO when the path exists and is not a
 * regular file, because the rename would replace, for example, a device. *ret_changed says whether the file was
 * written; ret_changed may be NULL.
 */
enum bvhd_status files_write(const char *path, struct bytes content, struct memory *memory, bool *ret_changed,
                             struct bvhd_error *error);

/* Creates a directory and its parents, as far as they are missing. */
enum bvhd_status files_make_directory(const char *path, struct bvhd_error *error);

bool files_is_directory(const char *path);

/* Returns "directory/name", which the caller frees with memory_free, or NULL when there is no memory. */
char *files_join(struct memory *memory, const char *directory, const char *name);

/* Returns a copy of `text`, which the caller frees with memory_free, or NULL when there is no memory. */
char *files_copy_text(struct memory *memory, const char *text);

#endif

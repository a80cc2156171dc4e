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

/* A file that is written piece by piece, to a temporary file beside it. All fields belong to files.c. */
struct files_stream {
    char *path, *place, *temporary;
    struct memory *memory;
    int descriptor;
    uint64_t size;
    int failure; /* errno of the first write that failed; 0: none has */
};

/* Begins a file. The errors are those of files_write. End with files_stream_end or files_stream_abandon. */
enum bvhd_status files_stream_begin(struct files_stream *stream, const char *path, struct memory *memory,
                                    struct bvhd_error *error);

/* Appends bytes. Returns false after a failure, which files_stream_end reports. */
bool files_stream_put(struct files_stream *stream, struct bytes content);

/*
 * Writes `head` over the first bytes, and then renames the temporary file to the path, unless the file there has the
 * same bytes. The stream is over, also after an error.
 */
enum bvhd_status files_stream_end(struct files_stream *stream, struct bytes head, bool *ret_changed,
                                  struct bvhd_error *error);

/* Removes the temporary file. NULL-safe, idempotent. */
void files_stream_abandon(struct files_stream *stream);

/* Creates a directory and its parents, as far as they are missing. */
enum bvhd_status files_make_directory(const char *path, struct bvhd_error *error);

bool files_is_directory(const char *path);

/* Returns "directory/name", which the caller frees with memory_free, or NULL when there is no memory. */
char *files_join(struct memory *memory, const char *directory, const char *name);

/* Returns a copy of `text`, which the caller frees with memory_free, or NULL when there is no memory. */
char *files_copy_text(struct memory *memory, const char *text);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * built.h - reads what `bvhctl build` has written, whether it is a directory of files or a container. Either has a
 * manifest, and structures that are found by their names as files.
 */
#ifndef BVHCTL_BUILT_H
#define BVHCTL_BUILT_H

#include "builder/format/container.h"

struct built {
    const char *path; /* the caller's */
    bool is_container;
    unsigned char *data; /* of the container, from memory */
    struct container container;
    struct built_name *names; /* of the structures in the container, sorted */
    struct memory *memory;
};

/* Returns whether the path is a file that begins as a container does, or whose name says that it is one. */
bool built_is_container(const char *path);

/*
 * Opens a directory, or reads a container, which is hostile. BVHD_IO when the path is neither; BVHD_CORRUPT or
 * BVHD_INCOMPATIBLE with the place in the container; BVHD_NO_MEMORY. A path that does not exist is taken for a
 * directory, whose files are then not found. End with built_close.
 */
enum bvhd_status built_open(const char *path, struct memory *memory, struct built *ret_built, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void built_close(struct built *built);

/* Bytes that were read. */
struct built_bytes {
    struct bytes bytes; /* aligned to 64 bytes; data is not NULL */
    unsigned char *owned; /* for the caller to free with memory_free; NULL: they belong to the container */
};

/* Reads the manifest. *ret_where, of BVHD_WHERE_SIZE, becomes the place that errors about it begin with. */
enum bvhd_status built_manifest(const struct built *built, struct built_bytes *ret_manifest, char *ret_where,
                                struct bvhd_error *error);

/* Reads the structure that is called `file`, a plain name. In a container its checksum is compared. */
enum bvhd_status built_read(const struct built *built, const char *file, struct built_bytes *ret_bytes,
                            struct bvhd_error *error);

#endif

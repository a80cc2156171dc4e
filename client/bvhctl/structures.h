/* SPDX-License-Identifier: Apache-2.0 */
/* structures.h - the built files of one scene of a directory, opened for tracing: packed into one buffer, as a GPU would get them. */
#ifndef BVHCTL_STRUCTURES_H
#define BVHCTL_STRUCTURES_H

#include "manifest.h"
#include "portable_scene.h"

struct structure_file {
    unsigned char *data; /* NULL once packed */
    bool is_shared; /* its data is another one's */
    uint64_t size;
    struct portable_view view; /* into data */
    struct manifest_colour *colours; /* of its geometries, as far as the manifest has them */
    uint32_t colour_count;
};

struct structures {
    char *name; /* of the scene */
    struct structure_file *files; /* bottom levels in handle order, then the top level if there is one */
    uint32_t file_count;
    unsigned char *buffer; /* all of them */
    struct portable_scene *packed; /* over the buffer */
    struct scene scene; /* to traverse; without a top level the scene is one bottom level */
    struct memory *memory;
};

/*
 * Opens the scene called `name` (NULL: the first one in the manifest): its top level and what that names, else its first bottom level. Files are
 * hostile: BVHD_CORRUPT, BVHD_INCOMPATIBLE, BVHD_NOT_FOUND say which one and where. End with structures_close.
 */
enum bvhd_status structures_open(const char *directory, const char *name, struct memory *memory, struct structures *ret_structures,
                                 struct bvhd_error *error);

/* NULL-safe, idempotent. */
void structures_close(struct structures *structures);

/* The base colour of a geometry of bottom level `handle`, or NULL. */
const float *structures_colour(const struct structures *structures, uint32_t handle, uint32_t geometry);

/* Reads and opens one file, without colours. On success the caller frees ret_file->data with memory_free. */
enum bvhd_status structures_read(const char *path, struct memory *memory, struct structure_file *ret_file, struct bvhd_error *error);

#endif

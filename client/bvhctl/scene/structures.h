/* SPDX-License-Identifier: Apache-2.0 */
/*
 * structures.h - opens the structures of one scene of a directory or a container, to trace them on the CPU and to
 * upload them.
 */
#ifndef BVHCTL_STRUCTURES_H
#define BVHCTL_STRUCTURES_H

#include <bvhd/bvhd_cpu.h>

#include "builder/traverse/ray.h"
#include "client/bvhctl/scene/built.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/structure.h"

enum { STRUCTURE_NAME = 61 };

struct structure_file {
    char name[STRUCTURE_NAME]; /* of the file, without its directory, for messages; "" if there is no file */
    unsigned char *data; /* from memory; NULL: the bytes belong to a container */
    uint64_t size;
    bool is_shared; /* data, structure and colours belong to another entry */
    struct structure structure;
    struct manifest_colour *colours; /* of its geometries, as far as the manifest has them */
    uint32_t colour_count;
};

/* The structures of a scene, all of one target. */
struct structures {
    char *name; /* of the scene */
    enum target target;
    bool has_top;
    /* the bottom levels, by rows of the top level's references, then the top level if there is one */
    struct structure_file *files;
    uint32_t file_count, bottom_count;
    /*
     * the bytes of `files`, in their order, for the upload. The handles in a top level are as `bvhctl build` has
     * written them: row + 1. Equal data pointers mean one structure
     */
    struct bytes *blobs;
    struct bvhd_cpu_scene *scene; /* over `blobs`: what rays are traced through on the CPU */
    struct built built; /* whose container the files may belong to */
    struct memory *memory;
};

/*
 * Opens the scene with that name, or the first one in the manifest if `name` is NULL: its top level with all bottom
 * levels that it names or, if it has no top level, its first bottom level. Files are hostile: the errors BVHD_CORRUPT,
 * BVHD_INCOMPATIBLE and BVHD_NOT_FOUND name the file and the place in it. End with structures_close.
 */
enum bvhd_status structures_open(const char *path, const char *name, struct memory *memory,
                                 struct structures *ret_structures, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void structures_close(struct structures *structures);

/*
 * The last step of structures_open, for callers that have opened the files themselves: they set name, files,
 * file_count, has_top and memory, and this function sets the other members. BVHD_CORRUPT when the files do not belong
 * together. End with structures_close.
 */
enum bvhd_status structures_join(struct structures *structures, struct bvhd_error *error);

/* Undoes structures_join, so that it can be called again with other files. The files stay open. */
void structures_separate(struct structures *structures);

/* Returns the top level, or NULL if there is none. */
const struct structure *structures_top(const struct structures *structures);

/*
 * Traces a ray on the CPU by bvhd_cpu.h, whose functions trace many. `handle` of a hit is the row of its bottom level,
 * and 0 without a top level. Any thread.
 */
bool structures_trace(const struct structures *structures, const struct ray *ray, struct ray_hit *ret_hit);

/* Gives the exact corners of a triangle that structures_trace has hit at a time, in object space. Not for AABBs. */
void structures_corners(const struct structures *structures, const struct ray_hit *hit, float time,
                        float ret_corners[3][3]);

/* Returns the base colour of a geometry of bottom level `bottom`, or NULL if the manifest has none. */
const float *structures_colour(const struct structures *structures, uint32_t bottom, uint32_t geometry);

/*
 * Reads and opens one file, or the structure of this name in what was built, without colours. End with
 * structures_close_file, unless it fails.
 */
enum bvhd_status structures_read(const char *path, struct memory *memory, struct structure_file *ret_file,
                                 struct bvhd_error *error);
enum bvhd_status structures_read_built(const struct built *built, const char *name, struct memory *memory,
                                       struct structure_file *ret_file, struct bvhd_error *error);
void structures_close_file(struct structure_file *file, struct memory *memory);

#endif

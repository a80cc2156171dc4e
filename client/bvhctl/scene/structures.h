/* SPDX-License-Identifier: Apache-2.0 */
/* structures.h - the built files of one scene of a directory, opened: to trace on the CPU, and to upload. */
#ifndef BVHCTL_STRUCTURES_H
#define BVHCTL_STRUCTURES_H

#include "builder/traverse/lavapipe_traverse.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/structure.h"
#include "builder/traverse/traverse.h"

enum { STRUCTURE_NAME = 61 };

struct structure_file {
    char name[STRUCTURE_NAME]; /* of the file, without its directory, for people; "" when it is from none */
    unsigned char *data; /* from memory */
    uint64_t size;
    bool is_shared; /* data, structure and colours are another one's */
    struct structure structure;
    struct manifest_colour *colours; /* of its geometries, as far as the manifest has them */
    uint32_t colour_count;
};

/* All of one target. */
struct structures {
    char *name; /* of the scene */
    enum target target;
    bool has_top;
    /* bottom levels by rows of the top level's references, then the top level if there is one */
    struct structure_file *files;
    uint32_t file_count, bottom_count;
    /* by the same rows: the files' bytes, with handles as written (row + 1); equal data pointers are one structure */
    struct bytes *blobs;
    union {
        struct scene portable;
        struct lavapipe_scene lavapipe;
    } scene; /* by target: what traversal runs over; without a top level it is the one bottom level */
    void *views; /* the array of views that `scene` points to */
    struct memory *memory;
};

/*
 * Opens the scene called `name` (NULL: the first one in the manifest): its top level and what that names, else its
 * first bottom level. Files are hostile: BVHD_CORRUPT, BVHD_INCOMPATIBLE, BVHD_NOT_FOUND say which one and where. End
 * with structures_close.
 */
enum bvhd_status structures_open(const char *directory, const char *name, struct memory *memory,
                                 struct structures *ret_structures, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void structures_close(struct structures *structures);

/*
 * The end of structures_open, for files that are open: name, files, file_count, has_top and memory are set; the rest
 * follows. BVHD_CORRUPT when they do not belong together. End with structures_close.
 */
enum bvhd_status structures_join(struct structures *structures, struct bvhd_error *error);

/* Undoes structures_join, so that files may be added or removed before another one. The files stay open. */
void structures_separate(struct structures *structures);

/* The top level; NULL without one. */
const struct structure *structures_top(const struct structures *structures);

/*
 * Traces on the CPU: traverse.h's semantics and answers, whatever the target; `handle` of a hit is the row of its
 * bottom level, 0 without a top level. `options` and `counters` may be NULL. Any thread.
 */
bool structures_trace(const struct structures *structures, const struct ray *ray,
                      const struct traverse_options *options, struct ray_hit *ret_hit);
bool structures_trace_counted(const struct structures *structures, const struct ray *ray,
                              const struct traverse_options *options, struct ray_hit *ret_hit,
                              struct traverse_counters *counters);

/* The exact corners of the triangle that was hit on the CPU, in the space of its bottom level. Not for AABBs. */
void structures_corners(const struct structures *structures, const struct ray_hit *hit, float ret_corners[3][3]);

/* The base colour of a geometry of bottom level `bottom`, or NULL. */
const float *structures_colour(const struct structures *structures, uint32_t bottom, uint32_t geometry);

/* Reads and opens one file, without colours. On success the caller ends it with structures_close_file. */
enum bvhd_status structures_read(const char *path, struct memory *memory, struct structure_file *ret_file,
                                 struct bvhd_error *error);
void structures_close_file(struct structure_file *file, struct memory *memory);

#endif

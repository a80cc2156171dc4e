/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import.h - a scene file, read with assimp, as what acceleration structures are built from.
 *
 * Faces are triangulated; nothing else is changed: no axes, no units, no merging, no dropping. NaN and degenerate
 * triangles survive. What is no triangle geometry is counted. A bottom level is a distinct list of meshes that some
 * node has, and becomes one bottom level with one geometry a mesh; nodes with meshes become instances, in depth-first
 * order.
 */
#ifndef BVHCTL_IMPORT_H
#define BVHCTL_IMPORT_H

#include "proto/base/memory.h"
#include "client/bvhctl/oracle/oracle.h"
#include "proto/base/status.h"

struct import_mesh {
    char *name, *material; /* may be "" */
    bool has_colour;
    float colour[3]; /* of the material: base colour, linear, 0 to 1 */
    float *positions; /* xyz each; never NULL */
    uint32_t *indices; /* three a triangle, each < vertex_count; never NULL */
    uint32_t vertex_count, triangle_count;
};

struct import_bottom {
    char *name; /* of its only mesh, else of the first node that has it; may be "" */
    uint32_t *meshes;
    uint32_t mesh_count;
};

struct import_instance {
    uint32_t bottom;
    float transform[12]; /* row-major 3x4, object to world; products of the nodes' matrices in double, rounded once */
    bool skipped; /* Vulkan forbids its matrix: not invertible (03799); it keeps its place, as an inactive instance */
};

/* What the file has and acceleration structures of triangles do not. */
struct import_counts {
    uint64_t points, lines; /* faces with one or two corners */
    uint64_t skins, morphs; /* meshes with bones, morph targets */
};

struct import {
    char *name; /* the file's name without directory and extension */
    struct import_mesh *meshes;
    struct import_bottom *bottoms;
    struct import_instance *instances;
    char **files; /* all files that were read, in order */
    uint32_t mesh_count, bottom_count, instance_count, file_count;
    uint64_t skipped_instances;
    uint64_t triangle_count; /* over all meshes */
    struct import_counts counts;
    struct memory *memory;
};

/*
 * BVHD_NOT_FOUND: no such file; BVHD_UNSUPPORTED: assimp does not read it; BVHD_INVALID: no triangles in it. End with
 * import_finish.
 *
 * Reads in a child process: broken files make some of assimp's importers abort, or run for ever; here that is
 * BVHD_UNSUPPORTED.
 */
enum bvhd_status import_scene(const char *path, struct memory *memory, struct import *ret_import,
                              struct bvhd_error *error);

/* The same in this process, come what may. */
enum bvhd_status import_read(const char *path, struct memory *memory, struct import *ret_import,
                             struct bvhd_error *error);

/* NULL-safe, idempotent. */
void import_finish(struct import *import);

/* The name of a scene, from its file's: without directory and extension. From `memory`; NULL when there is none. */
char *import_name(const char *path, struct memory *memory);

/*
 * The triangles for brute force: one oracle_mesh for each mesh of each instance that is not skipped, as traversal over
 * the top level reports them; or those of bottom level 0 alone, when there is no top level. They point into the import.
 * From import->memory, freed by the caller.
 */
enum bvhd_status import_oracle_meshes(const struct import *import, bool has_top, struct oracle_mesh **ret_meshes,
                                      uint32_t *ret_count, struct bvhd_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * manifest.h - writes and reads manifest.json, which lists the structures in a directory: their files, their targets,
 * and which bottom levels a top level refers to.
 *
 * Its form is {"schema":1,"structures":[{"file","type","scene","name",...,"handles"}]}. It contains no times, so that
 * it is the same for equal input on any machine, with any number of threads. `file` is a plain name in the directory.
 * The `handles` of a top level are files, in the order of its serialized handles. A top level has a member
 * "source_scene":{"number","name"} if it was built from one chosen scene of its file, and "left_out":{...} with numbers
 * by kind (import_counts.h) if anything was left out. Geometries have such a member, too; meshes without triangles are
 * in "meshes_left_out":[{"name","left_out"}] of the top level.
 */
#ifndef BVHCTL_MANIFEST_H
#define BVHCTL_MANIFEST_H

#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/base/json.h"

#define MANIFEST_NAME "manifest.json"

/*
 * Returns the file name of structure `index` of an import (bottom_count is the top level): "SCENE.blas-3-NAME.as" or
 * "SCENE.tlas.as", with only letters, digits and . _ - in it. NAME has no dot, so that files of two scenes cannot have
 * the same name. The caller frees it, with memory_free of import->memory. NULL when there is no memory.
 */
char *manifest_file_name(const struct import *import, uint32_t index);

/*
 * Returns the scene's name in the form that file names begin with. The caller frees it with memory_free. NULL when
 * there is no memory.
 */
char *manifest_safe_name(const char *name, struct memory *memory);

/*
 * Writes one element of "structures". With `times` it has also the members that depend on the run: times, peak memory,
 * cache hits.
 */
void manifest_write_structure(struct json *json, const struct assembly *assembly, uint32_t index, const char *file,
                              char *const *all_files, bool times);

/* The base colour of a geometry, linear. It has none if red < 0. */
struct manifest_colour {
    float rgb[3];
};

struct manifest_entry {
    char *file, *scene, *name;
    enum target target;
    bool is_top;
    bool has_source; /* it was built from one chosen scene of its file: */
    uint32_t source_number; /* its number, from 0 */
    char *source_name; /* and its name; NULL if it has none */
    char **handles; /* of a top level: files, in the order of its handles */
    uint32_t handle_count;
    struct manifest_colour *colours; /* one for each geometry */
    uint32_t colour_count;
};

struct manifest {
    struct manifest_entry *entries;
    uint32_t count;
    struct memory *memory;
};

/*
 * Reads DIRECTORY/manifest.json, which is hostile: file names that contain '/' or are ".." are refused. BVHD_NOT_FOUND,
 * or BVHD_CORRUPT with the place. End with manifest_finish.
 */
enum bvhd_status manifest_read(const char *directory, struct memory *memory, struct manifest *ret_manifest,
                               struct bvhd_error *error);

/*
 * Finds the top level that `scene` names: the scene of this name, else the one that was built from the scene of this
 * name or number in its file. If several files have one, it is that of the file named `file`, which may be NULL. NULL:
 * there is none, or it is not clear which.
 */
const struct manifest_entry *manifest_find_top(const struct manifest *manifest, const char *file, const char *scene);

/* NULL-safe, idempotent. */
void manifest_finish(struct manifest *manifest);

/*
 * Returns the name of the quality that was built: "fast", "balanced" or "high". It is "" for a quality that only a
 * newer service knows, and for results of an older service, which do not contain it.
 */
const char *manifest_quality_name(enum bvhd_quality quality);

#endif

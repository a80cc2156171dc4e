/* SPDX-License-Identifier: Apache-2.0 */
/*
 * manifest.h - manifest.json: which structures a directory holds, for whom they were built and how they belong
 * together.
 *
 * {"schema":1,"structures":[{"file","type","scene","name",...,"handles"}]}: the same for equal input, whatever the
 * machine or the number of threads, so it has no times. `file` is a plain name inside the directory; `handles`, for a
 * top level, are the files in the order of its serialized handles.
 */
#ifndef BVHCTL_MANIFEST_H
#define BVHCTL_MANIFEST_H

#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/base/json.h"

#define MANIFEST_NAME "manifest.json"

/*
 * The file name of structure `index` of an import (bottom_count: the top level): "SCENE.blas-3-NAME.as",
 * "SCENE.tlas.as", with letters, digits and . _ - only. NAME has no dot, so that files of two scenes cannot have the
 * same name. From import->memory; NULL when there is none.
 */
char *manifest_file_name(const struct import *import, uint32_t index);

/* The scene's name as it begins file names. From `memory`; NULL when there is none. */
char *manifest_safe_name(const char *name, struct memory *memory);

/* One member of "structures"; `times`: with what depends on the run - times, peak memory, cache words. */
void manifest_write_structure(struct json *json, const struct assembly *assembly, uint32_t index, const char *file,
                              char *const *all_files, bool times);

/* A geometry's base colour, linear; red < 0: none given. */
struct manifest_colour {
    float rgb[3];
};

struct manifest_entry {
    char *file, *scene, *name;
    enum target target;
    bool is_top;
    char **handles; /* of a top level: files in handle order */
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
 * Reads DIRECTORY/manifest.json, hostile: file names with a '/' or ".." are refused. BVHD_NOT_FOUND, BVHD_CORRUPT with
 * the place. End with manifest_finish.
 */
enum bvhd_status manifest_read(const char *directory, struct memory *memory, struct manifest *ret_manifest,
                               struct bvhd_error *error);

/* NULL-safe, idempotent. */
void manifest_finish(struct manifest *manifest);

/*
 * "fast", "balanced", "high": what was built. "" for one that only a newer service knows, and from an older one, which
 * does not say.
 */
const char *manifest_quality_name(enum bvhd_quality quality);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* scene_source.h - finds the file from which structures were built, for what only pictures need of it. */
#ifndef BVHCTL_SCENE_SOURCE_H
#define BVHCTL_SCENE_SOURCE_H

#include "client/bvhctl/scene/manifest.h"

/* A manifest's record of the file of a scene. */
struct scene_source {
    char *file; /* its name without its folder; NULL: it is not known */
    bool is_gltf; /* by that name */
    struct manifest_wish wish; /* how it was read */
    struct memory *memory;
};

/*
 * Reads it from the manifest of a directory or container; nothing is known without a manifest. It must not be moved
 * then.
 */
void scene_source_read(struct scene_source *source, const char *built, const char *scene, struct memory *memory);

/* NULL-safe, idempotent. */
void scene_source_finish(struct scene_source *source);

/*
 * Looks for the file: in the directory of the structures, in the folder that this or a container is in, and in the
 * current one. Returns its path, which the caller frees with memory_free, or NULL.
 */
char *scene_source_find(const struct scene_source *source, const char *built, struct memory *memory);

#endif

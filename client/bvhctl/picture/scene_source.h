/* SPDX-License-Identifier: Apache-2.0 */
/* scene_source.h - finds the file from which structures were built, for what only pictures need of it. */
#ifndef BVHCTL_SCENE_SOURCE_H
#define BVHCTL_SCENE_SOURCE_H

#include <stdbool.h>

#include "proto/base/memory.h"

/*
 * Looks for the glTF file of a scene: in the directory of its structures, in the folder of that, and in the current
 * one, by the scene's name. Returns its path, which the caller frees with memory_free, or NULL.
 */
char *scene_source_find(const char *directory, const char *scene, struct memory *memory);

#endif

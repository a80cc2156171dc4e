/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_scenes.h - chooses among the scenes of a glTF file. */
#ifndef BVHCTL_GLTF_SCENES_H
#define BVHCTL_GLTF_SCENES_H

#include "client/bvhctl/scene/gltf_json.h"

/*
 * Finds the scene that `scene` names, by its name or else by its number, and records it in the import. NULL chooses
 * all: *ret_scene is GLTF_ALL_SCENES then. BVHD_NOT_FOUND: there is none; BVHD_INVALID: several have that name.
 */
enum bvhd_status gltf_scenes_choose(const struct gltf_file *file, const char *scene, struct import *import,
                                    uint32_t *ret_scene);

/*
 * Checks a file that is left to assimp, which reads one scene only, the file's default one. Others are counted as left
 * out; choosing one of them is an error.
 */
enum bvhd_status gltf_scenes_check_foreign(const struct gltf_file *file, const char *scene);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_extensions.h - which extensions of glTF the reader knows. */
#ifndef BVHCTL_GLTF_EXTENSIONS_H
#define BVHCTL_GLTF_EXTENSIONS_H

#include "client/bvhctl/scene/gltf_json.h"

/*
 * Refuses a file that requires an extension which is not known, by its name. Unknown extensions that are only used are
 * counted.
 */
enum bvhd_status gltf_extensions_check(const struct gltf_file *file);

/* Returns whether there is geometry that only a decoder of Draco can read. */
bool gltf_extensions_need_draco(const struct gltf_file *file);

/*
 * Refuses a file whose meshes assimp has to read, because of Draco, if it requires another extension that changes
 * geometry, which assimp would ignore.
 */
enum bvhd_status gltf_extensions_check_draco(const struct gltf_file *file);

#endif

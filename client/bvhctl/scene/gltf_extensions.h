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

/* Whether a file has geometry that only a decoder of Draco can read: WIDE: with indices of 32 bits. */
enum gltf_draco { GLTF_NO_DRACO, GLTF_DRACO, GLTF_DRACO_WIDE };

/* Finds that out, and refuses what assimp would read wrong. */
enum bvhd_status gltf_extensions_find_draco(const struct gltf_file *file, enum gltf_draco *ret_draco);

/*
 * Refuses a file whose meshes assimp has to read, because of Draco, if it requires another extension that changes
 * geometry, which assimp would ignore.
 */
enum bvhd_status gltf_extensions_check_draco(const struct gltf_file *file);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf.h - reads glTF 2.0 files, as .gltf with its buffers or as .glb, without assimp. Internal to import.h.
 *
 * Vertices and triangles keep the order of the file. Each glTF mesh that a node uses is a bottom level with one
 * geometry for each primitive; each node with a mesh is an instance, in depth-first order. All scenes of the file are
 * built together unless one is chosen. Errors name the place: "NAME.gltf: accessors[3].byteOffset".
 */
#ifndef BVHCTL_GLTF_H
#define BVHCTL_GLTF_H

#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_files.h"

/* Returns whether a file is for this reader, by the ending of its name, or by its first bytes. */
bool gltf_is_file(const char *path);

/*
 * Reads what is wished of a file into an import whose name, memory and wants_looks are set; import_finish frees what
 * was made, also after an error. Files that are read are recorded in `files`.
 *
 * *ret_foreign is NULL, or is a clause that says why this reader leaves the file to assimp: it is of glTF 1.0, or has
 * meshes that are only there as KHR_draco_mesh_compression. Of the import, only its counts are changed then.
 */
enum bvhd_status gltf_read(const char *path, const struct import_wish *wish, struct import_files *files,
                           struct import *import, const char **ret_foreign, struct bvhd_error *error);

#endif

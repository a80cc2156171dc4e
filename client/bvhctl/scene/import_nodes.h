/* SPDX-License-Identifier: Apache-2.0 */
/* import_nodes.h - makes the bottom levels and instances of an import from assimp's nodes. Internal to import.h. */
#ifndef BVHCTL_IMPORT_NODES_H
#define BVHCTL_IMPORT_NODES_H

#include <assimp/scene.h>

#include "client/bvhctl/scene/import.h"

#define IMPORT_NO_MESH UINT32_MAX

/* The meshes of an import that were made of one of assimp's: IMPORT_NO_MESH if it has no primitive of a shape. */
struct import_meshes_of {
    uint32_t shapes[IMPORT_SHAPES];
};

/*
 * Adds the bottom levels and instances to an import that has its meshes, and counts the meshes that no node has.
 * `meshes_of` has an element for each mesh of the scene.
 * BVHD_NO_MEMORY, or BVHD_UNSUPPORTED: a node has a mesh that is not there. import_finish frees what was added.
 */
enum bvhd_status import_nodes(const struct aiScene *scene, const struct import_meshes_of *meshes_of,
                              struct import *import);

#endif

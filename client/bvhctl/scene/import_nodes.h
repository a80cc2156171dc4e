/* SPDX-License-Identifier: Apache-2.0 */
/* import_nodes.h - the part of import.h that walks assimp's nodes: bottom levels and instances, depth first. */
#ifndef BVHCTL_IMPORT_NODES_H
#define BVHCTL_IMPORT_NODES_H

#include <assimp/scene.h>

#include "client/bvhctl/scene/import.h"

/*
 * Fills the bottom levels and instances of an import that has its meshes. false: no memory; import_finish frees what is
 * there.
 */
bool import_nodes(const struct aiScene *scene, struct import *import);

#endif

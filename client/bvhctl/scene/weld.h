/* SPDX-License-Identifier: Apache-2.0 */
/*
 * weld.h - gives triangles of a mesh common vertices where their corners are at the same place, which halves the size
 * of structures of files that have none, such as OBJ files as assimp reads them.
 */
#ifndef BVHCTL_WELD_H
#define BVHCTL_WELD_H

#include "client/bvhctl/scene/import.h"

/*
 * Replaces vertices of each mesh of triangles whose positions have the same bits by the first of them. Triangles keep
 * their order, their number and, bit by bit, their corners. 0 and -0 are different; a NaN equals a NaN of the same
 * bits, whose triangles no ray hits anyway. Vertices keep the order in which they come first. Returns false when there
 * is no memory; the import can only be finished then.
 */
bool weld_import(struct import *import);

/* Does the same for one mesh, of any shape, whose vertices differ in nothing but their positions. */
bool weld_mesh(struct import_mesh *mesh, struct memory *memory);

#endif

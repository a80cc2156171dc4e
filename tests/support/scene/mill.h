/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mill.h - a scene of bodies that move for four seconds without changing their shape: a windmill, whose sails turn, and
 * paper planes that fly round it.
 *
 * For test programs only: without memory they print a message and end. y is up, and the front is at +z.
 */
#ifndef BVHD_MILL_H
#define BVHD_MILL_H

#include "tests/support/scene/gltf.h"

void mill_make(struct gltf *gltf);

#endif

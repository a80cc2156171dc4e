/* SPDX-License-Identifier: Apache-2.0 */
/*
 * park.h - the scene of the demonstration: a garden on a floating island, with a temple ring, a knot of stone, a pond
 * and woods.
 */
#ifndef BVHD_PARK_H
#define BVHD_PARK_H

#include "tests/support/scene/gltf.h"
#include "tests/support/random.h"

/*
 * Fills an empty scene: the island of about `size` triangles, everything else of fixed size, most of it instances.
 * Metres, y is up.
 */
void park_make(struct gltf *gltf, uint32_t size, struct random *random);

#endif

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
 * Fills an empty scene. The island has about `size` triangles; everything else has a fixed size, and most of it is
 * instances. Units are metres; y is up.
 */
void park_make(struct gltf *gltf, uint32_t size, struct random *random);

#endif

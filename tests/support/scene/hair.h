/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hair.h - scenes of lines and points with radii: hair on a scalp, as lines or as tubes of triangles, and the point
 * cloud of a sea shell.
 *
 * For test programs only: without memory they print a message and end. y is up, and the front is at +z.
 */
#ifndef BVHD_HAIR_H
#define BVHD_HAIR_H

#include "tests/support/random.h"
#include "tests/support/scene/gltf.h"

enum { HAIR_STRANDS = 2228, HAIR_POINTS = 32, HAIR_SIDES = 3, CLOUD_SIZE = 100000 };

/*
 * Adds strands of HAIR_POINTS vertices with radii, which become thinner towards the tips, to an empty mesh. The
 * vertices of a strand follow one another, and its lines join each with the next one.
 */
void hair_make(struct mesh *mesh, uint32_t strands, struct random *random);

/* Adds the same strands as closed tubes of triangles with that many sides, whose corners are on the round surface. */
void hair_make_tubes(const struct mesh *hair, uint32_t sides, struct mesh *mesh);

/* Makes a scene of a scalp with hair, as lines or as tubes. */
void hair_make_scene(struct gltf *gltf, uint32_t strands, bool is_tubes, struct random *random);

/*
 * Adds the points of a sea shell, with radii, to empty meshes: those between its stripes, and those in them. Both may
 * be the same mesh.
 */
void cloud_make(struct mesh *plain, struct mesh *stripes, uint32_t points, struct random *random);

/* Makes a scene of such points in two materials. */
void cloud_make_scene(struct gltf *gltf, uint32_t points, struct random *random);

#endif

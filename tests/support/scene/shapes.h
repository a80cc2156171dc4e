/* SPDX-License-Identifier: Apache-2.0 */
/* shapes.h - boxes, rings, pipes and turned bodies at any place, for the scenes of the gallery. y is up. */
#ifndef BVHD_SHAPES_H
#define BVHD_SHAPES_H

#include "tests/support/scene/gltf.h"

/* A place or a size. */
struct at {
    double x, y, z;
};

/* Adds a material of its own and a mesh of it to a scene, as one node, and returns the mesh to be filled. */
struct mesh *shapes_part(struct gltf *gltf, const char *name, double red, double green, double blue);

/* Does the same for a material that was added before. */
struct mesh *shapes_part_of(struct gltf *gltf, const char *name, int material);

/* Makes the last material smooth. */
void shapes_smooth(struct gltf *gltf);

/* Adds a box by its middle and its extents. Each face has vertices of its own. */
void shapes_box(struct mesh *mesh, struct at middle, struct at size);

/* Adds a box whose faces point to the inside, as the walls of a room do. */
void shapes_room(struct mesh *mesh, struct at middle, struct at size);

/* Adds a closed upright cylinder or cone, by the middle of its foot. */
void shapes_cylinder(struct mesh *mesh, struct at foot, double radius, double top_radius, double height);

/* Adds a body of revolution around the vertical axis through a foot: profile[i] = {radius, height}, bottom up. */
void shapes_lathe(struct mesh *mesh, struct at foot, const double (*profile)[2], uint32_t count, uint32_t sides);

void shapes_ball(struct mesh *mesh, struct at middle, double radius);

/* Adds a straight rod with round section. */
void shapes_rod(struct mesh *mesh, struct at from, struct at to, double radius);

enum { SHAPES_LONGEST = 512 };

/*
 * Adds a pipe along a path of at most SHAPES_LONGEST points, with `sides` sides and a radius that goes from `radius` to
 * `last_radius`. A closed path returns from its last point to its first one.
 */
void shapes_pipe(struct mesh *mesh, const struct at *path, uint32_t count, double radius, double last_radius,
                 uint32_t sides, int closed);

/* Adds a ring: a circle around `axis` (0 x, 1 y, 2 z), swept by a smaller one. */
void shapes_ring(struct mesh *mesh, struct at middle, int axis, double radius, double thickness);

/*
 * Adds a flat plate with the outline of a polygon that is star-shaped around its middle, counterclockwise seen from +z,
 * with the given depth.
 */
void shapes_plate(struct mesh *mesh, struct at middle, const double (*outline)[2], uint32_t count, double depth);

/* Turns the vertices from `first` on around an axis through `middle`, by the right-hand rule. */
void shapes_turn(struct mesh *mesh, uint32_t first, struct at middle, int axis, double angle);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * swept_shape.h - the boxes of spheres and of linear swept spheres.
 *
 * A linear swept sphere is what a ray can hit of it: its side, a cone that touches both spheres along the tangent
 * circles, and the caps of the ends that have one, each the part of that end's sphere beyond its circle. Where one
 * sphere lies inside the other, it is the sphere of the larger end (the first end, if both are equal) if this end has a
 * cap, and nothing otherwise.
 *
 * An end is four floats, its centre and its radius, which is not negative. None of them is a NaN; larger magnitudes
 * than FLT_MAX count as FLT_MAX, and so do those of the box. Boxes contain every point of the shape: a sphere, or both
 * of them, has the smallest box of floats; the boxes of tangent circles exceed the smallest by less than 2^-23 of the
 * end's magnitude, and by more only where one sphere nearly touches the other from inside. The functions are the same
 * for builds, updates and traversal, so that none of these has another box than the others.
 */
#ifndef BVHD_SWEPT_SHAPE_H
#define BVHD_SWEPT_SHAPE_H

#include <stdbool.h>

#include "proto/base/box.h"

/* The ends that have a cap: the two highest bits of a canonical index (canonical.h). */
enum { SWEPT_SHAPE_CAP_FIRST = 1, SWEPT_SHAPE_CAP_SECOND = 2, SWEPT_SHAPE_CAPS = 3 };

/* Returns the box of a sphere. */
struct box swept_shape_sphere(const float sphere[4]);

/* Returns the box of a linear swept sphere; the centre of the larger end for one of which nothing can be hit. */
struct box swept_shape_box(const float first[4], const float second[4], unsigned caps);

/*
 * Returns whether nothing can be hit for certain: both radii are 0, or one sphere clearly contains the other and has no
 * cap.
 */
bool swept_shape_is_nothing(const float first[4], const float second[4], unsigned caps);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * notes.h - remarks to the user about a scene: what of it was left out or cannot be hit, by kind and by mesh. Nothing
 * is printed about a scene that was built completely.
 */
#ifndef BVHCTL_NOTES_H
#define BVHCTL_NOTES_H

#include "client/bvhctl/scene/assemble.h"

/* Prints one line for each kind of things that are left out; it names the meshes that have most of them. */
void notes_left_out(const struct import *import);

/*
 * Prints what moves in the shutter interval that the scene was read over, and the greatest distances from the
 * animation. Nothing without an interval.
 */
void notes_motion(const struct import *import);

/*
 * Prints numbers of triangles that no ray can hit, and a warning if there are no others. Some targets and flags keep
 * such triangles in the structure.
 */
void notes_activity(const struct assembly *assembly);

#endif

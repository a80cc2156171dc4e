/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_shutter.h - what of a glTF scene moves in a shutter interval, as motion in straight lines. */
#ifndef BVHCTL_GLTF_SHUTTER_H
#define BVHCTL_GLTF_SHUTTER_H

#include "client/bvhctl/scene/gltf_nodes.h"

/*
 * Moves everything to the beginning of the interval, as gltf_deform does, and finds the motions of instances and the
 * positions of vertices at its end. How far that is from the animation is measured at 15 times between both ends; of
 * vertices of points and lines, which do not move, also at the end.
 *
 * The pose is at the beginning, and the meshes are at rest, with their looks if they are wanted. `spots` has one for
 * each instance of the import. import_finish frees what was made, also after an error.
 */
enum bvhd_status gltf_shutter_apply(struct gltf_file *file, struct gltf_pose *pose,
                                    const struct import_moment *interval, const struct gltf_forms *forms,
                                    const struct gltf_spot *spots, struct import *import);

#endif

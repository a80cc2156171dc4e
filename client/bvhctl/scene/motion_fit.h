/* SPDX-License-Identifier: Apache-2.0 */
/*
 * motion_fit.h - finds the motion of an instance that comes closest to a path of matrices. Vulkan knows two: each
 * number of a matrix moves in a straight line, or each number of a scale, a rotation and a translation (VkSRTDataNV).
 */
#ifndef BVHCTL_MOTION_FIT_H
#define BVHCTL_MOTION_FIT_H

#include "client/bvhctl/scene/gltf_transform.h"
#include "client/bvhctl/scene/import.h"

enum { MOTION_FIT_STEPS = 16 };

struct motion_path {
    struct gltf_matrix at[MOTION_FIT_STEPS + 1]; /* object to world, at equal distances in time */
    double low[3], high[3]; /* the box of what moves, in object space */
};

struct motion_fit {
    struct import_motion motion; /* of kind ORACLE_STILL if both ends of the path are the same */
    double distance; /* the greatest of any point of the box from where the path has it, at one of the steps */
    int step; /* at which it is */
};

/*
 * Finds the motion. It is the one of matrices, unless that of a scale, a rotation and a translation is closer by more
 * than rounding. The latter is tried for both ways round, and with the pivot that fits best, so that it also describes
 * what turns about a point that is not its own, as children of a node that turns. Returns false if no ray can hit the
 * instance at either end: its matrices have no inverse, or are not finite.
 */
bool motion_fit(const struct motion_path *path, struct motion_fit *ret_fit);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/leaf_kind.h"

const struct leaf_kind *const leaf_kinds[PORTABLE_CONTENTS] = {
    [PORTABLE_INDEXED_TRIANGLES] = &leaf_triangles,
    [PORTABLE_TRIANGLES] = &leaf_triangles,
    [PORTABLE_AABBS] = &leaf_aabbs,
    [PORTABLE_INSTANCES] = &leaf_instances,
    [PORTABLE_SPHERES] = &leaf_spheres,
    [PORTABLE_SWEPT_SPHERES] = &leaf_swept_spheres,
    [PORTABLE_MOVING_TRIANGLES] = &leaf_moving_triangles,
    [PORTABLE_MOVING_INSTANCES] = &leaf_moving_instances,
};

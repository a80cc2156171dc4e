/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include "proto/base/kind.h"

const struct input_kind *input_kind_of(uint32_t type)
{
    static const struct input_kind *const kinds[KIND_COUNT] = {
        [KIND_TRIANGLES] = &input_triangles,
        [KIND_AABBS] = &input_aabbs,
        [KIND_INSTANCES] = &input_instances,
        [KIND_SPHERES] = &input_spheres,
        [KIND_SWEPT_SPHERES] = &input_swept_spheres,
        [KIND_MOVING_TRIANGLES] = &input_moving_triangles,
        [KIND_MOVING_INSTANCES] = &input_moving_instances,
        [KIND_MICROMAP] = &input_micromap,
    };
    const struct kind *kind = kind_find(type);
    return kind ? kinds[kind->number] : NULL;
}

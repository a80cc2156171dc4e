/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind.h"

#include <stddef.h>

#include "proto/base/kind_internal.h"

static const struct kind *const kinds[KIND_COUNT] = {
    [KIND_TRIANGLES] = &kind_triangles,
    [KIND_AABBS] = &kind_aabbs,
    [KIND_INSTANCES] = &kind_instances,
    [KIND_SPHERES] = &kind_spheres,
    [KIND_SWEPT_SPHERES] = &kind_swept_spheres,
    [KIND_MOVING_TRIANGLES] = &kind_moving_triangles,
    [KIND_MOVING_INSTANCES] = &kind_moving_instances,
    [KIND_MICROMAP] = &kind_micromap,
    [KIND_BAKED_MICROMAP] = &kind_baked_micromap,
};

const struct kind *kind_find(uint32_t type)
{
    for (int i = 0; i < KIND_COUNT; i++)
        if (kinds[i]->type == type)
            return kinds[i];
    return NULL;
}

const struct kind *kind_find_vulkan(uint32_t vulkan_type, bool moves)
{
    for (int i = 0; i < KIND_COUNT; i++)
        if (kinds[i]->vulkan_type == vulkan_type && kinds[i]->moves == moves)
            return kinds[i];
    return NULL;
}

uint64_t kind_no_vertices(const struct geometry *geometry)
{
    (void)geometry;
    return 0;
}

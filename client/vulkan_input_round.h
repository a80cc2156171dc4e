/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_input_round.h - how much memory spheres and linear swept spheres reach. Only for vulkan_input_*spheres.c. */
#ifndef BVHD_VULKAN_INPUT_ROUND_H
#define BVHD_VULKAN_INPUT_ROUND_H

#include <bvhd/vulkan_nv.h>

#include "client/vulkan_input_kind.h"

/* Which vertices a primitive uses. */
struct round_use {
    uint32_t vertices; /* of a primitive without indices; 0 if it cannot be without */
    uint32_t indices; /* of a primitive with indices; 0 if that is unknown */
    uint32_t following; /* vertices after the one that an index names, which are used with it */
};

/*
 * Converts Vulkan's struct of spheres, which is also how the struct of linear swept spheres begins. The vertices and
 * the radii reach up to the greatest index, which is searched for here, because Vulkan's structs do not say it. Indices
 * that change meanwhile do no harm: prepare reads them again, and refuses those that name what is not there. Arrays
 * whose size depends on a broken rule are empty, and no index is read then.
 */
struct geometry_spheres vulkan_input_round(const VkAccelerationStructureGeometrySpheresDataNV *source,
                                           const struct geometry_range *range, const struct round_use *use);

#endif

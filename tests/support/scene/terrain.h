/* SPDX-License-Identifier: Apache-2.0 */
/*
 * terrain.h - meshes by the thousand, each different: hills over a square, and the Vulkan structs that ask for them.
 *
 * For test programs only: without memory they say so and end.
 */
#ifndef BVHD_TERRAIN_H
#define BVHD_TERRAIN_H

#include <stdint.h>

#include <vulkan/vulkan_core.h>

struct terrain {
    float *positions; /* xyz */
    uint32_t *indices;
    uint32_t vertex_count, triangle_count;
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildRangeInfoKHR range;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges;
    VkAccelerationStructureBuildGeometryInfoKHR info;
};

/* About `triangles` of them (at least 2), hills by `seed`. The struct must not move: its parts point to each other. */
void terrain_init(struct terrain *terrain, uint32_t triangles, uint32_t seed);
void terrain_finish(struct terrain *terrain);

/* A mesh of one's own, which stays its owner's, as an info. */
void terrain_wrap(struct terrain *terrain, float *positions, uint32_t vertex_count, uint32_t *indices,
                  uint32_t triangle_count);

#endif

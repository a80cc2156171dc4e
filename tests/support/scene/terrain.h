/* SPDX-License-Identifier: Apache-2.0 */
/*
 * terrain.h - meshes in large numbers, each different: hills over a square, and the Vulkan structs of a request for
 * them.
 *
 * For test programs only: without memory they print a message and end.
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

/*
 * Makes about `triangles` triangles (at least 2), with hills from `seed`. The struct must not move, because its members
 * point to each other.
 */
void terrain_init(struct terrain *terrain, uint32_t triangles, uint32_t seed);
void terrain_finish(struct terrain *terrain);

/* Describes an existing mesh, which still belongs to the caller. */
void terrain_wrap(struct terrain *terrain, float *positions, uint32_t vertex_count, uint32_t *indices,
                  uint32_t triangle_count);

#endif

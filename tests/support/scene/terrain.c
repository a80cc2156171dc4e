/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/terrain.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static void *allocate(size_t count, size_t size)
{
    void *block = calloc(count, size);
    if (!block) {
        fputs("terrain: no memory\n", stderr);
        exit(1);
    }
    return block;
}

/* Four waves whose direction and phase come from the seed, and a roughness from the position and the seed. */
static float height(uint32_t x, uint32_t y, uint32_t seed)
{
    double sum = 0;
    for (int i = 1; i <= 4; i++) {
        double turn = (double)(seed % 1009 + 1) * i * 0.7, phase = (double)(seed % 7919) * i * 0.13;
        sum += sin((cos(turn) * x + sin(turn) * y) * 0.05 * i * i + phase) / i;
    }
    uint32_t hash = (x * 73856093u) ^ (y * 19349663u) ^ (seed * 83492791u);
    hash ^= hash >> 13;
    hash *= 0x5bd1e995u;
    return (float)(sum + (double)(hash >> 20) / 8192.0);
}

void terrain_wrap(struct terrain *terrain, float *positions, uint32_t vertex_count, uint32_t *indices,
                  uint32_t triangle_count)
{
    *terrain = (struct terrain){
        .positions = positions,
        .indices = indices,
        .vertex_count = vertex_count,
        .triangle_count = triangle_count,
        .geometry = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                     .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
                     .geometry.triangles = {.sType =
                                                VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                                            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                                            .vertexData.hostAddress = positions,
                                            .vertexStride = 3 * sizeof(float),
                                            .maxVertex = vertex_count - 1,
                                            .indexType = VK_INDEX_TYPE_UINT32,
                                            .indexData.hostAddress = indices},
                     .flags = VK_GEOMETRY_OPAQUE_BIT_KHR},
        .range = {.primitiveCount = triangle_count},
        .info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
                 .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                 .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
                 .geometryCount = 1},
    };
    terrain->ranges = &terrain->range;
    terrain->info.pGeometries = &terrain->geometry;
}

void terrain_init(struct terrain *terrain, uint32_t triangles, uint32_t seed)
{
    uint32_t side = (uint32_t)ceil(sqrt(triangles / 2.0)), row = side + 1;
    side = side > 0 ? side : 1;
    uint32_t vertices = row * row, count = 2 * side * side;
    float *positions = allocate((size_t)vertices * 3, sizeof *positions);
    uint32_t *indices = allocate((size_t)count * 3, sizeof *indices), *index = indices;
    for (uint32_t i = 0; i < vertices; i++) {
        positions[3 * i] = (float)(i % row);
        positions[3 * i + 1] = height(i % row, i / row, seed);
        positions[3 * i + 2] = (float)(i / row);
    }
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t a = i / side * row + i % side, corners[6] = {a, a + row, a + 1, a + 1, a + row, a + row + 1};
        for (int k = 0; k < 6; k++)
            *index++ = corners[k];
    }
    terrain_wrap(terrain, positions, vertices, indices, count);
}

void terrain_finish(struct terrain *terrain)
{
    free(terrain->positions);
    free(terrain->indices);
    *terrain = (struct terrain){0};
}

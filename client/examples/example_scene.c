/* SPDX-License-Identifier: Apache-2.0 */
#include "example_scene.h"

#include <stdio.h>
#include <stdlib.h>

enum { INSTANCES = 4 };

void example_must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s: %s\n", bvhd_status_name(status), error->where, error->text);
    exit(1);
}

/* Requests infos[0 .. count) and waits for the results. */
static struct bvhd_batch *submit(struct bvhd_client *client, struct bvhd_build *build)
{
    struct bvhd_batch *batch;
    struct bvhd_error error;
    uint32_t i;
    build->struct_size = sizeof *build;
    build->target = build->format ? build->format->target : BVHD_TARGET_PORTABLE;
    example_must(bvhd_batch_submit(client, build, &batch, &error), &error);
    bvhd_batch_wait(batch, -1);
    for (i = 0; i < build->info_count; i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        example_must(result->error.status, &result->error);
    }
    return batch;
}

/* Builds the square [0, 1] x [0, 1], and half of it. */
static struct bvhd_batch *build_bottoms(struct bvhd_client *client, const struct bvhd_format *format)
{
    static const float square[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, half[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const uint16_t square_indices[] = {0, 1, 2, 0, 2, 3}, half_indices[] = {0, 1, 2};
    const VkAccelerationStructureBuildRangeInfoKHR counts[EXAMPLE_BOTTOMS] = {{.primitiveCount = 2},
                                                                              {.primitiveCount = 1}};
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[EXAMPLE_BOTTOMS] = {&counts[0], &counts[1]};
    VkAccelerationStructureGeometryKHR geometries[EXAMPLE_BOTTOMS];
    VkAccelerationStructureBuildGeometryInfoKHR infos[EXAMPLE_BOTTOMS];
    struct bvhd_build build = {.info_count = EXAMPLE_BOTTOMS, .infos = infos, .ranges = ranges, .format = format};
    int i;
    for (i = 0; i < EXAMPLE_BOTTOMS; i++) {
        const VkAccelerationStructureGeometryKHR geometry = {
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
            .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
            .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                                   .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                                   .vertexData.hostAddress = i == 0 ? square : half,
                                   .vertexStride = 3 * sizeof(float),
                                   .maxVertex = i == 0 ? 3 : 2,
                                   .indexType = VK_INDEX_TYPE_UINT16,
                                   .indexData.hostAddress = i == 0 ? square_indices : half_indices}};
        const VkAccelerationStructureBuildGeometryInfoKHR info = {
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
            .geometryCount = 1,
            .pGeometries = &geometries[i]};
        geometries[i] = geometry;
        infos[i] = info;
    }
    return submit(client, &build);
}

/*
 * Instances name structures by numbers that the program chooses; `references` tells the service which structure each
 * number means.
 */
static struct bvhd_batch *build_top(struct bvhd_client *client, const struct bvhd_format *format,
                                    struct bvhd_batch *bottoms)
{
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    struct bvhd_reference references[EXAMPLE_BOTTOMS];
    const VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.hostAddress = instances}};
    const VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        .geometryCount = 1,
        .pGeometries = &geometry};
    const VkAccelerationStructureBuildRangeInfoKHR count = {.primitiveCount = INSTANCES}, *const range = &count;
    struct bvhd_build build = {.info_count = 1,
                               .infos = &info,
                               .ranges = &range,
                               .references = references,
                               .reference_count = EXAMPLE_BOTTOMS,
                               .format = format};
    uint32_t i;
    for (i = 0; i < EXAMPLE_BOTTOMS; i++)
        bvhd_reference_from_result(bvhd_batch_result(bottoms, i), i + 1, &references[i]);
    /* Alternates between the square and the triangle, at (0, 0, 0), (2, 0, 1), (0, 2, 2), (2, 2, 3). */
    for (i = 0; i < INSTANCES; i++) {
        const VkAccelerationStructureInstanceKHR instance = {
            .transform = {{{1, 0, 0, (float)(2 * (i % 2))}, {0, 1, 0, (float)(2 * (i / 2))}, {0, 0, 1, (float)i}}},
            .mask = 0xff,
            .accelerationStructureReference = references[i % 2].handle};
        instances[i] = instance;
    }
    return submit(client, &build);
}

void example_build(struct example_build *build, const struct bvhd_format *format)
{
    struct bvhd_error error;
    int i;
    example_must(bvhd_client_create(NULL, &build->client, &error), &error);
    build->bottoms = build_bottoms(build->client, format);
    build->top = build_top(build->client, format, build->bottoms);
    /*
     * Rows are in the order in which instances first name structures. Here that is the order of the references; in
     * general bvhd_vulkan_rows computes it.
     */
    for (i = 0; i < EXAMPLE_BOTTOMS; i++)
        build->results[i] = bvhd_batch_result(build->bottoms, (uint32_t)i);
    build->results[EXAMPLE_BOTTOMS] = bvhd_batch_result(build->top, 0);
}

void example_build_end(struct example_build *build)
{
    bvhd_batch_destroy(build->top);
    bvhd_batch_destroy(build->bottoms);
    bvhd_client_destroy(build->client);
}

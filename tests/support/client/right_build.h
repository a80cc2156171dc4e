/* SPDX-License-Identifier: Apache-2.0 */
/*
 * right_build.h - a right build of three structures, of which test_misuse.c makes wrong ones. For one test program
 * only.
 */
#ifndef BVHD_RIGHT_BUILD_H
#define BVHD_RIGHT_BUILD_H

#include <string.h>

#include <bvhd/bvhd.h>

enum { INSTANCES = 2 };

/*
 * The objects that the calls of a row change: a right build of a bottom level of triangles, one of boxes, and a top
 * level.
 */
struct world {
    struct bvhd_client *client;
    struct bvhd_error error;
    float vertices[12], boxes[12];
    uint32_t indices[6];
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    const VkAccelerationStructureInstanceKHR *pointers[INSTANCES];
    VkAccelerationStructureGeometryKHR geometries[4]; /* the last one is of the triangles too */
    const VkAccelerationStructureGeometryKHR *geometry_pointers[2];
    VkAccelerationStructureBuildRangeInfoKHR ranges[4];
    const VkAccelerationStructureBuildRangeInfoKHR *range_pointers[3];
    VkAccelerationStructureBuildGeometryInfoKHR infos[3];
    struct bvhd_reference references[3];
    struct bvhd_format format;
    struct bvhd_build build;
};

static struct world world;

#define DATA world.geometries[0].geometry.triangles
#define BOXES world.geometries[1].geometry.aabbs
#define NAMED world.geometries[2].geometry.instances

static void describe_geometries(void)
{
    for (int i = 0; i < 4; i++)
        world.geometries[i].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
    DATA = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = world.vertices,
        .vertexStride = 12,
        .maxVertex = 3,
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = world.indices};
    world.geometries[3] = world.geometries[0];
    world.geometries[1].geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
    BOXES = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .data.hostAddress = world.boxes,
        .stride = 24};
    world.geometries[2].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
    NAMED = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.hostAddress = world.instances};
}

static void describe_data(void)
{
    static const float vertices[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1};
    static const float boxes[12] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
    static const uint32_t indices[6] = {0, 1, 2, 2, 1, 3};
    memcpy(world.vertices, vertices, sizeof vertices);
    memcpy(world.boxes, boxes, sizeof boxes);
    memcpy(world.indices, indices, sizeof indices);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        world.instances[i] =
            (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                 .mask = 255,
                                                 .accelerationStructureReference = 11 + i};
        world.pointers[i] = &world.instances[i];
    }
    for (uint32_t i = 0; i < 3; i++)
        world.references[i] = (struct bvhd_reference){.handle = 21 + i, .bounds = {0, 0, 0, 1, 1, 1}};
}

/* Makes everything right. */
static void reset(void)
{
    struct bvhd_client *client = world.client;
    memset(&world, 0, sizeof world);
    world.client = client;
    describe_geometries();
    describe_data();
    for (uint32_t i = 0; i < 3; i++) {
        world.ranges[i].primitiveCount = 2;
        world.range_pointers[i] = &world.ranges[i];
        world.infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type =
                i < 2 ? VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR : VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
            .dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)(11 + i),
            .geometryCount = 1,
            .pGeometries = &world.geometries[i]};
    }
    world.format = (struct bvhd_format){
        .struct_size = sizeof world.format, .target = BVHD_TARGET_LAVAPIPE, .variant = 1, .driver_uuid = {1}};
    world.build = (struct bvhd_build){.struct_size = sizeof world.build,
                                      .info_count = 3,
                                      .infos = world.infos,
                                      .ranges = world.range_pointers,
                                      .references = world.references,
                                      .reference_count = 3,
                                      .quality = BVHD_QUALITY_FAST};
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * one_batch.c - tests that a top level has the same key and bytes whether its bottom levels are built in the same
 * batch, are described by their results, or are looked up by their keys: by a daemon, and in the program's own process.
 *
 *     one_batch BVHD
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd.h>

#include "tests/support/daemon/service_process.h"

/* Bottom levels: two meshes, one that is empty, and one that is a point at the origin. */
enum { BOTTOMS = 4, INSTANCES = 9 };

static const float meshes[BOTTOMS][9] = {
    {0, 0, 0, 1, 0, 0, 0, 1, 0}, {-3, 0, 1, 1, 5, 0, 0, 1, 2}, {0}, {0, 0, 0, 0, 0, 0, 0, 0, 0}};

/* The infos of a batch of bottom levels and the top level over them; the top level is the last info. */
struct scene {
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    VkAccelerationStructureGeometryKHR geometries[BOTTOMS + 1];
    VkAccelerationStructureBuildRangeInfoKHR ranges[BOTTOMS + 1];
    const VkAccelerationStructureBuildRangeInfoKHR *range_pointers[BOTTOMS + 1];
    VkAccelerationStructureBuildGeometryInfoKHR infos[BOTTOMS + 1];
    struct bvhd_reference references[BOTTOMS];
};

static void expect(bool good, const char *what)
{
    if (good)
        return;
    printf("failed: %s\n", what);
    exit(1);
}

static void describe_mesh(struct scene *scene, uint32_t i)
{
    scene->geometries[i].geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
    scene->geometries[i].geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = meshes[i],
        .vertexStride = 12,
        .maxVertex = 2,
        .indexType = VK_INDEX_TYPE_NONE_KHR};
    scene->ranges[i].primitiveCount = i != 2;
}

static void describe_instances(struct scene *scene)
{
    for (uint32_t i = 0; i < INSTANCES; i++)
        scene->instances[i] = (VkAccelerationStructureInstanceKHR){
            .transform = {{{1, 0.5f, 0, (float)i}, {-0.5f, 1, 0, 2}, {0, 0.25f, 1, -1}}},
            .mask = 255,
            .instanceCustomIndex = i,
            .accelerationStructureReference = i * i % BOTTOMS + 1};
    scene->instances[3].accelerationStructureReference = 3;
    scene->geometries[BOTTOMS].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
    scene->geometries[BOTTOMS].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.hostAddress = scene->instances};
    scene->ranges[BOTTOMS].primitiveCount = INSTANCES;
}

static void describe(struct scene *scene)
{
    memset(scene, 0, sizeof *scene);
    for (uint32_t i = 0; i < BOTTOMS; i++)
        describe_mesh(scene, i);
    describe_instances(scene);
    for (uint32_t i = 0; i <= BOTTOMS; i++) {
        scene->geometries[i].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
        scene->range_pointers[i] = &scene->ranges[i];
        scene->infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = i < BOTTOMS ? VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
                                : VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
            .dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)(i + 1),
            .geometryCount = 1,
            .pGeometries = &scene->geometries[i]};
    }
}

/* Builds infos [first, first + count) and waits for them. */
static struct bvhd_batch *build(struct bvhd_client *client, const struct scene *scene, uint32_t first, uint32_t count,
                                uint32_t reference_count)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    struct bvhd_build request = {.struct_size = sizeof request,
                                 .info_count = count,
                                 .infos = scene->infos + first,
                                 .ranges = scene->range_pointers + first,
                                 .references = scene->references,
                                 .reference_count = reference_count};
    if (bvhd_batch_submit(client, &request, &batch, &error) != BVHD_OK) {
        printf("%s: %s\n", error.where, error.text);
        exit(1);
    }
    expect(bvhd_batch_wait(batch, 60000) == BVHD_OK, "wait");
    for (uint32_t i = 0; i < count; i++) {
        error = bvhd_batch_result(batch, i)->error;
        if (error.status != BVHD_OK)
            printf("%s: %s: %s\n", bvhd_status_name(error.status), error.where, error.text);
        expect(error.status == BVHD_OK, "result");
    }
    return batch;
}

static void expect_equal(struct bvhd_batch *batch, uint32_t item, const struct bvhd_result *expected, const char *what)
{
    const struct bvhd_result *result = bvhd_batch_result(batch, item);
    expect(memcmp(&result->key, &expected->key, sizeof result->key) == 0, what);
    expect(result->size == expected->size && memcmp(result->data, expected->data, result->size) == 0, what);
    bvhd_batch_destroy(batch);
}

static void run(struct bvhd_client *client)
{
    struct scene scene;
    describe(&scene);
    struct bvhd_batch *bottoms = build(client, &scene, 0, BOTTOMS, 0);
    for (uint32_t i = 0; i < BOTTOMS; i++)
        expect(bvhd_reference_from_result(bvhd_batch_result(bottoms, i), i + 1, &scene.references[i]) == BVHD_OK,
               "a reference from a result");
    struct bvhd_batch *top = build(client, &scene, BOTTOMS, 1, BOTTOMS);
    const struct bvhd_result *result = bvhd_batch_result(top, 0);
    expect(result->instances == INSTANCES, "instances");
    expect(bvhd_reference_from_result(result, 1, &scene.references[0]) == BVHD_INVALID, "a top level is no reference");
    expect_equal(build(client, &scene, 0, BOTTOMS + 1, 0), BOTTOMS, result, "one batch");
    for (uint32_t i = 0; i < BOTTOMS; i++) { /* as programs did before there were references from results */
        memcpy(scene.references[i].bounds, bvhd_batch_result(bottoms, i)->bounds, sizeof scene.references[i].bounds);
        memcpy(scene.references[i].slabs, bvhd_batch_result(bottoms, i)->slabs, sizeof scene.references[i].slabs);
    }
    expect_equal(build(client, &scene, BOTTOMS, 1, BOTTOMS), 0, result, "copied bounds");
    for (uint32_t i = 0; i < BOTTOMS; i++) {
        memset(scene.references[i].bounds, 0, sizeof scene.references[i].bounds);
        memset(scene.references[i].slabs, 0, sizeof scene.references[i].slabs);
    }
    expect_equal(build(client, &scene, BOTTOMS, 1, BOTTOMS), 0, result, "bounds by key");
    bvhd_batch_destroy(bottoms);
    bvhd_batch_destroy(top);
}

int main(int argc, char **argv)
{
    struct service_process service;
    struct bvhd_client *client;
    if (argc != 2)
        return 2;
    service_process_start(&service, argv[1], NULL);
    for (uint32_t threads = 0; threads <= 2; threads++) { /* in this process; by the daemon; here on two threads */
        struct bvhd_client_options options = {.struct_size = sizeof options,
                                              .socket_path = service.socket,
                                              .local = threads == 1 ? BVHD_LOCAL_NEVER : BVHD_LOCAL_ALWAYS,
                                              .local_threads = threads};
        expect(bvhd_client_create(&options, &client, NULL) == BVHD_OK, "a client");
        run(client);
        bvhd_client_destroy(client);
    }
    return service_process_stop(&service) ? 0 : 1;
}

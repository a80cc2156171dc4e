/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/bvhctl/moving_world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bvhd/vulkan_nv.h"
#include "tests/support/builder/builders.h"

/* sin(40 degrees) and cos(40 degrees): half of the angle by which the second cube turns. */
#define TURN_SINE 0.64278761F
#define TURN_COSINE 0.76604444F

const struct moving_place moving_places[MOVING_WORLD_INSTANCES] = {
    {.bottom = 0,
     .motion = MOTION_STATIC,
     .start = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
     .end = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}},
    {.bottom = 1,
     .motion = MOTION_MATRIX,
     .start = {1, 0, 0, -5, 0, 1, 0, 4, 0, 0, 1, -4},
     .end = {1, 0, 0, 5, 0, 1, 0, 4, 0, 0, 1, -4}},
    {.bottom = 1,
     .motion = MOTION_SRT,
     .start = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 4},
     .end = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, TURN_SINE, 0, TURN_COSINE, 0, 4, 4}},
    {.bottom = 2,
     .motion = MOTION_MATRIX,
     .start = {1, 0, 0, 5, 0, 1, 0, 3, 0, 0, 1, 2},
     .end = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 2}},
};

/* The x, y, z of corner i are bits 0, 1, 2 of i. */
static const float cube_positions[] = {-1, -1, -1, 1, -1, -1, -1, 1, -1, 1, 1, -1,
                                       -1, -1, 1,  1, -1, 1,  -1, 1, 1,  1, 1, 1};
static const uint32_t cube_indices[] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                        2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
static const float ball_centre[3] = {0, 0, 0}, ball_radius = 1;

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "moving_world: %s: %s\n", error->where, error->text);
    exit(1);
}

static void make_sheet(struct moving_sheet *sheet)
{
    enum { ROW = MOVING_WORLD_SIDE + 1 };
    for (uint32_t i = 0; i < MOVING_WORLD_VERTICES; i++) {
        const float x = (float)(i % ROW) - MOVING_WORLD_SIDE / 2, z = (float)(i / ROW) - MOVING_WORLD_SIDE / 2;
        const float start[3] = {x, 0, z}, end[3] = {x, 0.5f + 0.75f * sinf(x), z + 0.25f};
        memcpy(sheet->start + (size_t)3 * i, start, sizeof start);
        memcpy(sheet->end + (size_t)3 * i, end, sizeof end);
    }
    for (uint32_t i = 0; i < MOVING_WORLD_TRIANGLES; i++) {
        const uint32_t at = i / 2 % MOVING_WORLD_SIDE + i / 2 / MOVING_WORLD_SIDE * ROW;
        const uint32_t lower[3] = {at, at + ROW, at + 1}, upper[3] = {at + 1, at + ROW, at + ROW + 1};
        memcpy(sheet->indices + (size_t)3 * i, i % 2 ? upper : lower, sizeof lower);
    }
}

static VkAccelerationStructureKHR handle_of(uint64_t number)
{
    VkAccelerationStructureKHR handle;
    memcpy(&handle, &number, sizeof handle);
    return handle;
}

static VkAccelerationStructureGeometryKHR triangles_of(const float *positions, const void *later, uint32_t vertices,
                                                       const uint32_t *indices)
{
    return (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .pNext = later,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexData.hostAddress = positions,
                               .vertexStride = 3 * sizeof *positions,
                               .maxVertex = vertices - 1,
                               .indexType = VK_INDEX_TYPE_UINT32,
                               .indexData.hostAddress = indices}};
}

static void run_build(struct moving_world *world, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                      const VkAccelerationStructureBuildRangeInfoKHR *const *ranges, uint32_t count,
                      const struct bvhd_reference *references, struct bvhd_result *results, void **hold)
{
    struct backend *backend = &world->backend.backend;
    struct bvhd_error error = {0};
    const struct bvhd_build build = {.struct_size = sizeof build,
                                     .info_count = count,
                                     .infos = infos,
                                     .ranges = ranges,
                                     .references = references,
                                     .reference_count = references ? MOVING_WORLD_BOTTOMS : 0,
                                     .builder = (enum bvhd_builder)builders_asked()};
    must(backend->build(backend, &build, results, hold, &error), &error);
    for (uint32_t i = 0; i < count; i++)
        must(results[i].error.status, &results[i].error);
}

static void build_bottoms(struct moving_world *world)
{
    const VkAccelerationStructureGeometryMotionTrianglesDataNV later = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
        .vertexData.hostAddress = world->sheet.end};
    const VkAccelerationStructureGeometrySpheresDataNV spheres = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = ball_centre,
        .vertexStride = sizeof ball_centre,
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = &ball_radius,
        .radiusStride = sizeof ball_radius,
        .indexType = VK_INDEX_TYPE_NONE_KHR};
    const VkAccelerationStructureGeometryKHR geometries[MOVING_WORLD_BOTTOMS] = {
        triangles_of(world->sheet.start, &later, MOVING_WORLD_VERTICES, world->sheet.indices),
        triangles_of(cube_positions, NULL, 8, cube_indices),
        {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
         .pNext = &spheres,
         .geometryType = VK_GEOMETRY_TYPE_SPHERES_NV,
         .flags = VK_GEOMETRY_OPAQUE_BIT_KHR}};
    const VkAccelerationStructureBuildRangeInfoKHR rows[MOVING_WORLD_BOTTOMS] = {
        {.primitiveCount = MOVING_WORLD_TRIANGLES}, {.primitiveCount = 12}, {.primitiveCount = 1}};
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {&rows[0], &rows[1], &rows[2]};
    VkAccelerationStructureBuildGeometryInfoKHR infos[MOVING_WORLD_BOTTOMS];
    for (uint32_t i = 0; i < MOVING_WORLD_BOTTOMS; i++)
        infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
            .flags = i == 0 ? VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV : 0,
            .dstAccelerationStructure = handle_of(i + 1),
            .geometryCount = 1,
            .pGeometries = &geometries[i]};
    run_build(world, infos, ranges, MOVING_WORLD_BOTTOMS, NULL, world->bottoms, &world->holds[0]);
}

/* As Vulkan reads them: one every 160 bytes. */
struct motion_record {
    VkAccelerationStructureMotionInstanceNV instance;
    uint64_t padding;
};

static void place(const struct moving_place *from, struct motion_record *record)
{
    VkAccelerationStructureMotionInstanceDataNV *data = &record->instance.data;
    const uint64_t reference = from->bottom + UINT64_C(1);
    record->instance.type = (VkAccelerationStructureMotionInstanceTypeNV)from->motion;
    if (from->motion == MOTION_STATIC) {
        data->staticInstance.mask = 0xff;
        data->staticInstance.accelerationStructureReference = reference;
        memcpy(&data->staticInstance.transform, from->start, sizeof data->staticInstance.transform);
    } else if (from->motion == MOTION_MATRIX) {
        data->matrixMotionInstance.mask = 0xff;
        data->matrixMotionInstance.accelerationStructureReference = reference;
        memcpy(&data->matrixMotionInstance.transformT0, from->start, sizeof(VkTransformMatrixKHR));
        memcpy(&data->matrixMotionInstance.transformT1, from->end, sizeof(VkTransformMatrixKHR));
    } else {
        data->srtMotionInstance.mask = 0xff;
        data->srtMotionInstance.accelerationStructureReference = reference;
        memcpy(&data->srtMotionInstance.transformT0, from->start, sizeof(VkSRTDataNV));
        memcpy(&data->srtMotionInstance.transformT1, from->end, sizeof(VkSRTDataNV));
    }
}

static void build_top(struct moving_world *world)
{
    struct motion_record records[MOVING_WORLD_INSTANCES];
    struct bvhd_reference references[MOVING_WORLD_BOTTOMS];
    memset(records, 0, sizeof records);
    for (uint32_t i = 0; i < MOVING_WORLD_INSTANCES; i++)
        place(&moving_places[i], &records[i]);
    for (uint32_t i = 0; i < MOVING_WORLD_BOTTOMS; i++) {
        const struct bvhd_result *bottom = &world->bottoms[i];
        references[i] = (struct bvhd_reference){.handle = i + UINT64_C(1), .has_key = 1, .key = bottom->key};
        memcpy(references[i].bounds, bottom->bounds, sizeof references[i].bounds);
        memcpy(references[i].slabs, bottom->slabs, sizeof references[i].slabs);
    }
    const VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.hostAddress = records}};
    const VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        .flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV,
        .dstAccelerationStructure = handle_of(MOVING_WORLD_BOTTOMS + 1),
        .geometryCount = 1,
        .pGeometries = &geometry};
    const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = MOVING_WORLD_INSTANCES}, *ranges = &range;
    run_build(world, &info, &ranges, 1, references, &world->top, &world->holds[1]);
}

static void open_structures(struct moving_world *world)
{
    struct memory *memory = &world->local.memory;
    struct bvhd_error error = {0};
    struct structure_file *files = memory_array(memory, MOVING_WORLD_BOTTOMS + 1, sizeof *files);
    if (!files)
        must(BVHD_NO_MEMORY, &error);
    for (uint32_t i = 0; i <= MOVING_WORLD_BOTTOMS; i++) {
        const struct bvhd_result *result = i < MOVING_WORLD_BOTTOMS ? &world->bottoms[i] : &world->top;
        files[i] = (struct structure_file){.size = result->size};
        must(structure_open((struct bytes){result->data, result->size}, memory, &files[i].structure, &error), &error);
    }
    world->structures =
        (struct structures){.files = files, .file_count = MOVING_WORLD_BOTTOMS + 1, .has_top = true, .memory = memory};
    must(structures_join(&world->structures, &error), &error);
}

void moving_world_init(struct moving_world *world, uint32_t threads)
{
    struct bvhd_error error = {0};
    *world = (struct moving_world){.holds = {NULL}};
    must(local_open(&world->local, threads, UINT64_MAX, &error), &error);
    must(backend_local_open(&world->backend, threads, &world->local.memory, &world->local.progress, &error), &error);
    make_sheet(&world->sheet);
    build_bottoms(world);
    build_top(world);
    open_structures(world);
}

void moving_world_finish(struct moving_world *world)
{
    struct backend *backend = &world->backend.backend;
    structures_close(&world->structures);
    backend->release(backend, world->holds[1]);
    backend->release(backend, world->holds[0]);
    backend_local_close(&world->backend);
    local_close(&world->local);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* assemble_mesh.c - describes meshes as geometries of Vulkan, by their shape; and instances, by their motion. */
#include "client/bvhctl/scene/assemble_internal.h"

#include <string.h>

static uint32_t max_vertex(const struct import_mesh *mesh)
{
    return mesh->vertex_count ? mesh->vertex_count - 1 : 0;
}

static void describe_triangles(const struct import_mesh *mesh, union assemble_chain *chain,
                               VkAccelerationStructureGeometryKHR *geometry)
{
    geometry->geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
    geometry->geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = mesh->positions,
        .vertexStride = 3 * sizeof(float),
        .maxVertex = max_vertex(mesh),
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = mesh->indices};
    if (!mesh->end_positions)
        return;
    chain->motion = (VkAccelerationStructureGeometryMotionTrianglesDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
        .vertexData.hostAddress = mesh->end_positions};
    geometry->geometry.triangles.pNext = &chain->motion;
}

/* Point i is vertex i, so that no indices are needed. */
static void describe_points(const struct import_mesh *mesh, union assemble_chain *chain,
                            VkAccelerationStructureGeometryKHR *geometry)
{
    geometry->geometryType = VK_GEOMETRY_TYPE_SPHERES_NV;
    geometry->pNext = chain;
    chain->spheres = (VkAccelerationStructureGeometrySpheresDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = mesh->positions,
        .vertexStride = 3 * sizeof(float),
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = mesh->radii,
        .radiusStride = sizeof(float),
        .indexType = VK_INDEX_TYPE_NONE_KHR};
}

/* A line is from a vertex to the next one, so that of its two indices the first one is enough. */
static void describe_lines(const struct import_mesh *mesh, union assemble_chain *chain,
                           VkAccelerationStructureGeometryKHR *geometry)
{
    geometry->geometryType = VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV;
    geometry->pNext = chain;
    chain->swept_spheres = (VkAccelerationStructureGeometryLinearSweptSpheresDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = mesh->positions,
        .vertexStride = 3 * sizeof(float),
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = mesh->radii,
        .radiusStride = sizeof(float),
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = mesh->indices,
        .indexStride = 2 * sizeof(uint32_t),
        .indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV,
        .endCapsMode = VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV};
}

VkAccelerationStructureGeometryKHR assemble_describe_mesh(const struct import_mesh *mesh, uint32_t geometry_flags,
                                                          union assemble_chain *chain)
{
    static void (*const describe[IMPORT_SHAPES])(const struct import_mesh *, union assemble_chain *,
                                                 VkAccelerationStructureGeometryKHR *) = {
        [IMPORT_TRIANGLES] = describe_triangles, [IMPORT_POINTS] = describe_points, [IMPORT_LINES] = describe_lines};
    VkAccelerationStructureGeometryKHR geometry = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                   .flags = geometry_flags};
    describe[mesh->shape](mesh, chain, &geometry);
    return geometry;
}

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

VkAccelerationStructureInstanceKHR assemble_describe_instance(const struct import *import, uint32_t index,
                                                              uint64_t handle)
{
    const struct import_instance *instance = &import->instances[index];
    VkAccelerationStructureInstanceKHR record = {
        .instanceCustomIndex = index & 0xffffff,
        .mask = 0xff,
        .accelerationStructureReference = instance->skipped ? 0 : handle,
    };
    memcpy(record.transform.matrix, instance->skipped ? identity : instance->transform, sizeof record.transform.matrix);
    return record;
}

static void describe_matrices(const struct import_motion *motion, uint32_t index, uint64_t handle,
                              VkAccelerationStructureMatrixMotionInstanceNV *ret_record)
{
    *ret_record = (VkAccelerationStructureMatrixMotionInstanceNV){
        .instanceCustomIndex = index & 0xffffff, .mask = 0xff, .accelerationStructureReference = handle};
    memcpy(ret_record->transformT0.matrix, motion->start, sizeof ret_record->transformT0.matrix);
    memcpy(ret_record->transformT1.matrix, motion->end, sizeof ret_record->transformT1.matrix);
}

static void describe_srt(const struct import_motion *motion, uint32_t index, uint64_t handle,
                         VkAccelerationStructureSRTMotionInstanceNV *ret_record)
{
    _Static_assert(sizeof ret_record->transformT0 == sizeof motion->start, "16 numbers, in the order of VkSRTDataNV");
    *ret_record = (VkAccelerationStructureSRTMotionInstanceNV){
        .instanceCustomIndex = index & 0xffffff, .mask = 0xff, .accelerationStructureReference = handle};
    memcpy(&ret_record->transformT0, motion->start, sizeof motion->start);
    memcpy(&ret_record->transformT1, motion->end, sizeof motion->end);
}

struct assemble_motion_record assemble_describe_motion(const struct import *import, uint32_t index, uint64_t handle)
{
    const struct import_instance *instance = &import->instances[index];
    const struct import_motion *motion =
        instance->motion && !instance->skipped ? &import->motions[instance->motion - 1] : NULL;
    struct assemble_motion_record record = {.instance.type = VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_STATIC_NV};
    if (!motion) {
        record.instance.data.staticInstance = assemble_describe_instance(import, index, handle);
    } else if (motion->kind == ORACLE_SRT) {
        record.instance.type = VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_SRT_MOTION_NV;
        describe_srt(motion, index, handle, &record.instance.data.srtMotionInstance);
    } else {
        record.instance.type = VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_MATRIX_MOTION_NV;
        describe_matrices(motion, index, handle, &record.instance.data.matrixMotionInstance);
    }
    return record;
}

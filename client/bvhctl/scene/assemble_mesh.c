/* SPDX-License-Identifier: Apache-2.0 */
/* assemble_mesh.c - describes meshes as geometries of Vulkan, by their shape. */
#include "client/bvhctl/scene/assemble_internal.h"

static uint32_t max_vertex(const struct import_mesh *mesh)
{
    return mesh->vertex_count ? mesh->vertex_count - 1 : 0;
}

static void describe_triangles(const struct import_mesh *mesh, union assemble_round *round,
                               VkAccelerationStructureGeometryKHR *geometry)
{
    (void)round;
    geometry->geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
    geometry->geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = mesh->positions,
        .vertexStride = 3 * sizeof(float),
        .maxVertex = max_vertex(mesh),
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = mesh->indices};
}

/* Point i is vertex i, so that no indices are needed. */
static void describe_points(const struct import_mesh *mesh, union assemble_round *round,
                            VkAccelerationStructureGeometryKHR *geometry)
{
    geometry->geometryType = VK_GEOMETRY_TYPE_SPHERES_NV;
    geometry->pNext = round;
    round->spheres = (VkAccelerationStructureGeometrySpheresDataNV){
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
static void describe_lines(const struct import_mesh *mesh, union assemble_round *round,
                           VkAccelerationStructureGeometryKHR *geometry)
{
    geometry->geometryType = VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV;
    geometry->pNext = round;
    round->swept_spheres = (VkAccelerationStructureGeometryLinearSweptSpheresDataNV){
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
                                                          union assemble_round *round)
{
    static void (*const describe[IMPORT_SHAPES])(const struct import_mesh *, union assemble_round *,
                                                 VkAccelerationStructureGeometryKHR *) = {
        [IMPORT_TRIANGLES] = describe_triangles, [IMPORT_POINTS] = describe_points, [IMPORT_LINES] = describe_lines};
    VkAccelerationStructureGeometryKHR geometry = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                   .flags = geometry_flags};
    describe[mesh->shape](mesh, round, &geometry);
    return geometry;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * structure_bed.h - right calls of bvhd_structure.h, and a check that a wrong one gets its rule. For tests of the
 * client library; a test changes one argument of a call that is right without the change.
 */
#ifndef BVHD_STRUCTURE_BED_H
#define BVHD_STRUCTURE_BED_H

#include <string.h>

#include <bvhd/bvhd_structure.h>
#include <bvhd/vulkan_nv.h>

#include "builder/update/batch.h"
#include "client/library.h"
#include "client/result_blob.h"
#include "client/vulkan_input.h"

enum { STRUCTURE_TRIANGLES = 12, STRUCTURE_INSTANCES = 3, STRUCTURE_ROOM = 1 << 16 };

/* What was built, by Vulkan's structs, and its result. */
struct structure_build {
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureBuildRangeInfoKHR range;
    struct bvhd_result result;
};

/* A bottom level, a top level over it, and objects that hold them; `spare` is empty. */
struct structure_bed {
    float vertices[STRUCTURE_TRIANGLES][3][3]; /* or centres */
    float radius; /* of each sphere, and of each end of a linear swept sphere */
    VkAccelerationStructureGeometrySpheresDataNV spheres;
    VkAccelerationStructureGeometryLinearSweptSpheresDataNV swept;
    VkAccelerationStructureInstanceKHR instances[STRUCTURE_INSTANCES];
    struct structure_build bottom, top;
    struct bvhd_structure *holds_bottom, *holds_top, *spare, *small; /* `small` was created with 64 bytes */
    unsigned char *room; /* STRUCTURE_ROOM bytes */
    uint64_t live; /* bytes of library_memory that were live before */
    struct bvhd_error error;
};

static const struct build_context structure_context = {.memory = &library_memory, .parallel = &parallel_serial};

/* Builds in this process, without a client. */
static inline struct bvhd_result structure_bed_result(const struct structure_build *build,
                                                      const struct build_options *options)
{
    const struct limits limits = limits_default();
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {&build->range};
    const struct reference reference = {.kind = REFERENCE_BLAS, .handle = 5, .bounds = {{0, 0, 0}, {1, 1, 1}}};
    struct bvhd_result result = {.quality = BVHD_QUALITY_BALANCED, .error = {.status = BVHD_OK}};
    struct vulkan_input *input;
    struct batch_item item;
    assert_int_equal(
        vulkan_input_create_in(&library_memory, &build->info, 1, ranges, &reference, 1, options, &input, &result.error),
        BVHD_OK);
    assert_int_equal(result.error.status, BVHD_OK);
    assert_int_equal(batch_build(vulkan_input_entries(input), 1, &limits, &structure_context, &item, &result.error),
                     BVHD_OK);
    if (item.status != BVHD_OK)
        fail_msg("%s: %s", item.error.where, item.error.text);
    assert_int_equal(result_blob_copy((struct bytes){item.blob, item.size}, &result.blob, NULL), BVHD_OK);
    result.data = bvhd_blob_data(result.blob);
    result.size = item.size;
    batch_finish(&item, 1, &library_memory);
    vulkan_input_destroy(input);
    return result;
}

/* Makes both structs of shapes that are as many as the triangles, on the same vertices. */
static inline void structure_bed_describe_round(struct structure_bed *bed)
{
    bed->radius = 0.125f;
    bed->spheres = (VkAccelerationStructureGeometrySpheresDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = bed->vertices,
        .vertexStride = 12,
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = &bed->radius,
        .indexType = VK_INDEX_TYPE_NONE_KHR};
    memcpy(&bed->swept, &bed->spheres, sizeof bed->spheres);
    bed->swept.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV;
    bed->swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_LIST_NV;
    bed->swept.endCapsMode = VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV;
}

static inline void structure_bed_describe(struct structure_bed *bed, struct structure_build *build,
                                          VkGeometryTypeKHR type, uint32_t flags)
{
    const bool is_top = type == VK_GEOMETRY_TYPE_INSTANCES_KHR;
    build->geometry = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR, .geometryType = type};
    structure_bed_describe_round(bed);
    if (type == VK_GEOMETRY_TYPE_SPHERES_NV)
        build->geometry.pNext = &bed->spheres;
    else if (type == VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV)
        build->geometry.pNext = &bed->swept;
    else if (is_top)
        build->geometry.geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
            .data.hostAddress = bed->instances};
    else
        build->geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.hostAddress = bed->vertices,
            .vertexStride = 12,
            .maxVertex = 3 * STRUCTURE_TRIANGLES - 1,
            .indexType = VK_INDEX_TYPE_NONE_KHR};
    build->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = is_top ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .flags = flags,
        .geometryCount = 1,
        .pGeometries = &build->geometry};
    build->range.primitiveCount = is_top ? STRUCTURE_INSTANCES : STRUCTURE_TRIANGLES;
}

static inline VkAccelerationStructureCreateInfoKHR structure_bed_create_info(VkAccelerationStructureTypeKHR type,
                                                                             uint64_t size)
{
    return (VkAccelerationStructureCreateInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR, .type = type, .size = size};
}

static inline struct bvhd_structure *structure_bed_create(VkAccelerationStructureTypeKHR type, uint64_t size)
{
    const VkAccelerationStructureCreateInfoKHR info = structure_bed_create_info(type, size);
    struct bvhd_structure *structure = NULL;
    assert_int_equal(bvhd_structure_create(&info, &structure, NULL), BVHD_OK);
    return structure;
}

/* Builds both structures with these flags, for a target; the bottom level of this type of geometry. */
static inline void structure_bed_start_with(struct structure_bed *bed, VkGeometryTypeKHR type, uint32_t flags,
                                            enum target target)
{
    const struct build_options options = {
        .quality = QUALITY_BALANCED, .target = target, .device.variant = target == TARGET_LAVAPIPE};
    memset(bed, 0, sizeof *bed);
    bed->live = library_memory.live;
    for (int i = 0; i < 9 * STRUCTURE_TRIANGLES; i++)
        bed->vertices[i / 9][i / 3 % 3][i % 3] = (float)(i * i % 17) / 17;
    for (int i = 0; i < STRUCTURE_INSTANCES; i++)
        bed->instances[i] =
            (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, (float)i}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                 .mask = 255,
                                                 .accelerationStructureReference = 5};
    bed->holds_bottom = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, STRUCTURE_ROOM);
    bed->holds_top = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, STRUCTURE_ROOM);
    bed->spare = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, STRUCTURE_ROOM);
    bed->small = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, 64);
    bed->room = memory_alloc(&library_memory, STRUCTURE_ROOM);
    struct structure_build *const builds[] = {&bed->bottom, &bed->top};
    for (int i = 0; i < 2; i++) {
        structure_bed_describe(bed, builds[i], i == 0 ? type : VK_GEOMETRY_TYPE_INSTANCES_KHR, flags);
        builds[i]->result = structure_bed_result(builds[i], &options);
        if (bvhd_structure_hold(i == 0 ? bed->holds_bottom : bed->holds_top, &builds[i]->info, &builds[i]->range,
                                &builds[i]->result, &bed->error) != BVHD_OK)
            fail_msg("%s: %s", bed->error.where, bed->error.text);
    }
}

static inline void structure_bed_start(struct structure_bed *bed, uint32_t flags, enum target target)
{
    structure_bed_start_with(bed, VK_GEOMETRY_TYPE_TRIANGLES_KHR, flags, target);
}

/* Frees everything, and checks that nothing is left. */
static inline void structure_bed_stop(struct structure_bed *bed)
{
    bvhd_structure_destroy(bed->holds_bottom);
    bvhd_structure_destroy(bed->holds_top);
    bvhd_structure_destroy(bed->spare);
    bvhd_structure_destroy(bed->small);
    bvhd_blob_unref(bed->bottom.result.blob);
    bvhd_blob_unref(bed->top.result.blob);
    memory_free(&library_memory, bed->room);
    assert_int_equal(library_memory.live, bed->live);
}

/* Checks that a call was refused by this rule at this place. `rule` is a VUID, or "" for none. */
static inline void structure_bed_refused(const struct structure_bed *bed, const char *what, enum bvhd_status status,
                                         const char *rule, const char *where)
{
    const struct bvhd_error *error = &bed->error;
    if (status != BVHD_INVALID || error->status != status || strcmp(bvhd_vuid_string(error->vuid), rule) != 0 ||
        strcmp(error->where, where) != 0 || error->text[0] == '\0')
        fail_msg("%s: %s %s at %s: %s", what, bvhd_status_name(status), bvhd_vuid_string(error->vuid), error->where,
                 error->text);
}

/*
 * One row of a table: the call is right before the change and gets its rule with it.
 */
#define STRUCTURE_RULE(bed, right, change, call, rule, place)                                                          \
    do {                                                                                                               \
        right;                                                                                                         \
        if ((call) != BVHD_OK)                                                                                         \
            fail_msg("%s, unchanged: %s: %s", #change, (bed)->error.where, (bed)->error.text);                         \
        right;                                                                                                         \
        change;                                                                                                        \
        structure_bed_refused(bed, #change, call, rule, place);                                                        \
    } while (0)

#endif

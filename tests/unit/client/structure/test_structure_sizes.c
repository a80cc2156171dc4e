/* SPDX-License-Identifier: Apache-2.0 */
/* test_structure_sizes.c - tests the query of sizes by Vulkan's structs: its rules, and what it reads. */
#include "tests/support/unit.h"

#include "builder/format/size_bound.h"
#include "tests/support/client/structure_bed.h"

static struct structure_bed bed;
static VkAccelerationStructureBuildSizesInfoKHR sizes;
static struct bvhd_structure_sizes_query query;
static VkAccelerationStructureBuildGeometryInfoKHR info;
static VkAccelerationStructureGeometryKHR geometry;
static uint32_t count;

/* Makes a right query about the triangles, with addresses behind which there is nothing. */
static void reset(const struct structure_build *build)
{
    static char *const nowhere = (char *)16;
    geometry = build->geometry;
    if (geometry.geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        geometry.geometry.triangles.vertexData.hostAddress = nowhere;
        geometry.geometry.triangles.indexData.hostAddress = nowhere;
        geometry.geometry.triangles.transformData.hostAddress = nowhere;
        geometry.geometry.triangles.indexType = VK_INDEX_TYPE_UINT32;
    } else {
        geometry.geometry.instances.data.hostAddress = nowhere;
        geometry.geometry.instances.arrayOfPointers = VK_TRUE;
    }
    info = build->info;
    info.pGeometries = &geometry;
    count = 1000;
    query =
        (struct bvhd_structure_sizes_query){.struct_size = sizeof query, .info = &info, .max_primitive_counts = &count};
    sizes = (VkAccelerationStructureBuildSizesInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR, .buildScratchSize = 77};
}

static enum bvhd_status ask(void)
{
    return bvhd_structure_sizes(&query, &sizes, &bed.error);
}

static void every_rule_is_named(void **state)
{
    (void)state;
    static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
#define SIZES "VUID-vkGetAccelerationStructureBuildSizesKHR-"
#define SIZE_INFO "VUID-VkAccelerationStructureBuildSizesInfoKHR-"
#define INFO "VUID-VkAccelerationStructureBuildGeometryInfoKHR-"
#define RULE_OF(build, change, rule, where) STRUCTURE_RULE(&bed, reset(&bed.build), change, ask(), rule, where)
#define RULE(change, rule, where) RULE_OF(bottom, change, rule, where)
    RULE(query.struct_size = 0, "", "query.struct_size");
    RULE(sizes.sType = 0, SIZE_INFO "sType-sType", "ret_sizes.sType");
    RULE(sizes.pNext = (void *)(uintptr_t)&stray, SIZE_INFO "pNext-pNext", "ret_sizes.pNext");
    RULE(query.info = NULL, SIZES "pBuildInfo-parameter", "query.info");
    RULE(query.build_type = (VkAccelerationStructureBuildTypeKHR)3, SIZES "buildType-parameter", "query.build_type");
    RULE(query.max_primitive_counts = NULL, SIZES "pBuildInfo-03619", "query.max_primitive_counts");
    RULE_OF(top, count = 1 << 24, SIZES "pBuildInfo-03785", "max_primitive_counts[0]");
    RULE(query.quality = (enum bvhd_quality)9, "", "query.quality");
    RULE(query.layout_flags = 2, "", "query.layout_flags");
    RULE(info.sType = 0, INFO "sType-sType", "infos[0].sType");
    RULE(info.type = VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, INFO "type-03654", "infos[0].type");
    RULE(info.flags = 0xc, INFO "flags-03796", "infos[0].flags");
    RULE(info.geometryCount = 0x7fffffff, INFO "type-03793", "infos[0].geometryCount");
    RULE(info.pGeometries = NULL, INFO "pGeometries-03788", "infos[0].pGeometries");
    RULE(count = 1 << 29, INFO "type-03795", "ranges[0][0].primitiveCount");
    RULE(geometry.flags = 4, "VUID-VkAccelerationStructureGeometryKHR-flags-parameter", "infos[0].geometries[0].flags");
    RULE(geometry.geometry.triangles.vertexFormat = VK_FORMAT_R8_UNORM,
         "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-vertexFormat-03797",
         "infos[0].geometries[0].triangles.vertexFormat");
    RULE(geometry.geometry.triangles.indexType = (VkIndexType)1000265000,
         "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-indexType-03798",
         "infos[0].geometries[0].triangles.indexType");
    reset(&bed.bottom);
    structure_bed_refused(&bed, "NULL", bvhd_structure_sizes(&query, NULL, &bed.error), SIZES "pSizeInfo-parameter",
                          "ret_sizes");
    query.target = (enum bvhd_target)9;
    assert_int_equal(ask(), BVHD_UNSUPPORTED);
    structure_bed_stop(&bed);
}

/* Strides, handles, mode and addresses do not count, and no memory behind an address is read. */
static void only_shapes_count(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    for (int i = 0; i < 2; i++) {
        reset(i ? &bed.top : &bed.bottom);
        assert_int_equal(ask(), BVHD_OK);
        const uint64_t before = sizes.accelerationStructureSize;
        assert_true(before > 1000 && sizes.buildScratchSize == 0 && sizes.updateScratchSize == 0);
        info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        info.dstAccelerationStructure = info.srcAccelerationStructure = bvhd_structure_handle(bed.spare);
        if (!i) {
            geometry.geometry.triangles.vertexStride = 7;
            geometry.geometry.triangles.transformData.hostAddress = NULL;
        }
        query.build_type = VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR;
        assert_int_equal(ask(), BVHD_OK);
        assert_int_equal(sizes.accelerationStructureSize, before);
    }
    structure_bed_stop(&bed);
}

/* Target and quality decide, and no geometries at all are an empty structure. */
static void every_build_has_its_size(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    reset(&bed.bottom);
    assert_int_equal(ask(), BVHD_OK);
    const uint64_t any = sizes.accelerationStructureSize;
    query.quality = BVHD_QUALITY_BALANCED;
    assert_int_equal(ask(), BVHD_OK);
    assert_true(sizes.accelerationStructureSize < any);
    query.layout_flags = BVHD_PORTABLE_FAST_TRIANGLES;
    assert_int_equal(ask(), BVHD_OK);
    query.layout_flags = 0;
    query.target = BVHD_TARGET_LAVAPIPE;
    assert_int_equal(ask(), BVHD_OK);
    assert_in_range(sizes.accelerationStructureSize, 104 * 1000 - 56, 105 * 1000);
    query.target = BVHD_TARGET_PORTABLE;
    info.geometryCount = 0;
    query.max_primitive_counts = NULL;
    assert_int_equal(ask(), BVHD_OK);
    assert_int_equal(sizes.accelerationStructureSize, 128);
    structure_bed_stop(&bed);
}

/* Makes a right query about spheres or linear swept spheres, again without memory behind its addresses. */
static void reset_round(VkGeometryTypeKHR type)
{
    static char *const nowhere = (char *)16;
    reset(&bed.bottom);
    structure_bed_describe_round(&bed);
    bed.spheres.vertexData.hostAddress = bed.spheres.radiusData.hostAddress = nowhere;
    bed.spheres.indexData.hostAddress = nowhere;
    bed.swept.vertexData.hostAddress = bed.swept.radiusData.hostAddress = bed.swept.indexData.hostAddress = nowhere;
    geometry = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .pNext = type == VK_GEOMETRY_TYPE_SPHERES_NV ? (const void *)&bed.spheres : &bed.swept,
        .geometryType = type};
}

static void rules_of_spheres_are_named(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
#define SPHERES(change, rule, where)                                                                                   \
    STRUCTURE_RULE(&bed, reset_round(VK_GEOMETRY_TYPE_SPHERES_NV), change, ask(),                                      \
                   "VUID-VkAccelerationStructureGeometrySpheresDataNV-" rule, "infos[0].geometries[0]." where)
#define SWEPT(change, rule, where)                                                                                     \
    STRUCTURE_RULE(&bed, reset_round(VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV), change, ask(),                         \
                   "VUID-VkAccelerationStructureGeometryLinearSweptSpheresDataNV-" rule,                               \
                   "infos[0].geometries[0]." where)
    SPHERES(geometry.pNext = &bed.swept, "sType-sType", "pNext");
    SPHERES(bed.spheres.vertexFormat = VK_FORMAT_R8_UNORM, "vertexFormat-10434", "spheres.vertexFormat");
    SPHERES(bed.spheres.radiusFormat = VK_FORMAT_R8_UNORM, "radiusFormat-10435", "spheres.radiusFormat");
    SPHERES(bed.spheres.indexType = (VkIndexType)1000265000, "indexData-10437", "spheres.indexType");
    SWEPT(geometry.pNext = NULL, "sType-sType", "pNext");
    SWEPT(bed.swept.radiusFormat = VK_FORMAT_R8_UNORM, "radiusFormat-10424", "linearSweptSpheres.radiusFormat");
    SWEPT(bed.swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV, "indexingMode-10427",
          "linearSweptSpheres.indexingMode");
    structure_bed_stop(&bed);
}

/* What is built fits, however its arrays are described; the native target has no spheres. */
static void spheres_have_sizes(void **state)
{
    (void)state;
    static const VkGeometryTypeKHR types[] = {VK_GEOMETRY_TYPE_SPHERES_NV, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV};
    for (int i = 0; i < 2; i++) {
        structure_bed_start_with(&bed, types[i], 0, TARGET_PORTABLE);
        reset_round(types[i]);
        count = STRUCTURE_TRIANGLES;
        assert_int_equal(ask(), BVHD_OK);
        const uint64_t size = sizes.accelerationStructureSize;
        bed.spheres.indexType = bed.swept.indexType = VK_INDEX_TYPE_UINT16;
        bed.spheres.indexStride = bed.swept.indexStride = 7;
        bed.spheres.vertexStride = bed.swept.vertexStride = 7;
        bed.spheres.radiusStride = bed.swept.radiusStride = 7;
        bed.swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV;
        assert_int_equal(ask(), BVHD_OK);
        assert_int_equal(sizes.accelerationStructureSize, size);
        struct bvhd_structure *exact = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, size);
        assert_int_equal(
            bvhd_structure_hold(exact, &bed.bottom.info, &bed.bottom.range, &bed.bottom.result, &bed.error), BVHD_OK);
        bvhd_structure_destroy(exact);
        assert_in_range(size, bed.bottom.result.size - 64, 8 * bed.bottom.result.size);
        query.target = BVHD_TARGET_LAVAPIPE;
        assert_int_equal(ask(), BVHD_UNSUPPORTED);
        assert_string_equal(bed.error.where, "infos[0].geometries[0].geometryType");
        structure_bed_stop(&bed);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    reset(&bed.bottom);
    enum bvhd_status status = BVHD_NO_MEMORY;
    int failures = 0;
    for (; status != BVHD_OK; failures++) {
        atomic_store(&library_memory.fail_after, failures);
        status = ask();
        atomic_store(&library_memory.fail_after, -1);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
    }
    assert_true(failures > 4);
    structure_bed_stop(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_rule_is_named),      cmocka_unit_test(only_shapes_count),
        cmocka_unit_test(every_build_has_its_size), cmocka_unit_test(rules_of_spheres_are_named),
        cmocka_unit_test(spheres_have_sizes),       cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

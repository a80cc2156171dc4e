/* SPDX-License-Identifier: Apache-2.0 */
/* test_indirect.c - tests that ranges of indirect builds are read from memory: by strides, and each of their rules. */
#include "tests/support/unit.h"

#include "tests/support/client/structure_bed.h"

enum { INFOS = 3, GEOMETRIES = 3 };

/* Ranges in memory: a pair of numbers between them shows that strides are honoured. */
struct spaced {
    VkAccelerationStructureBuildRangeInfoKHR range;
    uint32_t gap[2];
};

static struct structure_bed bed;
static struct spaced spaced[GEOMETRIES];
static VkAccelerationStructureBuildRangeInfoKHR packed[GEOMETRIES];
static VkAccelerationStructureBuildGeometryInfoKHR infos[INFOS];
static const void *addresses[INFOS];
static uint32_t strides[INFOS];
static const uint32_t maxima[GEOMETRIES] = {10, 20, 30};
static const uint32_t *max_counts[INFOS];
static struct bvhd_indirect indirect;

/* Info 0 reads a range every 24 bytes, info 1 has no geometry, and info 2 reads one range for all geometries. */
static void reset(void)
{
    static const VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR};
    for (uint32_t i = 0; i < GEOMETRIES; i++) {
        packed[i] = (VkAccelerationStructureBuildRangeInfoKHR){maxima[i], 100 + i, 200 + i, 300 + i};
        spaced[i] = (struct spaced){packed[i], {77, 77}};
    }
    for (uint32_t i = 0; i < INFOS; i++)
        infos[i] = info;
    infos[0].geometryCount = infos[2].geometryCount = GEOMETRIES;
    addresses[0] = spaced;
    addresses[1] = NULL;
    addresses[2] = packed;
    strides[0] = sizeof *spaced;
    strides[1] = 8;
    strides[2] = 0;
    max_counts[0] = max_counts[2] = maxima;
    max_counts[1] = NULL;
    indirect = (struct bvhd_indirect){.struct_size = sizeof indirect,
                                      .info_count = INFOS,
                                      .infos = infos,
                                      .addresses = addresses,
                                      .strides = strides,
                                      .max_primitive_counts = max_counts};
}

static enum bvhd_status read_and_free(void)
{
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges = NULL;
    const enum bvhd_status status = bvhd_indirect_read(&indirect, &ranges, &bed.error);
    assert_int_equal(status == BVHD_OK, ranges != NULL);
    bvhd_indirect_free(ranges);
    return status;
}

static void ranges_are_read_by_strides(void **state)
{
    (void)state;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
    reset();
    assert_int_equal(bvhd_indirect_read(&indirect, &ranges, &bed.error), BVHD_OK);
    memset(spaced, 0, sizeof spaced); /* they are copies */
    assert_memory_equal(ranges[0], packed, sizeof packed);
    for (uint32_t i = 0; i < GEOMETRIES; i++)
        assert_memory_equal(&ranges[2][i], &packed[0], sizeof packed[0]);
    bvhd_indirect_free(ranges);
    reset();
    strides[2] = sizeof *packed;
    assert_int_equal(bvhd_indirect_read(&indirect, &ranges, &bed.error), BVHD_OK);
    assert_memory_equal(ranges[2], packed, sizeof packed);
    bvhd_indirect_free(ranges);
    indirect = (struct bvhd_indirect){.struct_size = sizeof indirect};
    assert_int_equal(read_and_free(), BVHD_OK);
    bvhd_indirect_free(NULL);
}

/* A build with the ranges that were read has the bytes of one whose ranges were given. */
static void builds_are_equal(void **state)
{
    (void)state;
    const struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges, given = bed.bottom.range;
    const void *const address = &given;
    const uint32_t stride = 4, most = STRUCTURE_TRIANGLES, *const counts = &most;
    indirect = (struct bvhd_indirect){.struct_size = sizeof indirect,
                                      .info_count = 1,
                                      .infos = &bed.bottom.info,
                                      .addresses = &address,
                                      .strides = &stride,
                                      .max_primitive_counts = &counts};
    assert_int_equal(bvhd_indirect_read(&indirect, &ranges, &bed.error), BVHD_OK);
    bed.bottom.range = ranges[0][0];
    bvhd_indirect_free(ranges);
    struct bvhd_result result = structure_bed_result(&bed.bottom, &options);
    assert_int_equal(result.size, bed.bottom.result.size);
    assert_memory_equal(result.data, bed.bottom.result.data, result.size);
    bvhd_blob_unref(result.blob);
    structure_bed_stop(&bed);
}

static void every_rule_is_named(void **state)
{
    (void)state;
#define INDIRECT "VUID-vkCmdBuildAccelerationStructuresIndirectKHR-"
#define RULE(change, rule, where) STRUCTURE_RULE(&bed, reset(), change, read_and_free(), rule, where)
    RULE(indirect.struct_size--, "", "indirect.struct_size");
    RULE(indirect.infos = NULL, INDIRECT "pInfos-parameter", "indirect.infos");
    RULE(indirect.addresses = NULL, INDIRECT "pIndirectDeviceAddresses-parameter", "indirect.addresses");
    RULE(addresses[2] = NULL, INDIRECT "pIndirectDeviceAddresses-parameter", "indirect.addresses[2]");
    RULE(indirect.strides = NULL, INDIRECT "pIndirectStrides-parameter", "indirect.strides");
    RULE(indirect.max_primitive_counts = NULL, INDIRECT "ppMaxPrimitiveCounts-parameter",
         "indirect.max_primitive_counts");
    RULE(max_counts[0] = NULL, INDIRECT "ppMaxPrimitiveCounts-parameter", "indirect.max_primitive_counts[0]");
    RULE(addresses[0] = (char *)spaced + 2, INDIRECT "pIndirectDeviceAddresses-03648", "indirect.addresses[0]");
    RULE(addresses[1] = (char *)spaced + 1, INDIRECT "pIndirectDeviceAddresses-03648", "indirect.addresses[1]");
    RULE(strides[0] = 26, INDIRECT "pIndirectStrides-03787", "indirect.strides[0]");
    RULE(strides[2] = 1, INDIRECT "pIndirectStrides-03787", "indirect.strides[2]");
    RULE(spaced[1].range.primitiveCount++, INDIRECT "ppMaxPrimitiveCounts-03653",
         "indirect.max_primitive_counts[0][1]");
    RULE(packed[0].primitiveCount++, INDIRECT "ppMaxPrimitiveCounts-03653", "indirect.max_primitive_counts[2][0]");
    RULE(infos[0].geometryCount = 0x7fffffff, "VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03793",
         "infos[0].geometryCount");
#undef RULE
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    reset();
    atomic_store(&library_memory.fail_after, 0);
    const enum bvhd_status status = read_and_free();
    atomic_store(&library_memory.fail_after, -1);
    assert_int_equal(status, BVHD_NO_MEMORY);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranges_are_read_by_strides),
        cmocka_unit_test(builds_are_equal),
        cmocka_unit_test(every_rule_is_named),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_structure_query.c - tests the four properties and the compatibility of structures, and each of their rules. */
#include "tests/support/unit.h"

#include "tests/support/client/structure_bed.h"

enum { COMPACTED = 1000150000, SERIALIZATION = 1000150001, POINTERS = 1000386000, SIZE = 1000386001 };

static struct structure_bed bed;

static VkDeviceSize ask(uint32_t type, const struct bvhd_structure *structure)
{
    VkDeviceSize values[2] = {1, 1};
    const VkAccelerationStructureKHR handle = bvhd_structure_handle(structure);
    const struct bvhd_structure_properties query = {.struct_size = sizeof query,
                                                    .structure_count = 1,
                                                    .query_type = (VkQueryType)type,
                                                    .structures = &handle,
                                                    .data_size = sizeof values[0],
                                                    .data = values,
                                                    .stride = 8};
    if (bvhd_structure_query(&query, &bed.error) != BVHD_OK)
        fail_msg("%s: %s", bed.error.where, bed.error.text);
    assert_int_equal(values[1], 1);
    return values[0];
}

/* The numbers are those of the bytes; several are written a stride apart, and nothing between them. */
static void properties_are_those_of_the_bytes(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    const unsigned char *bytes = bed.top.result.data;
    assert_int_equal(ask(SERIALIZATION, bed.holds_top), bed.top.result.size);
    assert_int_equal(ask(SIZE, bed.holds_top), bytes_get64(bytes + 40));
    assert_int_equal(ask(COMPACTED, bed.holds_top), bytes_get64(bytes + 40));
    assert_int_equal(ask(POINTERS, bed.holds_top), 1);
    assert_true(ask(COMPACTED, bed.holds_bottom) < STRUCTURE_ROOM / 8);
    const VkAccelerationStructureKHR handles[] = {bvhd_structure_handle(bed.holds_bottom),
                                                  bvhd_structure_handle(bed.holds_top)};
    VkDeviceSize values[6] = {7, 7, 7, 7, 7, 7};
    const struct bvhd_structure_properties query = {.struct_size = sizeof query,
                                                    .structure_count = 2,
                                                    .query_type = (VkQueryType)SERIALIZATION,
                                                    .structures = handles,
                                                    .data_size = sizeof values,
                                                    .data = values,
                                                    .stride = 24};
    assert_int_equal(bvhd_structure_query(&query, &bed.error), BVHD_OK);
    const VkDeviceSize wanted[6] = {bed.bottom.result.size, 7, 7, bed.top.result.size, 7, 7};
    assert_memory_equal(values, wanted, sizeof wanted);
    structure_bed_stop(&bed);
}

static void every_rule_is_named(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    VkAccelerationStructureKHR handles[2];
    VkDeviceSize values[4];
    struct bvhd_structure_properties query;
    VkCopyAccelerationStructureInfoKHR compact = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                  .src = bvhd_structure_handle(bed.holds_top),
                                                  .dst = bvhd_structure_handle(bed.spare),
                                                  .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR};
#define WRITE "VUID-vkWriteAccelerationStructuresPropertiesKHR-"
#define RIGHT                                                                                                          \
    handles[0] = handles[1] = bvhd_structure_handle(bed.holds_top);                                                    \
    query = (struct bvhd_structure_properties){.struct_size = sizeof query,                                            \
                                               .structure_count = 2,                                                   \
                                               .query_type = (VkQueryType)COMPACTED,                                   \
                                               .structures = handles,                                                  \
                                               .data_size = sizeof values,                                             \
                                               .data = values,                                                         \
                                               .stride = 16}
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, RIGHT, change, bvhd_structure_query(&query, &bed.error), rule, where)
    RULE(query.struct_size--, "", "properties.struct_size");
    RULE(query.structure_count = 0, WRITE "accelerationStructureCount-arraylength", "properties.structure_count");
    RULE(query.structures = NULL, WRITE "pAccelerationStructures-parameter", "properties.structures");
    RULE(handles[1] = VK_NULL_HANDLE, WRITE "pAccelerationStructures-parameter", "structures[1]");
    RULE(query.data_size = 0, WRITE "dataSize-arraylength", "properties.data_size");
    RULE(query.data = NULL, WRITE "pData-parameter", "properties.data");
    RULE(query.query_type = (VkQueryType)77, WRITE "queryType-parameter", "properties.query_type");
    RULE(query.query_type = VK_QUERY_TYPE_OCCLUSION, WRITE "queryType-06742", "properties.query_type");
    RULE(query.query_type = (VkQueryType)1000165000, WRITE "queryType-06742", "properties.query_type");
    RULE(query.stride = 12, WRITE "queryType-03448", "properties.stride");
    RULE(query.stride = 12;
         query.query_type = (VkQueryType)SERIALIZATION, WRITE "queryType-03450", "properties.stride");
    RULE(query.stride = 4; query.query_type = (VkQueryType)SIZE, WRITE "queryType-06731", "properties.stride");
    RULE(query.stride = 9; query.query_type = (VkQueryType)POINTERS, WRITE "queryType-06733", "properties.stride");
    RULE(query.data_size--, WRITE "dataSize-03452", "properties.data_size");
    RULE(query.stride = SIZE_MAX - 7, WRITE "dataSize-03452", "properties.data_size");
    RULE(query.stride = 0; query.data_size = 7, WRITE "dataSize-03452", "properties.data_size");
    RULE(handles[1] = bvhd_structure_handle(bed.small), WRITE "pAccelerationStructures-04964", "structures[1]");
    RULE(query.query_type = (VkQueryType)POINTERS;
         handles[1] = bvhd_structure_handle(bed.holds_bottom), WRITE "pAccelerationStructures-12425", "structures[1]");
    RULE(assert_int_equal(bvhd_structure_copy(&compact, NULL), BVHD_OK);
         handles[0] = compact.dst, WRITE "accelerationStructures-03431", "structures[0]");
#undef RULE
    structure_bed_stop(&bed);
}

static VkAccelerationStructureCompatibilityKHR compatible(const void *data, const struct bvhd_format *format)
{
    const VkAccelerationStructureVersionInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR, .pVersionData = data};
    VkAccelerationStructureCompatibilityKHR answer = (VkAccelerationStructureCompatibilityKHR)9;
    assert_int_equal(bvhd_structure_compatibility(&info, format, &answer, &bed.error), BVHD_OK);
    return answer;
}

/* Portable structures of known versions are compatible; native ones, if their format is the one that is given. */
static void compatibility_is_decided_by_both_names(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    unsigned char names[2 * VK_UUID_SIZE];
    struct bvhd_format format = {.struct_size = sizeof format, .driver_uuid = {1}, .compatibility_uuid = {2}};
    memcpy(names, bed.top.result.data, sizeof names);
    assert_int_equal(compatible(names, NULL), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR);
    assert_int_equal(compatible(names, &format), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR);
    for (unsigned i = 0; i < 2 * VK_UUID_SIZE; i++) {
        names[i] ^= 1;
        assert_int_equal(compatible(names, &format), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR);
        names[i] ^= 1;
    }
    for (unsigned version = 0; version < 256; version++) {
        names[31] = (unsigned char)version;
        assert_int_equal(compatible(names, NULL), version >= 1 && version <= 3
                                                      ? VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR
                                                      : VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR);
    }
    memcpy(names, format.driver_uuid, VK_UUID_SIZE);
    memcpy(names + VK_UUID_SIZE, format.compatibility_uuid, VK_UUID_SIZE);
    assert_int_equal(compatible(names, &format), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR);
    assert_int_equal(compatible(names, NULL), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR);
    names[31]++;
    assert_int_equal(compatible(names, &format), VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR);
    structure_bed_stop(&bed);
}

static void every_rule_of_compatibility_is_named(void **state)
{
    (void)state;
    static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    static const uint8_t names[2 * VK_UUID_SIZE];
    VkAccelerationStructureVersionInfoKHR info;
    VkAccelerationStructureCompatibilityKHR answer;
#define VERSION "VUID-VkAccelerationStructureVersionInfoKHR-"
#define COMPATIBILITY "VUID-vkGetDeviceAccelerationStructureCompatibilityKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed,                                                                                               \
                   info = ((VkAccelerationStructureVersionInfoKHR){                                                    \
                       .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR, .pVersionData = names}),    \
                   change, bvhd_structure_compatibility(&info, NULL, &answer, &bed.error), rule, where)
    RULE(info.sType = 0, VERSION "sType-sType", "info.sType");
    RULE(info.pNext = &stray, VERSION "pNext-pNext", "info.pNext");
    RULE(info.pVersionData = NULL, VERSION "pVersionData-parameter", "info.pVersionData");
#undef RULE
    structure_bed_refused(&bed, "NULL", bvhd_structure_compatibility(NULL, NULL, &answer, &bed.error),
                          COMPATIBILITY "pVersionInfo-parameter", "info");
    structure_bed_refused(&bed, "NULL", bvhd_structure_compatibility(&info, NULL, NULL, &bed.error),
                          COMPATIBILITY "pCompatibility-parameter", "ret_compatibility");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(properties_are_those_of_the_bytes),
        cmocka_unit_test(every_rule_is_named),
        cmocka_unit_test(compatibility_is_decided_by_both_names),
        cmocka_unit_test(every_rule_of_compatibility_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

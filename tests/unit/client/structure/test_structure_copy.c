/* SPDX-License-Identifier: Apache-2.0 */
/* test_structure_copy.c - tests clones, compaction and serialization: their bytes, and each of their rules. */
#include "tests/support/unit.h"

#include "tests/support/client/structure_bed.h"
#include "tests/support/random.h"

static struct structure_bed bed;
static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};

static VkCopyAccelerationStructureInfoKHR copy_info(const struct bvhd_structure *from, const struct bvhd_structure *to,
                                                    VkCopyAccelerationStructureModeKHR mode)
{
    return (VkCopyAccelerationStructureInfoKHR){.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                .src = bvhd_structure_handle(from),
                                                .dst = bvhd_structure_handle(to),
                                                .mode = mode};
}

static struct bvhd_structure_state state_of(const struct bvhd_structure *structure)
{
    struct bvhd_structure_state state;
    assert_int_equal(bvhd_structure_get(structure, &state), BVHD_OK);
    return state;
}

static void copy(const struct bvhd_structure *from, struct bvhd_structure *to, VkCopyAccelerationStructureModeKHR mode)
{
    const VkCopyAccelerationStructureInfoKHR info = copy_info(from, to, mode);
    if (bvhd_structure_copy(&info, &bed.error) != BVHD_OK)
        fail_msg("%s: %s", bed.error.where, bed.error.text);
}

/* A clone has the same bytes and flags, and lives on without its source. */
static void clones_are_equal(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        structure_bed_start(&bed, BUILD_ALLOW_UPDATE, (enum target)target);
        copy(bed.holds_top, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
        bvhd_structure_destroy(bed.holds_top);
        bed.holds_top = NULL;
        const struct bvhd_structure_state clone = state_of(bed.spare);
        assert_int_equal(clone.type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
        assert_int_equal(clone.flags, BUILD_ALLOW_UPDATE);
        assert_int_equal(clone.target, target);
        assert_int_equal(clone.data_size, bed.top.result.size);
        assert_memory_equal(clone.data, bed.top.result.data, clone.data_size);
        structure_bed_stop(&bed);
    }
}

/* What ALLOW_COMPACTION adds, COMPACT takes away: byte for byte, the structure is the one built without the flag. */
static void compacted_bytes_are_those_without_the_flag(void **state)
{
    (void)state;
    static const uint32_t others[] = {0, BUILD_ALLOW_UPDATE, BUILD_PREFER_FAST_TRACE | BUILD_LOW_MEMORY};
    static const struct {
        enum target target;
        VkGeometryTypeKHR type;
    } kinds[] = {{TARGET_PORTABLE, VK_GEOMETRY_TYPE_TRIANGLES_KHR},
                 {TARGET_LAVAPIPE, VK_GEOMETRY_TYPE_TRIANGLES_KHR},
                 {TARGET_PORTABLE, VK_GEOMETRY_TYPE_SPHERES_NV},
                 {TARGET_PORTABLE, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV}};
    for (int i = 0; i < 12; i++) {
        const enum target target = kinds[i / 3].target;
        const struct build_options options = {
            .quality = QUALITY_BALANCED, .target = target, .device.variant = target == TARGET_LAVAPIPE};
        structure_bed_start_with(&bed, kinds[i / 3].type, others[i % 3] | BUILD_ALLOW_COMPACTION, target);
        copy(bed.holds_bottom, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
        bed.bottom.info.flags = others[i % 3];
        struct bvhd_result plain = structure_bed_result(&bed.bottom, &options);
        const struct bvhd_structure_state compacted = state_of(bed.spare);
        assert_int_equal(compacted.flags, others[i % 3]);
        assert_int_equal(compacted.data_size, plain.size);
        assert_memory_equal(compacted.data, plain.data, plain.size);
        bvhd_blob_unref(plain.blob);
        copy(bed.holds_top, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
        assert_int_equal(state_of(bed.spare).type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
        structure_bed_stop(&bed);
    }
}

static void every_rule_of_copies_is_named(void **state)
{
    (void)state;
    VkCopyAccelerationStructureInfoKHR info;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    struct bvhd_structure *bottom_only =
        structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, STRUCTURE_ROOM);
#define COPY "VUID-VkCopyAccelerationStructureInfoKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, info = copy_info(bed.holds_bottom, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR), \
                   change, bvhd_structure_copy(&info, &bed.error), rule, where)
    RULE(info.sType = 0, COPY "sType-sType", "info.sType");
    RULE(info.pNext = &stray, COPY "pNext-pNext", "info.pNext");
    RULE(info.src = VK_NULL_HANDLE, COPY "src-parameter", "info.src");
    RULE(info.dst = VK_NULL_HANDLE, COPY "dst-parameter", "info.dst");
    RULE(info.mode = (VkCopyAccelerationStructureModeKHR)4, COPY "mode-parameter", "info.mode");
    RULE(info.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR, COPY "mode-03410", "info.mode");
    RULE(info.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR, COPY "mode-03410", "info.mode");
    RULE(info.dst = info.src, COPY "dst-07791", "info.dst");
    RULE(info.src = bvhd_structure_handle(bottom_only), COPY "src-04963", "info.src");
    RULE(info.dst = bvhd_structure_handle(bed.small), COPY "mode-12418", "info.dst");
    RULE(info.dst = bvhd_structure_handle(bed.small);
         info.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR, COPY "mode-12419", "info.dst");
    RULE(info.src = bvhd_structure_handle(bed.holds_top);
         info.dst = bvhd_structure_handle(bottom_only), "", "info.dst");
    RULE(copy(bed.holds_bottom, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
         info = copy_info(bed.spare, bottom_only, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR), COPY "src-03411",
         "info.src");
#undef RULE
    structure_bed_refused(&bed, "NULL", bvhd_structure_copy(NULL, &bed.error),
                          "VUID-vkCopyAccelerationStructureKHR-pInfo-parameter", "info");
    bvhd_structure_destroy(bottom_only);
    structure_bed_stop(&bed);
}

/* A destination that is exactly as large as the property says is enough, and with one byte less it is not. */
static void sizes_are_exact(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    const VkAccelerationStructureKHR handle = bvhd_structure_handle(bed.holds_bottom);
    VkDeviceSize size = 0;
    struct bvhd_structure_properties query = {.struct_size = sizeof query,
                                              .structure_count = 1,
                                              .structures = &handle,
                                              .query_type = (VkQueryType)1000150000,
                                              .data_size = sizeof size,
                                              .data = &size,
                                              .stride = sizeof size};
    assert_int_equal(bvhd_structure_query(&query, NULL), BVHD_OK);
    for (int less = 0; less < 2; less++) {
        struct bvhd_structure *exact =
            structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, size - (uint64_t)less);
        const VkCopyAccelerationStructureInfoKHR info =
            copy_info(bed.holds_bottom, exact, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
        assert_int_equal(bvhd_structure_copy(&info, NULL), less ? BVHD_INVALID : BVHD_OK);
        assert_int_equal(state_of(exact).is_built, !less);
        bvhd_structure_destroy(exact);
    }
    structure_bed_stop(&bed);
}

/* ---- serialization ---- */

static VkCopyAccelerationStructureToMemoryInfoKHR to_memory(const struct bvhd_structure *from)
{
    return (VkCopyAccelerationStructureToMemoryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
        .src = bvhd_structure_handle(from),
        .dst.hostAddress = bed.room,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
}

static VkCopyMemoryToAccelerationStructureInfoKHR from_memory(const struct bvhd_structure *to)
{
    return (VkCopyMemoryToAccelerationStructureInfoKHR){
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.hostAddress = bed.room,
        .dst = bvhd_structure_handle(to),
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
}

static void serialize(const struct bvhd_structure *from)
{
    const VkCopyAccelerationStructureToMemoryInfoKHR info = to_memory(from);
    assert_int_equal(bvhd_structure_serialize(&info, STRUCTURE_ROOM, NULL), BVHD_OK);
}

static void every_rule_of_serialization_is_named(void **state)
{
    (void)state;
    VkCopyAccelerationStructureToMemoryInfoKHR info;
    uint64_t size;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
#define TO "VUID-VkCopyAccelerationStructureToMemoryInfoKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, info = to_memory(bed.holds_top);                                                              \
                   size = bed.top.result.size, change, bvhd_structure_serialize(&info, size, &bed.error), rule, where)
    RULE(info.sType = 0, TO "sType-sType", "info.sType");
    RULE(info.pNext = &stray, TO "pNext-pNext", "info.pNext");
    RULE(info.src = VK_NULL_HANDLE, TO "src-parameter", "info.src");
    RULE(info.src = bvhd_structure_handle(bed.spare), TO "src-04959", "info.src");
    RULE(info.mode = (VkCopyAccelerationStructureModeKHR)77, TO "mode-parameter", "info.mode");
    RULE(info.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR, TO "mode-03412", "info.mode");
    RULE(size--, TO "dst-03561", "info.dst");
    RULE(info.dst.hostAddress = NULL, "VUID-vkCopyAccelerationStructureToMemoryKHR-pInfo-03732", "info.dst");
    RULE(info.dst.hostAddress = bed.room + 8, "VUID-vkCopyAccelerationStructureToMemoryKHR-pInfo-03751", "info.dst");
#undef RULE
    structure_bed_refused(&bed, "NULL", bvhd_structure_serialize(NULL, 0, &bed.error),
                          "VUID-vkCopyAccelerationStructureToMemoryKHR-pInfo-parameter", "info");
    structure_bed_stop(&bed);
}

static void every_rule_of_deserialization_is_named(void **state)
{
    (void)state;
    VkCopyMemoryToAccelerationStructureInfoKHR info;
    uint64_t size;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
#define FROM "VUID-VkCopyMemoryToAccelerationStructureInfoKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, serialize(bed.holds_top); info = from_memory(bed.spare);                                      \
                   size = bed.top.result.size, change, bvhd_structure_deserialize(&info, size, NULL, &bed.error),      \
                   rule, where)
    RULE(info.sType = 0, FROM "sType-sType", "info.sType");
    RULE(info.pNext = &stray, FROM "pNext-pNext", "info.pNext");
    RULE(info.dst = VK_NULL_HANDLE, FROM "dst-parameter", "info.dst");
    RULE(info.mode = (VkCopyAccelerationStructureModeKHR)-1, FROM "mode-parameter", "info.mode");
    RULE(info.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR, FROM "mode-03413", "info.mode");
    RULE(bed.room[31] = 9, FROM "pInfo-03414", "info.src");
    RULE(bed.room[0]++, FROM "pInfo-03414", "info.src");
    RULE(info.dst = bvhd_structure_handle(bed.small), FROM "dst-03746", "info.dst");
    RULE(size--, FROM "src-04960", "info.src");
    RULE(size = 55, FROM "src-04960", "info.src");
    RULE(bed.room[40]++, FROM "src-04960", "info.src");
    RULE(bed.room[64]++, FROM "src-04960", "info.src");
    RULE(info.src.hostAddress = NULL, "VUID-vkCopyMemoryToAccelerationStructureKHR-pInfo-03729", "info.src");
    RULE(info.src.hostAddress = bed.room + 8, "VUID-vkCopyMemoryToAccelerationStructureKHR-pInfo-03750", "info.src");
    RULE(info.dst = bvhd_structure_handle(bed.holds_bottom), "", "info.dst");
#undef RULE
    structure_bed_refused(&bed, "NULL", bvhd_structure_deserialize(NULL, 0, NULL, &bed.error),
                          "VUID-vkCopyMemoryToAccelerationStructureKHR-pInfo-parameter", "info");
    structure_bed_stop(&bed);
}

/* What was serialized and deserialized is the same, and bytes behind it are not read. A native one needs its format. */
static void serialized_structures_come_back(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        const struct bvhd_format format = {.struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = 1};
        structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, (enum target)target);
        serialize(bed.holds_top);
        const VkCopyMemoryToAccelerationStructureInfoKHR info = from_memory(bed.spare);
        assert_int_equal(bvhd_structure_deserialize(&info, STRUCTURE_ROOM, NULL, &bed.error),
                         target == TARGET_PORTABLE ? BVHD_OK : BVHD_INVALID);
        assert_int_equal(bvhd_structure_deserialize(&info, STRUCTURE_ROOM, &format, &bed.error), BVHD_OK);
        const struct bvhd_structure_state back = state_of(bed.spare);
        assert_int_equal(back.type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
        assert_int_equal(back.flags, target == TARGET_PORTABLE ? BUILD_ALLOW_COMPACTION : 0);
        assert_int_equal(back.target, target);
        assert_int_equal(back.data_size, bed.top.result.size);
        assert_memory_equal(back.data, bed.top.result.data, back.data_size);
        structure_bed_stop(&bed);
    }
}

static void change_bytes(VkGeometryTypeKHR type)
{
    struct random random = {5};
    uint32_t refused = 0, rounds = 4000;
    structure_bed_start_with(&bed, type, 0, TARGET_PORTABLE);
    for (uint32_t i = 0; i < rounds; i++) {
        serialize(i % 2 ? bed.holds_top : bed.holds_bottom);
        const uint64_t size = i % 2 ? bed.top.result.size : bed.bottom.result.size;
        bed.room[random_next(&random) % size] ^= (unsigned char)(1 + random_next(&random) % 255);
        const VkCopyMemoryToAccelerationStructureInfoKHR info = from_memory(bed.spare);
        const struct bvhd_structure_state before = state_of(bed.spare);
        enum bvhd_status status =
            bvhd_structure_deserialize(&info, random_next(&random) % 64 ? size : size / 2, NULL, &bed.error);
        if (status == BVHD_OK)
            continue;
        const struct bvhd_structure_state after = state_of(bed.spare);
        /* Vulkan has no rule about bytes that say MOTION, and an object without. */
        assert_true(status == BVHD_INVALID &&
                    (bed.error.vuid != BVHD_VUID_NONE || strcmp(bed.error.where, "info.dst") == 0));
        assert_ptr_equal(after.data, before.data);
        refused++;
    }
    assert_in_range(refused, rounds / 10, rounds - rounds / 10);
    structure_bed_stop(&bed);
}

/* Changed bytes are refused by a rule, or give a structure that is sound; what the object held stays if they are. */
static void changed_bytes_do_no_harm(void **state)
{
    (void)state;
    static const VkGeometryTypeKHR types[] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_GEOMETRY_TYPE_SPHERES_NV,
                                              VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV};
    for (int i = 0; i < 3; i++)
        change_bytes(types[i]);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    serialize(bed.holds_top);
    const VkCopyMemoryToAccelerationStructureInfoKHR from = from_memory(bed.spare);
    const VkCopyAccelerationStructureInfoKHR compact =
        copy_info(bed.holds_bottom, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    for (int call = 0; call < 2; call++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = 0;
        for (; status != BVHD_OK; failures++) {
            atomic_store(&library_memory.fail_after, failures);
            status = call ? bvhd_structure_copy(&compact, &bed.error)
                          : bvhd_structure_deserialize(&from, STRUCTURE_ROOM, NULL, &bed.error);
            atomic_store(&library_memory.fail_after, -1);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        }
        assert_true(failures > 2);
    }
    structure_bed_stop(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(clones_are_equal),
        cmocka_unit_test(compacted_bytes_are_those_without_the_flag),
        cmocka_unit_test(every_rule_of_copies_is_named),
        cmocka_unit_test(sizes_are_exact),
        cmocka_unit_test(every_rule_of_serialization_is_named),
        cmocka_unit_test(every_rule_of_deserialization_is_named),
        cmocka_unit_test(serialized_structures_come_back),
        cmocka_unit_test(changed_bytes_do_no_harm),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_structure.c - tests creation and what objects hold: each rule by a wrong call, and what a right one gives. */
#include "tests/support/unit.h"

#include "tests/support/client/structure_bed.h"

static struct structure_bed bed;

static enum bvhd_status create(const VkAccelerationStructureCreateInfoKHR *info)
{
    struct bvhd_structure *structure = NULL;
    enum bvhd_status status = bvhd_structure_create(info, &structure, &bed.error);
    assert_int_equal(status == BVHD_OK, structure != NULL);
    bvhd_structure_destroy(structure);
    return status;
}

static void every_rule_of_creation_is_named(void **state)
{
    (void)state;
    static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    VkAccelerationStructureMotionInfoNV motion = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_MOTION_INFO_NV},
                                        second = motion;
    VkBaseInStructure capture = {.sType = (VkStructureType)1000316005};
    VkAccelerationStructureCreateInfoKHR info;
#define CREATE "VUID-VkAccelerationStructureCreateInfoKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, info = structure_bed_create_info(VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, 1000);         \
                   info.offset = 512; motion.pNext = NULL; motion.flags = 0;                                           \
                   info.pNext = &motion, change, create(&info), rule, where)
    RULE(info.sType = 0, CREATE "sType-sType", "info.sType");
    RULE(info.pNext = &stray, CREATE "pNext-pNext", "info.pNext");
    RULE(motion.pNext = &second, CREATE "sType-unique", "info.pNext");
    RULE(info.pNext = &capture, CREATE "pNext-08109", "info.pNext");
    RULE(info.createFlags = 2, CREATE "createFlags-parameter", "info.createFlags");
    RULE(info.createFlags = 0x80000000, CREATE "createFlags-parameter", "info.createFlags");
    RULE(info.type = (VkAccelerationStructureTypeKHR)3, CREATE "type-parameter", "info.type");
    RULE(info.type = (VkAccelerationStructureTypeKHR)1000623000, CREATE "type-11600", "info.type");
    RULE(info.deviceAddress = 256, CREATE "deviceAddress-03612", "info.deviceAddress");
    RULE(info.createFlags = 1; info.deviceAddress = 256, CREATE "createFlags-03613", "info.createFlags");
    RULE(info.createFlags = 8; info.pNext = &capture, CREATE "createFlags-08108", "info.createFlags");
    RULE(info.createFlags = 4; info.pNext = NULL, CREATE "flags-04954", "info.pNext");
    RULE(motion.flags = 1, "VUID-VkAccelerationStructureMotionInfoNV-flags-zerobitmask", "info.pNext.flags");
    RULE(info.offset = 128, CREATE "offset-03734", "info.offset");
#undef RULE
    info.offset = 0;
    info.createFlags = 4;
    info.pNext = &motion;
    assert_int_equal(create(&info), BVHD_OK);
    info.pNext = NULL;
    info.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR; /* which needs no such struct */
    assert_int_equal(create(&info), BVHD_OK);
    info.type = VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR;
    assert_int_equal(create(&info), BVHD_OK);
    structure_bed_refused(&bed, "NULL", create(NULL), "VUID-vkCreateAccelerationStructureKHR-pCreateInfo-parameter",
                          "info");
    structure_bed_refused(&bed, "NULL", bvhd_structure_create(&info, NULL, &bed.error),
                          "VUID-vkCreateAccelerationStructureKHR-pAccelerationStructure-parameter", "ret_structure");
}

/* An object that is new is empty; its handle stands for it alone. */
static void new_objects_are_empty(void **state)
{
    (void)state;
    struct bvhd_structure *first = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, 0),
                          *second = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, UINT64_MAX);
    struct bvhd_structure_state is;
    assert_int_equal(bvhd_structure_get(second, &is), BVHD_OK);
    assert_int_equal(is.created_type, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
    assert_true(is.created_size == UINT64_MAX);
    assert_true(!is.is_built && !is.data && is.data_size == 0 && is.flags == 0);
    assert_true(bvhd_structure_handle(first) != bvhd_structure_handle(second));
    assert_true(bvhd_structure_handle(NULL) == VK_NULL_HANDLE);
    bvhd_structure_destroy(first);
    bvhd_structure_destroy(second);
    bvhd_structure_destroy(NULL);
}

/* The size that the query gives is enough, and one byte less is not. */
static void results_are_held_by_their_rules(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION, TARGET_PORTABLE);
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    const uint32_t count = STRUCTURE_TRIANGLES;
    const struct bvhd_structure_sizes_query query = {.struct_size = sizeof query,
                                                     .info = &bed.bottom.info,
                                                     .max_primitive_counts = &count,
                                                     .quality = BVHD_QUALITY_BALANCED};
    assert_int_equal(bvhd_structure_sizes(&query, &sizes, &bed.error), BVHD_OK);
    struct bvhd_structure *exact = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                                        sizes.accelerationStructureSize),
                          *less = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                                       sizes.accelerationStructureSize - 1),
                          *into;
    struct structure_build *build;
    struct bvhd_result result;
    VkAccelerationStructureBuildGeometryInfoKHR info;
#define CALL "VUID-vkBuildAccelerationStructuresKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, into = exact; build = &bed.bottom; info = build->info;                                        \
                   result = build->result, change,                                                                     \
                   bvhd_structure_hold(into, &info, &build->range, &result, &bed.error), rule, where)
    RULE(into = less, CALL "pInfos-10126", "info.dstAccelerationStructure");
    RULE(into = bed.holds_top, CALL "pInfos-03700", "info.dstAccelerationStructure");
    RULE(build = &bed.top; info = build->info;
         result = build->result, CALL "pInfos-03699", "info.dstAccelerationStructure");
    RULE(result = bed.top.result, "", "result");
    RULE(info.flags = 0, "", "result");
    RULE(result.blob = NULL, "", "result");
#undef RULE
    struct bvhd_structure_state is;
    assert_int_equal(bvhd_structure_get(exact, &is), BVHD_OK);
    assert_true(is.is_built && is.flags == BUILD_ALLOW_COMPACTION && is.target == BVHD_TARGET_PORTABLE);
    assert_int_equal(is.type, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
    assert_ptr_equal(is.data, bed.bottom.result.data);
    /* A GENERIC object holds either type, one after the other. */
    assert_int_equal(
        bvhd_structure_hold(bed.spare, &bed.bottom.info, &bed.bottom.range, &bed.bottom.result, &bed.error), BVHD_OK);
    assert_int_equal(bvhd_structure_hold(bed.spare, &bed.top.info, &bed.top.range, &bed.top.result, &bed.error),
                     BVHD_OK);
    bvhd_structure_destroy(exact);
    bvhd_structure_destroy(less);
    structure_bed_stop(&bed);
}

static struct bvhd_structure *create_moving(VkAccelerationStructureTypeKHR type, uint32_t max_instances, uint64_t size)
{
    const VkAccelerationStructureMotionInfoNV motion = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_MOTION_INFO_NV, .maxInstances = max_instances};
    VkAccelerationStructureCreateInfoKHR info = structure_bed_create_info(type, size);
    struct bvhd_structure *structure = NULL;
    info.createFlags = VK_ACCELERATION_STRUCTURE_CREATE_MOTION_BIT_NV;
    info.pNext = &motion;
    assert_int_equal(bvhd_structure_create(&info, &structure, NULL), BVHD_OK);
    return structure;
}

/* Objects with motion hold what moves, and others what does not. */
static void motion_is_held_by_its_rules(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    struct bvhd_structure *bottom = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0, UINT64_MAX),
                          *top = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, STRUCTURE_INSTANCES - 1,
                                               UINT64_MAX),
                          *into;
    VkAccelerationStructureBuildGeometryInfoKHR info;
#define BUILD "VUID-VkAccelerationStructureBuildGeometryInfoKHR-"
#define RULE(change, rule, where)                                                                                      \
    STRUCTURE_RULE(&bed, into = bed.holds_bottom;                                                                      \
                   info = bed.bottom.info, change,                                                                     \
                   bvhd_structure_hold(into, &info, &bed.bottom.range, &bed.bottom.result, &bed.error), rule, where)
    RULE(into = bottom, BUILD "dstAccelerationStructure-04927", "info.flags");
    RULE(info.flags |= VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV, BUILD "flags-04928",
         "info.dstAccelerationStructure");
#undef RULE
    info = bed.top.info;
    info.flags |= VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV;
    structure_bed_refused(&bed, "an instance too many",
                          bvhd_structure_hold(top, &info, &bed.top.range, &bed.top.result, &bed.error), "",
                          "info.dstAccelerationStructure");
    VkCopyAccelerationStructureInfoKHR copy = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = bvhd_structure_handle(bed.holds_bottom),
                                               .dst = bvhd_structure_handle(bottom),
                                               .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR};
    structure_bed_refused(&bed, "a copy", bvhd_structure_copy(&copy, &bed.error), "", "info.dst");
    bvhd_structure_destroy(bottom);
    bvhd_structure_destroy(top);
    structure_bed_stop(&bed);
}

/* Motion triangles need the size that the query gives; they are copied into what was created for them alone. */
static void moving_results_are_held(void **state)
{
    (void)state;
    const struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    const uint32_t count = STRUCTURE_TRIANGLES;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    const VkAccelerationStructureGeometryMotionTrianglesDataNV end = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
        .vertexData.hostAddress = bed.vertices};
    struct structure_build moving = bed.bottom;
    moving.geometry.geometry.triangles.pNext = &end;
    moving.info.pGeometries = &moving.geometry;
    moving.info.flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV | BUILD_ALLOW_DATA_ACCESS;
    moving.result = structure_bed_result(&moving, &options);
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    const struct bvhd_structure_sizes_query query = {.struct_size = sizeof query,
                                                     .info = &moving.info,
                                                     .max_primitive_counts = &count,
                                                     .quality = BVHD_QUALITY_BALANCED};
    assert_int_equal(bvhd_structure_sizes(&query, &sizes, &bed.error), BVHD_OK);
    struct bvhd_structure *objects[2];
    for (int i = 0; i < 2; i++)
        objects[i] = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0, sizes.accelerationStructureSize);
    assert_int_equal(bvhd_structure_hold(objects[0], &moving.info, &moving.range, &moving.result, &bed.error), BVHD_OK);
    struct bvhd_structure_state is;
    assert_int_equal(bvhd_structure_get(objects[0], &is), BVHD_OK);
    assert_true(is.is_built && is.flags == (BUILD_MOTION | BUILD_ALLOW_DATA_ACCESS) && is.data == moving.result.data);
    assert_int_equal(is.type, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
    VkCopyAccelerationStructureInfoKHR copy = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = bvhd_structure_handle(objects[0]),
                                               .dst = bvhd_structure_handle(objects[1]),
                                               .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR};
    assert_int_equal(bvhd_structure_copy(&copy, &bed.error), BVHD_OK);
    copy.dst = bvhd_structure_handle(bed.spare);
    structure_bed_refused(&bed, "a copy", bvhd_structure_copy(&copy, &bed.error), "", "info.dst");
    float corners[3][3]; /* which are the same at both ends */
    assert_int_equal(bvhd_structure_positions_at(objects[1], 0, 1, 1, corners, &bed.error), BVHD_OK);
    assert_memory_equal(corners, bed.vertices[1], sizeof corners);
    structure_bed_refused(&bed, "no time", bvhd_structure_positions(objects[1], 0, 1, corners, &bed.error), "",
                          "geometry");
    structure_bed_refused(&bed, "a late time",
                          bvhd_structure_positions_at(objects[1], 0, 1, 1.25f, corners, &bed.error), "", "time");
    bvhd_structure_destroy(objects[0]);
    bvhd_structure_destroy(objects[1]);
    bvhd_blob_unref(moving.result.blob);
    structure_bed_stop(&bed);
}

/* Describes and builds a top level of motion instances, of which the last one is inactive. */
static struct structure_build build_moving_top(VkAccelerationStructureMotionInstanceNV *records)
{
    const struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    struct structure_build moving = bed.top;
    memset(records, 0, MOTION_RECORD_STRIDE * STRUCTURE_INSTANCES);
    for (int i = 0; i < STRUCTURE_INSTANCES; i++)
        memcpy((char *)records + (ptrdiff_t)i * MOTION_RECORD_STRIDE + MOTION_RECORD_DATA, &bed.instances[i],
               sizeof bed.instances[i] - (i == STRUCTURE_INSTANCES - 1 ? sizeof(uint64_t) : 0));
    moving.geometry.geometry.instances.data.hostAddress = records;
    moving.info.pGeometries = &moving.geometry;
    moving.info.flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV;
    moving.result = structure_bed_result(&moving, &options);
    return moving;
}

static enum bvhd_status clone(const struct bvhd_structure *from, const struct bvhd_structure *to)
{
    const VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                     .src = bvhd_structure_handle(from),
                                                     .dst = bvhd_structure_handle(to),
                                                     .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR};
    return bvhd_structure_copy(&info, &bed.error);
}

static enum bvhd_status deserialize(const struct bvhd_result *result, const struct bvhd_structure *to)
{
    const VkCopyMemoryToAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.hostAddress = result->data,
        .dst = bvhd_structure_handle(to),
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    return bvhd_structure_deserialize(&info, result->size, NULL, &bed.error);
}

/* A top level that moves has at most maxInstances, inactive ones counted, whichever way it comes into its object. */
static void motion_instances_are_limited(void **state)
{
    (void)state;
    VkAccelerationStructureMotionInstanceNV records[STRUCTURE_INSTANCES + 1];
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    const struct structure_build moving = build_moving_top(records);
    VkAccelerationStructureBuildGeometryInfoKHR info = moving.info;
    info.pGeometries = &moving.geometry;
    struct bvhd_structure *exact = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, STRUCTURE_INSTANCES,
                                                 STRUCTURE_ROOM),
                          *generic = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, STRUCTURE_INSTANCES,
                                                   STRUCTURE_ROOM),
                          *less = create_moving(VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, STRUCTURE_INSTANCES - 1,
                                                STRUCTURE_ROOM);
    assert_int_equal(bvhd_structure_hold(exact, &info, &moving.range, &moving.result, &bed.error), BVHD_OK);
    structure_bed_refused(&bed, "hold", bvhd_structure_hold(less, &info, &moving.range, &moving.result, &bed.error), "",
                          "info.dstAccelerationStructure");
    assert_int_equal(clone(exact, generic), BVHD_OK);
    structure_bed_refused(&bed, "clone", clone(exact, less), "", "info.dst");
    assert_int_equal(deserialize(&moving.result, exact), BVHD_OK);
    structure_bed_refused(&bed, "deserialize", deserialize(&moving.result, less), "", "info.dst");
    bvhd_structure_destroy(exact);
    bvhd_structure_destroy(generic);
    bvhd_structure_destroy(less);
    bvhd_blob_unref(moving.result.blob);
    structure_bed_stop(&bed);
}

static VkDeviceSize compacted_size(void)
{
    const VkAccelerationStructureKHR handle = bvhd_structure_handle(bed.holds_bottom);
    VkDeviceSize size = 0;
    const struct bvhd_structure_properties properties = {.struct_size = sizeof properties,
                                                         .structure_count = 1,
                                                         .query_type =
                                                             VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                                                         .structures = &handle,
                                                         .data_size = sizeof size,
                                                         .data = &size,
                                                         .stride = sizeof size};
    assert_int_equal(bvhd_structure_query(&properties, &bed.error), BVHD_OK);
    return size;
}

static void copy(const struct bvhd_structure *from, const struct bvhd_structure *to,
                 VkCopyAccelerationStructureModeKHR mode)
{
    const VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                     .src = bvhd_structure_handle(from),
                                                     .dst = bvhd_structure_handle(to),
                                                     .mode = mode};
    assert_int_equal(bvhd_structure_copy(&info, &bed.error), BVHD_OK);
}

static enum bvhd_status hold(VkAccelerationStructureBuildGeometryInfoKHR *info, const struct bvhd_structure *source,
                             struct bvhd_structure *into)
{
    info->srcAccelerationStructure = bvhd_structure_handle(source);
    return bvhd_structure_hold(into, info, &bed.bottom.range, &bed.bottom.result, &bed.error);
}

/* An update of what COMPACT made needs its size alone, in place, elsewhere and again; all others need the build's. */
static void updates_of_compacted_structures_need_their_size(void **state)
{
    (void)state;
    structure_bed_start(&bed, BUILD_ALLOW_COMPACTION | BUILD_ALLOW_UPDATE, TARGET_PORTABLE);
    const VkDeviceSize size = compacted_size();
    struct bvhd_structure *objects[3], *compacted;
    for (int i = 0; i < 3; i++)
        objects[i] = structure_bed_create(VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, i < 2 ? size : size - 1);
    compacted = objects[0];
    copy(bed.holds_bottom, compacted, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    VkAccelerationStructureBuildGeometryInfoKHR info;
    info = bed.bottom.info;
    info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    static const char rule[] = "VUID-vkBuildAccelerationStructuresKHR-pInfos-10126",
                      where[] = "info.dstAccelerationStructure";
    assert_int_equal(hold(&info, compacted, objects[1]), BVHD_OK);
    assert_int_equal(hold(&info, objects[1], compacted), BVHD_OK); /* an update of an update */
    assert_int_equal(hold(&info, compacted, compacted), BVHD_OK);
    structure_bed_refused(&bed, "a byte less", hold(&info, compacted, objects[2]), rule, where);
    structure_bed_refused(&bed, "not compacted", hold(&info, bed.holds_bottom, objects[1]), rule, where);
    structure_bed_refused(&bed, "not said", hold(&info, NULL, objects[1]), rule, where);
    copy(compacted, bed.spare, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    assert_int_equal(hold(&info, bed.spare, objects[1]), BVHD_OK);
    info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR;
    structure_bed_refused(&bed, "a build", hold(&info, compacted, objects[1]), rule, where);
    for (int i = 0; i < 3; i++)
        bvhd_structure_destroy(objects[i]);
    structure_bed_stop(&bed);
}

/* An item that has failed says why here, too. */
static void errors_of_results_are_passed_on(void **state)
{
    (void)state;
    structure_bed_start(&bed, 0, TARGET_PORTABLE);
    struct bvhd_result failed = {.error = {.status = BVHD_CANCELLED, .where = "deadline", .text = "too late"}};
    assert_int_equal(bvhd_structure_hold(bed.spare, &bed.bottom.info, &bed.bottom.range, &failed, &bed.error),
                     BVHD_CANCELLED);
    assert_string_equal(bed.error.where, "deadline");
    structure_bed_stop(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_rule_of_creation_is_named),
        cmocka_unit_test(new_objects_are_empty),
        cmocka_unit_test(results_are_held_by_their_rules),
        cmocka_unit_test(motion_is_held_by_its_rules),
        cmocka_unit_test(moving_results_are_held),
        cmocka_unit_test(motion_instances_are_limited),
        cmocka_unit_test(updates_of_compacted_structures_need_their_size),
        cmocka_unit_test(errors_of_results_are_passed_on),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

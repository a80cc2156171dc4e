/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_input_motion.c - tests that Vulkan's structs of what moves become motion triangles and motion instances:
 * the vertices at t = 1, and the records of motion instances, one after the other or behind pointers with a type.
 */
#include "tests/support/unit.h"

#include <stdlib.h>
#include <vulkan/vulkan_core.h>

#include "client/vulkan_input.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

enum { GEOMETRIES = 2, INSTANCES = 5, RECORD = 160 };

/* A bottom level of triangles, or a top level. Of both, the second half is memory that the conversion may not read. */
struct call {
    VkAccelerationStructureGeometryMotionTrianglesDataNV end, second_end;
    VkAccelerationStructureGeometryKHR geometries[GEOMETRIES];
    VkAccelerationStructureBuildRangeInfoKHR ranges[GEOMETRIES];
    VkAccelerationStructureBuildGeometryInfoKHR info;
    struct reference references[3]; /* of the handles 7, 8 and 9 */
    float start_vertices[64][3], end_vertices[64][3];
    _Alignas(16) unsigned char records[INSTANCES][RECORD];
    uint64_t pointers[INSTANCES];
};

static void call_start(struct call *call, VkAccelerationStructureTypeKHR type, uint32_t geometry_count)
{
    memset(call, 0, sizeof *call);
    call->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = type,
        .flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV,
        .geometryCount = geometry_count,
        .pGeometries = call->geometries,
    };
    for (int i = 0; i < GEOMETRIES; i++)
        call->geometries[i].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
}

/* Makes two geometries of triangles, of which the second one moves. */
static void make_triangles(struct call *call)
{
    call_start(call, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 2);
    call->end = (VkAccelerationStructureGeometryMotionTrianglesDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
        .vertexData.hostAddress = call->end_vertices,
    };
    call->second_end = call->end;
    for (int i = 0; i < GEOMETRIES; i++)
        call->geometries[i].geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.hostAddress = call->start_vertices,
            .vertexStride = 12,
            .maxVertex = 10,
            .indexType = VK_INDEX_TYPE_NONE_KHR,
        };
    call->geometries[1].geometry.triangles.pNext = &call->end;
    call->ranges[0].primitiveCount = 3;
    call->ranges[1].primitiveCount = 2;
    call->ranges[1].firstVertex = 4;
    call->ranges[1].primitiveOffset = 24;
}

static void set_record(struct call *call, uint32_t index, uint32_t type, uint64_t reference)
{
    static const size_t reference_at[] = {56, 104, 136};
    unsigned char *record = call->records[index];
    memset(record, 0xa0 + (int)index, RECORD);
    bytes_put32(record, type);
    bytes_put32(record + 4, 0);
    if (type < 3)
        bytes_put64(record + 8 + reference_at[type], reference);
}

/* Makes a top level of records that name 8, nothing, 9, 8, and of one with an unknown type. */
static void make_instances(struct call *call)
{
    call_start(call, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, 1);
    set_record(call, 0, MOTION_STATIC, 8);
    set_record(call, 1, MOTION_MATRIX, 0);
    set_record(call, 2, MOTION_MATRIX, 9);
    set_record(call, 3, MOTION_SRT, 8);
    set_record(call, 4, MOTION_TYPES, 0);
    for (uint64_t i = 0; i < 3; i++)
        call->references[i] = (struct reference){.kind = REFERENCE_BLAS, .handle = 7 + i};
    call->geometries[0].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
    call->geometries[0].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.hostAddress = call->records,
    };
    call->ranges[0].primitiveCount = INSTANCES;
}

/* Makes the same top level, with pointers to the instances of the records. All of them are of a known type. */
static void make_pointers(struct call *call)
{
    make_instances(call);
    set_record(call, 4, MOTION_STATIC, 7);
    for (int i = 0; i < INSTANCES; i++) {
        const uint32_t type = bytes_get32(call->records[i]);
        memmove(call->records[i], call->records[i] + 8, RECORD - 8);
        call->pointers[i] = (uint64_t)(uintptr_t)call->records[i] | type;
    }
    call->geometries[0].geometry.instances.arrayOfPointers = VK_TRUE;
    call->geometries[0].geometry.instances.data.hostAddress = call->pointers;
}

static enum bvhd_status convert(const struct call *call, struct vulkan_input **ret_input, struct bvhd_error *ret_error)
{
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {call->ranges};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    return vulkan_input_create_in(&memory, &call->info, 1, ranges, call->references, 3, &options, ret_input, ret_error);
}

/* Converts a call that is right. The caller destroys the input. */
static struct vulkan_input *accept(const struct call *call)
{
    struct vulkan_input *input;
    struct bvhd_error error;
    assert_int_equal(convert(call, &input, &error), BVHD_OK);
    if (error.status != BVHD_OK)
        fail_msg("%s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    return input;
}

static void refuse(const struct call *call, enum bvhd_status status, const char *vuid, const char *where)
{
    struct vulkan_input *input;
    struct bvhd_error error;
    assert_int_equal(convert(call, &input, &error), BVHD_OK);
    if (error.status != status || strcmp(bvhd_vuid_string(error.vuid), vuid) != 0 || strcmp(error.where, where) != 0)
        fail_msg("%s instead of %s at %s: %s", bvhd_vuid_string(error.vuid), vuid, error.where, error.text);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void expect_bytes(struct bytes bytes, const void *data, uint64_t size)
{
    assert_ptr_equal(bytes.data, data);
    assert_int_equal(bytes.size, size);
}

/* Both arrays of vertices reach equally far, whether indices or the range say how far. */
static void both_arrays_of_vertices_are_found(void **state)
{
    (void)state;
    struct call call;
    make_triangles(&call);
    struct vulkan_input *input = accept(&call);
    const struct geometry *geometries = vulkan_input_entries(input)->geometries;
    assert_int_equal(vulkan_input_entries(input)->flags, BUILD_MOTION);
    assert_int_equal(geometries[0].type, GEOMETRY_TRIANGLES);
    assert_null(geometries[0].triangles.end_vertices.data);
    assert_int_equal(geometries[1].type, GEOMETRY_MOVING_TRIANGLES);
    assert_int_equal(geometries[1].triangles.vertex_stride, 12);
    expect_bytes(geometries[1].triangles.vertices, call.start_vertices, 24 + 9 * 12 + 12);
    expect_bytes(geometries[1].triangles.end_vertices, call.end_vertices, 24 + 9 * 12 + 12);
    vulkan_input_destroy(input);

    const uint16_t indices[6] = {0};
    call.geometries[1].geometry.triangles.indexType = VK_INDEX_TYPE_UINT16;
    call.geometries[1].geometry.triangles.indexData.hostAddress = indices;
    call.ranges[1].primitiveOffset = 0;
    input = accept(&call);
    geometries = vulkan_input_entries(input)->geometries;
    expect_bytes(geometries[1].triangles.indices, indices, 12);
    expect_bytes(geometries[1].triangles.end_vertices, call.end_vertices, 10 * 12 + 12);
    vulkan_input_destroy(input);

    call.end.vertexData.hostAddress = NULL; /* which prepare refuses */
    input = accept(&call);
    expect_bytes(vulkan_input_entries(input)->geometries[1].triangles.end_vertices, NULL, 0);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void chains_are_checked(void **state)
{
    (void)state;
    struct call call;
    const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    const VkBaseInStructure micromap = {.sType = (VkStructureType)1000396009};
#define DATA(name) "VUID-VkAccelerationStructureGeometry" #name "DataKHR-"
    make_triangles(&call);
    call.end.pNext = &call.second_end;
    refuse(&call, BVHD_INVALID, DATA(Triangles) "sType-unique", "infos[0].geometries[1].triangles.pNext");
    call.end.pNext = &stray;
    refuse(&call, BVHD_INVALID, DATA(Triangles) "pNext-pNext", "infos[0].geometries[1].triangles.pNext");
    call.end.pNext = &micromap;
    refuse(&call, BVHD_UNSUPPORTED, "", "infos[0].geometries[1].triangles.pNext");
    call.end.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    refuse(&call, BVHD_INVALID, DATA(Triangles) "pNext-pNext", "infos[0].geometries[1].triangles.pNext");

    make_triangles(&call);
    call.geometries[0].pNext = &call.end;
    refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryKHR-pNext-pNext", "infos[0].geometries[0].pNext");
    make_triangles(&call);
    call.geometries[0].geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
    call.geometries[0].geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR, .pNext = &call.end};
    refuse(&call, BVHD_INVALID, DATA(Aabbs) "pNext-pNext", "infos[0].geometries[0].aabbs.pNext");
    make_instances(&call);
    call.geometries[0].geometry.instances.pNext = &call.end;
    call.end.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV;
    refuse(&call, BVHD_INVALID, DATA(Instances) "pNext-pNext", "infos[0].geometries[0].instances.pNext");
}

/* The types of geometry that moves are bvhd's own: a program that writes their numbers has none of Vulkan's types. */
static void own_types_are_refused(void **state)
{
    (void)state;
    static const uint32_t types[] = {GEOMETRY_MOVING_TRIANGLES, GEOMETRY_MOVING_INSTANCES};
    for (int i = 0; i < 2; i++) {
        struct call call;
        make_triangles(&call);
        call.geometries[1].geometryType = (VkGeometryTypeKHR)types[i];
        refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryKHR-geometryType-parameter",
               "infos[0].geometries[1].geometryType");
    }
}

static void records_are_found(void **state)
{
    (void)state;
    struct call call;
    make_instances(&call);
    struct vulkan_input *input = accept(&call);
    const struct build_input *entry = vulkan_input_entries(input);
    assert_int_equal(entry->geometries[0].type, GEOMETRY_MOVING_INSTANCES);
    /* The last record ends before its stride does. */
    expect_bytes(entry->geometries[0].instances.records, call.records, (INSTANCES - 1) * RECORD + 152);
    assert_int_equal(entry->reference_count, 2);
    assert_int_equal(entry->references[0].handle, 8);
    assert_int_equal(entry->references[1].handle, 9);
    vulkan_input_destroy(input);

    call.info.flags = 0; /* then the same memory has instances of 64 bytes */
    memset(call.records, 0, sizeof call.records);
    input = accept(&call);
    entry = vulkan_input_entries(input);
    assert_int_equal(entry->geometries[0].type, GEOMETRY_INSTANCES);
    expect_bytes(entry->geometries[0].instances.records, call.records, INSTANCES * 64);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

/* Of a structure that another entry builds there is no reference yet. The rule is the one of static instances. */
static void destinations_are_not_named(void **state)
{
    (void)state;
    struct call call, other;
    make_instances(&call);
    make_triangles(&other);
    other.info.dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)9;
    const VkAccelerationStructureBuildGeometryInfoKHR infos[] = {call.info, other.info};
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {call.ranges, other.ranges};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    struct vulkan_input *input;
    struct bvhd_error errors[2];
    assert_int_equal(vulkan_input_create_in(&memory, infos, 2, ranges, call.references, 2, &options, &input, errors),
                     BVHD_OK);
    assert_string_equal(bvhd_vuid_string(errors[0].vuid), "VUID-vkBuildAccelerationStructuresKHR-None-03407");
    assert_string_equal(errors[0].where, "infos[0].geometries[0].instances[2].accelerationStructureReference");
    assert_int_equal(errors[1].status, BVHD_OK);
    vulkan_input_destroy(input);
}

/* Each record gets the type from its pointer, and no byte that does not belong to an instance of that type. */
static void instances_behind_pointers_are_gathered(void **state)
{
    (void)state;
    static const uint32_t types[INSTANCES] = {MOTION_STATIC, MOTION_MATRIX, MOTION_MATRIX, MOTION_SRT, MOTION_STATIC};
    static const size_t sizes[] = {64, 112, 144};
    struct call call;
    make_pointers(&call);
    call.ranges[0].primitiveOffset = 0;
    struct vulkan_input *input = accept(&call);
    const struct build_input *entry = vulkan_input_entries(input);
    const struct bytes records = entry->geometries[0].instances.records;
    assert_int_equal(entry->geometries[0].type, GEOMETRY_MOVING_INSTANCES);
    assert_int_equal(records.size, INSTANCES * RECORD);
    assert_int_equal(entry->reference_count, 3);
    for (int i = 0; i < INSTANCES; i++) {
        unsigned char want[RECORD] = {0};
        bytes_put32(want, types[i]);
        memcpy(want + 8, call.records[i], sizes[types[i]]);
        assert_memory_equal(records.data + i * RECORD, want, RECORD);
    }
    vulkan_input_destroy(input);

    call.ranges[0].primitiveOffset = 16; /* in the array of pointers */
    call.ranges[0].primitiveCount = 3;
    input = accept(&call);
    entry = vulkan_input_entries(input);
    assert_int_equal(entry->geometries[0].range.primitive_offset, 0);
    assert_int_equal(entry->geometries[0].instances.records.size, 3 * RECORD);
    assert_memory_equal(entry->geometries[0].instances.records.data + 8, call.records[2], 112);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void wrong_pointers_are_refused(void **state)
{
    (void)state;
    struct call call;
    for (uint64_t type = 0; type < 16; type++) {
        make_pointers(&call);
        call.pointers[1] = type;
        refuse(&call, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03778",
               "infos[0].geometries[0].instances[1]");
        make_pointers(&call);
        call.pointers[3] = (call.pointers[3] & ~UINT64_C(15)) | type;
        if (type >= MOTION_TYPES)
            refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureMotionInstanceNV-type-parameter",
                   "infos[0].geometries[0].instances[3]");
    }
}

/* The caller's records are copied to their last byte and no further. */
static void records_are_owned(void **state)
{
    (void)state;
    struct call call;
    make_instances(&call);
    call.ranges[0].primitiveCount = 2;
    call.ranges[0].primitiveOffset = 2 * RECORD;
    const size_t size = 3 * RECORD + 152;
    unsigned char *exact = malloc(size), copy[RECORD + 152]; /* whose end a sanitizer knows */
    memcpy(exact, call.records, size);
    memcpy(copy, exact + 2 * RECORD, sizeof copy);
    call.geometries[0].geometry.instances.data.hostAddress = exact;
    struct vulkan_input *input = accept(&call);
    assert_true(vulkan_input_own_records(input, 0));
    free(exact);
    const struct geometry *geometry = vulkan_input_entries(input)->geometries;
    assert_int_equal(geometry->range.primitive_offset, 0);
    assert_int_equal(geometry->instances.records.size, sizeof copy);
    assert_memory_equal(geometry->instances.records.data, copy, sizeof copy);
    assert_true(vulkan_input_own_records(input, 0));
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    struct call call;
    make_pointers(&call);
    int failures = 0;
    for (enum bvhd_status status = BVHD_NO_MEMORY; status == BVHD_NO_MEMORY; failures++) {
        struct vulkan_input *input = NULL;
        struct bvhd_error error = {.status = BVHD_OK};
        memory.fail_after = failures;
        status = convert(&call, &input, &error);
        memory.fail_after = -1;
        status = status == BVHD_OK ? error.status : status;
        vulkan_input_destroy(input);
        assert_int_equal(memory.live, 0);
    }
    assert_in_range(failures, 6, 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_arrays_of_vertices_are_found),
        cmocka_unit_test(chains_are_checked),
        cmocka_unit_test(own_types_are_refused),
        cmocka_unit_test(records_are_found),
        cmocka_unit_test(destinations_are_not_named),
        cmocka_unit_test(instances_behind_pointers_are_gathered),
        cmocka_unit_test(wrong_pointers_are_refused),
        cmocka_unit_test(records_are_owned),
        cmocka_unit_test(failing_allocations_hold_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

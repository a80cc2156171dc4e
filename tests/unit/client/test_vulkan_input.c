/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_input.c - tests that Vulkan's structs become valid descriptions, and that every broken rule is named. */
#include "tests/support/unit.h"

#include <stdbool.h>

#include "builder/input/prepare.h"
#include "builder/input/validate.h"
#include "builder/input/vertex_format.h"
#include "client/vulkan_input.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

#define HANDLE(number) ((VkAccelerationStructureKHR)(uintptr_t)(number))

enum { ENTRIES = 5 };

/* A call of five entries: triangles, boxes by pointers, instances, instances by pointers, nothing. */
struct call {
    VkAccelerationStructureBuildGeometryInfoKHR infos[ENTRIES];
    VkAccelerationStructureGeometryKHR geometries[ENTRIES];
    const VkAccelerationStructureGeometryKHR *geometry_pointers[1];
    VkAccelerationStructureBuildRangeInfoKHR range_values[ENTRIES];
    const VkAccelerationStructureBuildRangeInfoKHR *ranges[ENTRIES];
    const VkAccelerationStructureBuildRangeInfoKHR *const *range_array;
    float vertices[4][3];
    uint32_t indices[8];
    VkTransformMatrixKHR transforms[2];
    VkAabbPositionsKHR boxes[3];
    VkAccelerationStructureInstanceKHR instances[4];
    const VkAccelerationStructureInstanceKHR *instance_pointers[6];
    struct reference references[3];
};

static VkAccelerationStructureInstanceKHR instance(uint64_t reference, uint32_t number)
{
    return (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 1}, {0, 1, 0, 2}, {0, 0, 1, 3}}},
                                                .instanceCustomIndex = number,
                                                .mask = 0xff,
                                                .instanceShaderBindingTableRecordOffset = number * 2,
                                                .flags = VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR,
                                                .accelerationStructureReference = reference};
}

static void set_geometries(struct call *call)
{
    for (int i = 0; i < ENTRIES; i++)
        call->geometries[i].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
    call->geometries[0].geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
    call->geometries[0].flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    call->geometries[0].geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = call->vertices,
        .vertexStride = 12,
        .maxVertex = 3,
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = call->indices,
        .transformData.hostAddress = call->transforms,
    };
    call->geometries[1].geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
    call->geometries[1].geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .data.hostAddress = call->boxes,
        .stride = sizeof call->boxes[0],
    };
    for (int i = 2; i < ENTRIES; i++) {
        call->geometries[i].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
        call->geometries[i].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
            .arrayOfPointers = i == 3,
            .data.hostAddress = i == 3 ? (const void *)call->instance_pointers : call->instances,
        };
    }
}

static void set_data(struct call *call)
{
    static const uint32_t indices[8] = {7, 7, 0, 1, 2, 2, 1, 3};
    static const float vertices[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 1}};
    static const uint64_t named[4] = {30, 0, 10, 30};
    memcpy(call->indices, indices, sizeof indices);
    memcpy(call->vertices, vertices, sizeof vertices);
    call->transforms[1] = (VkTransformMatrixKHR){{{2, 0, 0, 0}, {0, 2, 0, 0}, {0, 0, 2, 1}}};
    for (int i = 0; i < 3; i++)
        call->boxes[i] = (VkAabbPositionsKHR){0, 0, 0, 1, 1, (float)i};
    for (uint32_t i = 0; i < 4; i++) {
        call->instances[i] = instance(named[i], i);
        call->instance_pointers[2 + i] = &call->instances[3 - i];
    }
    for (uint64_t i = 0; i < 3; i++)
        call->references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = 10 * (i + 1), .bounds = {{0, 0, 0}, {1, 1, 1}}};
}

static void call_make(struct call *call)
{
    static const VkAccelerationStructureBuildRangeInfoKHR ranges[ENTRIES] = {
        {2, 8, 0, 48}, {3, 0, 0, 0}, {4, 0, 0, 0}, {4, 16, 0, 0}};
    memset(call, 0, sizeof *call);
    set_geometries(call);
    set_data(call);
    memcpy(call->range_values, ranges, sizeof ranges);
    call->geometry_pointers[0] = &call->geometries[1];
    for (uint32_t i = 0; i < ENTRIES; i++) {
        call->ranges[i] = &call->range_values[i];
        call->infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = i == 2 || i == 3 ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                     : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
            .dstAccelerationStructure = HANDLE(100 + i),
            .geometryCount = i < 4,
            .pGeometries = i != 1 ? &call->geometries[i] : NULL,
            .ppGeometries = i == 1 ? call->geometry_pointers : NULL,
        };
    }
    call->infos[4].pGeometries = NULL;
    call->ranges[4] = NULL;
    call->range_array = call->ranges;
}

static enum bvhd_status convert(const struct call *call, struct vulkan_input **ret_input, struct bvhd_error *ret_errors)
{
    struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    return vulkan_input_create_in(&memory, call->infos, ENTRIES, call->range_array, call->references, 3, &options,
                                  ret_input, ret_errors);
}

/* Checks that the entry fails with the rule at the place and is empty, and that the others do not fail. */
static void refuse(const char *name, const struct call *call, uint32_t entry, enum bvhd_status status, const char *vuid,
                   const char *where)
{
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES];
    assert_int_equal(convert(call, &input, errors), BVHD_OK);
    for (uint32_t i = 0; i < ENTRIES; i++) {
        bool right = i != entry ? errors[i].status == BVHD_OK
                                : errors[i].status == status && strcmp(bvhd_vuid_string(errors[i].vuid), vuid) == 0 &&
                                      strcmp(errors[i].where, where) == 0;
        if (!right)
            fail_msg("%s: entry %u: %s %s at %s: %s", name, i, bvhd_status_name(errors[i].status),
                     bvhd_vuid_string(errors[i].vuid), errors[i].where, errors[i].text);
    }
    assert_int_equal(vulkan_input_entries(input)[entry].geometry_count, 0);
    assert_null(vulkan_input_entries(input)[entry].geometries);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void structs_are_converted(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES];
    call_make(&call);
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    const struct build_input *entries = vulkan_input_entries(input);
    for (uint32_t i = 0; i < ENTRIES; i++) {
        assert_int_equal(errors[i].status, BVHD_OK);
        assert_int_equal(entries[i].destination, 100 + i);
        assert_int_equal(entries[i].options.quality, QUALITY_FAST);
        assert_int_equal(entries[i].geometry_count, i < 4);
    }
    const struct geometry_triangles *triangles = &entries[0].geometries[0].triangles;
    assert_int_equal(entries[0].geometries[0].flags, GEOMETRY_OPAQUE);
    assert_ptr_equal(triangles->vertices.data, call.vertices);
    assert_int_equal(triangles->vertices.size, sizeof call.vertices);
    assert_int_equal(triangles->indices.size, sizeof call.indices);
    assert_int_equal(triangles->transform.size, sizeof call.transforms);
    assert_int_equal(entries[1].geometries[0].aabbs.boxes.size, sizeof call.boxes);
    assert_int_equal(entries[2].geometries[0].instances.records.size, sizeof call.instances);
    for (int i = 2; i < 4; i++) {
        assert_int_equal(entries[i].reference_count, 2);
        assert_int_equal(entries[i].references[0].handle, 10);
        assert_int_equal(entries[i].references[1].handle, 30);
    }
    const struct geometry *gathered = entries[3].geometries;
    assert_int_equal(gathered->range.primitive_offset, 0);
    for (int i = 0; i < 4; i++)
        assert_memory_equal(gathered->instances.records.data + (ptrdiff_t)64 * i, &call.instances[3 - i], 64);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

/* A builder accepts the descriptions: they are valid and equal Vulkan's structs. */
static void descriptions_are_prepared(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES], error;
    struct limits limits = limits_default();
    struct canonical canonical[ENTRIES];
    call_make(&call);
    struct build_options options = {.target = TARGET_PORTABLE};
    assert_int_equal(
        vulkan_input_create(call.infos, ENTRIES, call.range_array, call.references, 3, &options, &input, errors),
        BVHD_OK);
    for (uint32_t i = 0; i < ENTRIES; i++)
        if (prepare(&vulkan_input_entries(input)[i], i, &limits, &context, &canonical[i], &error) != BVHD_OK)
            fail_msg("entry %u: %s at %s: %s", i, bvhd_vuid_string(error.vuid), error.where, error.text);
    const struct canonical_geometry *triangles = canonical[0].geometries;
    assert_memory_equal(triangles->indices, call.indices + 2, 24);
    for (int i = 0; i < 4; i++) {
        const float *p = call.vertices[i], want[3] = {2 * p[0], 2 * p[1], 2 * p[2] + 1};
        assert_memory_equal(triangles->positions + (ptrdiff_t)3 * i, want, 12);
    }
    assert_memory_equal(canonical[1].geometries[0].boxes, call.boxes, sizeof call.boxes);
    for (uint32_t i = 0; i < 4; i++) {
        struct canonical_instance a = canonical_instance(canonical[2].geometries, i);
        assert_int_equal(a.custom_index, i);
        assert_int_equal(a.sbt_offset, 2 * i);
        assert_int_equal(a.flags, INSTANCE_CULL_DISABLE);
        assert_int_equal(a.mask, 0xff);
        assert_int_equal(canonical_instance(canonical[3].geometries, 3 - i).custom_index, i);
    }
    for (uint32_t i = 0; i < ENTRIES; i++)
        prepare_finish(&canonical[i], &memory);
    vulkan_input_destroy(input);
    vulkan_input_destroy(NULL);
}

static void every_rule_is_named(void **state)
{
    (void)state;
    struct call call;
    static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    static const VkBaseInStructure micromap = {.sType = (VkStructureType)1000396009};
#define REFUSE(statement, entry, status, vuid, where)                                                                  \
    do {                                                                                                               \
        call_make(&call);                                                                                              \
        statement;                                                                                                     \
        refuse(#statement, &call, entry, status, vuid, where);                                                         \
    } while (0)
#define INFO "VUID-VkAccelerationStructureBuildGeometryInfoKHR-"
#define DATA(name) "VUID-VkAccelerationStructureGeometry" #name "DataKHR-"
#define CALL "VUID-vkBuildAccelerationStructuresKHR-"
    REFUSE(call.infos[0].sType = 0, 0, BVHD_INVALID, INFO "sType-sType", "infos[0].sType");
    REFUSE(call.infos[4].pNext = &stray, 4, BVHD_INVALID, INFO "pNext-pNext", "infos[4].pNext");
    REFUSE(call.infos[0].ppGeometries = call.geometry_pointers, 0, BVHD_INVALID, INFO "pGeometries-03788",
           "infos[0].pGeometries");
    REFUSE(call.infos[1].ppGeometries = NULL, 1, BVHD_INVALID, INFO "pGeometries-03788", "infos[1].pGeometries");
    REFUSE(call.geometry_pointers[0] = NULL, 1, BVHD_INVALID, INFO "ppGeometries-parameter",
           "infos[1].ppGeometries[0]");
    REFUSE(call.ranges[2] = NULL, 2, BVHD_INVALID, CALL "pInfos-11702", "ranges[2]");
    REFUSE(call.range_array = NULL;
           call.infos[1].geometryCount = call.infos[2].geometryCount = call.infos[3].geometryCount = 0, 0, BVHD_INVALID,
           CALL "ppBuildRangeInfos-parameter", "ranges[0]");
    REFUSE(call.geometries[0].sType = 0, 0, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryKHR-sType-sType",
           "infos[0].geometries[0].sType");
    REFUSE(call.geometries[1].pNext = &stray, 1, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryKHR-pNext-pNext",
           "infos[1].geometries[0].pNext");
    REFUSE(call.geometries[0].geometry.triangles.sType = 0, 0, BVHD_INVALID, DATA(Triangles) "sType-sType",
           "infos[0].geometries[0].triangles.sType");
    REFUSE(call.geometries[1].geometry.aabbs.sType = 0, 1, BVHD_INVALID, DATA(Aabbs) "sType-sType",
           "infos[1].geometries[0].aabbs.sType");
    REFUSE(call.geometries[2].geometry.instances.sType = 0, 2, BVHD_INVALID, DATA(Instances) "sType-sType",
           "infos[2].geometries[0].instances.sType");
    REFUSE(call.geometries[0].geometry.triangles.pNext = &stray, 0, BVHD_INVALID, DATA(Triangles) "pNext-pNext",
           "infos[0].geometries[0].triangles.pNext");
    REFUSE(call.geometries[0].geometry.triangles.pNext = &micromap, 0, BVHD_UNSUPPORTED, "",
           "infos[0].geometries[0].triangles.pNext");
    REFUSE(call.geometries[1].geometry.aabbs.pNext = &stray, 1, BVHD_INVALID, DATA(Aabbs) "pNext-pNext",
           "infos[1].geometries[0].aabbs.pNext");
    REFUSE(call.geometries[3].geometry.instances.pNext = &stray, 3, BVHD_INVALID, DATA(Instances) "pNext-pNext",
           "infos[3].geometries[0].instances.pNext");
    REFUSE(call.instance_pointers[4] = NULL, 3, BVHD_INVALID, CALL "pInfos-03778",
           "infos[3].geometries[0].instances[2]");
}

/* Numbers that no structure may have are refused before memory is asked for them, and before they are read. */
static void impossible_counts_take_no_memory(void **state)
{
    (void)state;
    struct call call;
    memory.peak = 0;
    REFUSE(call.infos[0].geometryCount = 0x7fffffff, 0, BVHD_INVALID, INFO "type-03793", "infos[0].geometryCount");
    REFUSE(call.infos[0].geometryCount = 1 << 24, 0, BVHD_INVALID, INFO "type-03793", "infos[0].geometryCount");
    REFUSE(call.infos[2].geometryCount = UINT32_MAX, 2, BVHD_INVALID, INFO "type-03790", "infos[2].geometryCount");
    REFUSE(call.infos[3].geometryCount = 2, 3, BVHD_INVALID, INFO "type-03790", "infos[3].geometryCount");
    REFUSE(call.infos[0].geometryCount = UINT32_MAX; call.infos[0].type = VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, 0,
                                                     BVHD_INVALID, INFO "type-03654", "infos[0].type");
    REFUSE(call.infos[0].geometryCount = UINT32_MAX; call.infos[0].type = (VkAccelerationStructureTypeKHR)77, 0,
                                                     BVHD_INVALID, INFO "type-parameter", "infos[0].type");
    assert_in_range(memory.peak, 1, 1 << 16);
}
#undef REFUSE

/* Rule 03407 is about the handles that instances name, not about the references that are known. */
static void destinations_are_not_named(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES];
    call_make(&call);
    call.infos[0].dstAccelerationStructure = HANDLE(20);
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    for (int i = 0; i < ENTRIES; i++)
        assert_int_equal(errors[i].status, BVHD_OK);
    vulkan_input_destroy(input);
    call.infos[0].dstAccelerationStructure = HANDLE(40); /* not known yet, and named by entry 2 alone */
    call.instances[2].accelerationStructureReference = 40;
    call.instance_pointers[3] = &call.instances[0];
    refuse("named destination", &call, 2, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-None-03407",
           "infos[2].geometries[0].instances[2].accelerationStructureReference");
    /* An entry's own destination is not checked here. */
    call.infos[0].dstAccelerationStructure = HANDLE(41);
    call.infos[2].dstAccelerationStructure = HANDLE(40);
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    assert_int_equal(errors[2].status, BVHD_OK);
    vulkan_input_destroy(input);
}

/* The derived sizes allow exactly the bytes that Vulkan's ranges reach: with one byte less the entry is refused. */
static void sizes_are_what_is_read(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES];
    struct limits limits = limits_default();
    uint32_t count;
    const struct vertex_format *formats = vertex_formats(&count);
    for (uint32_t f = 0; f < count; f++)
        for (uint32_t first = 0; first < 3; first++) {
            call_make(&call);
            VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &call.geometries[0].geometry.triangles;
            triangles->vertexFormat = (VkFormat)formats[f].format;
            triangles->indexType = VK_INDEX_TYPE_NONE_KHR;
            triangles->vertexStride = 3 * formats[f].alignment;
            triangles->maxVertex = 100;
            call.range_values[0] = (VkAccelerationStructureBuildRangeInfoKHR){2, 2 * formats[f].alignment, first, 0};
            assert_int_equal(convert(&call, &input, errors), BVHD_OK);
            struct build_input entry = vulkan_input_entries(input)[0];
            struct geometry geometry = entry.geometries[0];
            entry.geometries = &geometry;
            assert_int_equal(geometry.triangles.vertices.size, 2 * formats[f].alignment +
                                                                   (uint64_t)3 * formats[f].alignment * (first + 5) +
                                                                   formats[f].size);
            assert_int_equal(validate_input(&entry, 0, &limits, NULL), BVHD_OK);
            geometry.triangles.vertices.size--;
            assert_int_equal(validate_input(&entry, 0, &limits, NULL), BVHD_INVALID);
            vulkan_input_destroy(input);
        }
}

/* Counts, strides and formats that make no sense reach validate.h unchanged, and no memory is read for them. */
static void nonsense_is_left_to_validation(void **state)
{
    (void)state;
    static const struct {
        uint32_t entry;
        const char *vuid;
    } cases[] = {
        {0, "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-vertexStride-03819"},
        {0, "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-vertexFormat-03797"},
        {0, "VUID-VkAccelerationStructureGeometryKHR-geometryType-parameter"},
        {3, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03801"},
        {3, "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03660"},
        {3, "VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03791"},
        {3, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03778"},
        {0, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03771"},
        {0, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03772"},
        {1, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03774"},
        {3, ""},
    };
    for (uint32_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct call call;
        struct vulkan_input *input;
        struct bvhd_error errors[ENTRIES], error;
        struct limits limits = limits_default();
        call_make(&call);
        VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &call.geometries[0].geometry.triangles;
        switch (i) {
        case 0:
            triangles->vertexStride = UINT64_MAX - 3;
            triangles->maxVertex = UINT32_MAX;
            break;
        case 1:
            triangles->vertexFormat = VK_FORMAT_R8_UNORM;
            break;
        case 2:
            call.geometries[0].geometryType = (VkGeometryTypeKHR)77;
            break;
        case 3:
            call.range_values[3].primitiveCount = UINT32_MAX;
            break;
        case 4:
            call.range_values[3].primitiveOffset = 8;
            break;
        case 5:
            call.infos[3].type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
            break;
        case 6:
            call.geometries[3].geometry.instances.data.hostAddress = NULL;
            break;
        case 7:
            triangles->vertexData.hostAddress = NULL;
            break;
        case 8:
            triangles->indexData.hostAddress = NULL;
            break;
        case 9:
            call.geometries[1].geometry.aabbs.data.hostAddress = NULL;
            break;
        default:
            call.infos[3].flags = 0x400; /* LOSSY, of micromaps */
        }
        assert_int_equal(convert(&call, &input, errors), BVHD_OK);
        assert_int_equal(errors[cases[i].entry].status, BVHD_OK);
        const struct build_input *entry = &vulkan_input_entries(input)[cases[i].entry];
        assert_int_equal(validate_input(entry, 0, &limits, &error), *cases[i].vuid ? BVHD_INVALID : BVHD_UNSUPPORTED);
        assert_string_equal(bvhd_vuid_string(error.vuid), cases[i].vuid);
        vulkan_input_destroy(input);
        assert_int_equal(memory.live, 0);
    }
}

/* If a rule is broken that the size of memory depends on, that memory is not read. */
static void what_breaks_rules_is_not_read(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES], error;
    struct limits limits = limits_default();
    call_make(&call);
    call.geometries[0].geometry.triangles.indexType = (VkIndexType)1000265000; /* UINT8 */
    call.geometries[0].geometry.triangles.vertexStride = UINT64_C(1) << 33;
    call.geometries[1].geometry.aabbs.stride = UINT64_C(1) << 33;
    call.infos[3].type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR; /* its data are pointers to instances */
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    const struct build_input *entries = vulkan_input_entries(input);
    assert_int_equal(entries[0].geometries[0].triangles.vertices.size, 0);
    assert_int_equal(entries[0].geometries[0].triangles.indices.size, 0);
    assert_int_equal(entries[1].geometries[0].aabbs.boxes.size, 0);
    assert_int_equal(entries[3].geometries[0].instances.records.size, 0);
    static const enum bvhd_vuid vuids[ENTRIES] = {BVHD_VUID_03819, BVHD_VUID_03820, BVHD_VUID_NONE, BVHD_VUID_03791};
    for (int i = 0; i < 4; i++)
        if (vuids[i] != BVHD_VUID_NONE) {
            assert_int_equal(validate_input(&entries[i], 0, &limits, &error), BVHD_INVALID);
            assert_int_equal(error.vuid, vuids[i]);
        }
    vulkan_input_destroy(input);
    call.geometries[0].geometry.triangles.vertexStride = 12;
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    assert_int_equal(validate_input(&vulkan_input_entries(input)[0], 0, &limits, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03798);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

static void ranges_may_be_missing_altogether(void **state)
{
    (void)state;
    struct call call;
    struct vulkan_input *input;
    struct bvhd_error errors[ENTRIES];
    call_make(&call);
    call.range_array = NULL;
    assert_int_equal(convert(&call, &input, errors), BVHD_OK);
    for (int i = 0; i < ENTRIES; i++)
        assert_int_equal(errors[i].vuid, i < 4 ? BVHD_VUID_Build_ppBuildRangeInfos_parameter : BVHD_VUID_NONE);
    vulkan_input_destroy(input);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct call call;
    int alone = 0, together = 0;
    call_make(&call);
    for (int failures = 0;; failures++) {
        struct vulkan_input *input;
        struct bvhd_error errors[ENTRIES];
        atomic_store(&memory.fail_after, failures);
        enum bvhd_status status = convert(&call, &input, errors);
        bool spent = atomic_load(&memory.fail_after) < 0;
        atomic_store(&memory.fail_after, -1);
        if (status == BVHD_OK) {
            int failed = 0;
            for (int i = 0; i < ENTRIES; i++)
                failed += errors[i].status == BVHD_NO_MEMORY;
            assert_int_equal(failed, spent ? 1 : 0);
            alone += failed;
            vulkan_input_destroy(input);
        } else {
            assert_int_equal(status, BVHD_NO_MEMORY);
            together++;
        }
        assert_int_equal(memory.live, 0);
        if (!spent)
            break;
    }
    assert_int_equal(together, 5);
    assert_int_equal(alone, 4 + 2 * 2 + 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structs_are_converted),
        cmocka_unit_test(descriptions_are_prepared),
        cmocka_unit_test(every_rule_is_named),
        cmocka_unit_test(impossible_counts_take_no_memory),
        cmocka_unit_test(destinations_are_not_named),
        cmocka_unit_test(sizes_are_what_is_read),
        cmocka_unit_test(nonsense_is_left_to_validation),
        cmocka_unit_test(what_breaks_rules_is_not_read),
        cmocka_unit_test(ranges_may_be_missing_altogether),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_input_micromap.c - tests that Vulkan's structs of opacity micromaps, of both extensions, become
 * micromaps and triangles with them: how much memory they reach, and the rules that only these structs show.
 */
#include "tests/support/unit.h"

#include <string.h>

#include <bvhd/bvhd_micromap.h>

#include "builder/format/micro_triangle.h"
#include "client/vulkan_input.h"
#include "proto/base/validate_shape.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

enum { TRIANGLES = 3, STRIDE = 12, REFERENCES = 4, KEYED = 7, KEYLESS = 8, OTHER = 9, UNUSED = 10 };

/* A bottom level of two geometries with triangles, or a micromap. The test changes what it is about. */
static struct call {
    VkAccelerationStructureTrianglesOpacityMicromapEXT ext, second_ext;
    VkAccelerationStructureTrianglesOpacityMicromapKHR khr;
    VkAccelerationStructureGeometryMotionTrianglesDataNV end;
    VkAccelerationStructureGeometryMicromapDataKHR data;
    struct bvhd_micromap_bake bake;
    VkAccelerationStructureGeometryKHR geometries[2];
    VkAccelerationStructureBuildRangeInfoKHR ranges[2];
    VkAccelerationStructureBuildGeometryInfoKHR info;
    struct reference references[REFERENCES];
    VkMicromapUsageEXT usages[2];
    const VkMicromapUsageEXT *usage_pointers[2];
    uint16_t indices[8];
    float vertices[64][3];
    unsigned char triangles[TRIANGLES * STRIDE], states[256];
    bool has_ranges;
} call;

/* Makes a bottom level of two geometries with two and four triangles; the second has the struct `ext` in its chain. */
static void make_triangles(void)
{
    memset(&call, 0, sizeof call);
    call.has_ranges = true;
    call.usages[0] = (VkMicromapUsageEXT){1, 2, VK_OPACITY_MICROMAP_FORMAT_2_STATE_EXT};
    call.usages[1] = (VkMicromapUsageEXT){2, 1, VK_OPACITY_MICROMAP_FORMAT_4_STATE_EXT};
    call.usage_pointers[0] = &call.usages[1];
    call.usage_pointers[1] = &call.usages[0];
    call.ext = (VkAccelerationStructureTrianglesOpacityMicromapEXT){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_EXT,
        .indexType = VK_INDEX_TYPE_UINT16,
        .indexBuffer.hostAddress = call.indices,
        .indexStride = 4,
        .baseTriangle = 5,
        .usageCountsCount = 2,
        .pUsageCounts = call.usages,
        .micromap = (VkMicromapEXT)(uintptr_t)KEYED,
    };
    call.second_ext = call.ext;
    call.khr = (VkAccelerationStructureTrianglesOpacityMicromapKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_KHR,
        .indexType = (VkIndexType)INDEX_UINT8,
        .indexBuffer = (VkDeviceAddress)(uintptr_t)call.indices,
        .indexStride = 1,
    };
    call.end.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV;
    call.end.vertexData.hostAddress = call.vertices;
    for (uint32_t i = 0; i < REFERENCES; i++)
        call.references[i] = (struct reference){
            .kind = REFERENCE_BLAS, .handle = KEYED + i, .has_key = KEYED + i != KEYLESS, .bounds = {{1}, {2}}};
    call.references[0].key.bytes[0] = 77;
    for (int i = 0; i < 2; i++) {
        call.geometries[i] = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                                   .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                                   .vertexData.hostAddress = call.vertices,
                                   .vertexStride = 12,
                                   .maxVertex = 10,
                                   .indexType = VK_INDEX_TYPE_NONE_KHR}};
        call.ranges[i].primitiveCount = 2 * (uint32_t)i + 2;
    }
    call.geometries[1].geometry.triangles.pNext = &call.ext;
    call.info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .geometryCount = 2,
        .pGeometries = call.geometries,
    };
}

static void set_triangle(uint32_t index, uint32_t offset, uint16_t level, uint16_t format)
{
    const struct micromap_triangle triangle = {offset, level, format};
    memcpy(call.triangles + (size_t)index * STRIDE, &triangle, sizeof triangle);
}

/* Makes a micromap of three triangles, the second of which has the last states, and no ranges. */
static void make_micromap(void)
{
    make_triangles();
    call.has_ranges = false;
    set_triangle(0, 3, 2, MICRO_2_STATE);
    set_triangle(1, 30, 2, MICRO_4_STATE);
    set_triangle(2, 0, 0, MICRO_2_STATE);
    call.data = (VkAccelerationStructureGeometryMicromapDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MICROMAP_DATA_KHR,
        .usageCountsCount = 2,
        .pUsageCounts = (const void *)call.usages,
        .data = (VkDeviceAddress)(uintptr_t)call.states,
        .triangleArray = (VkDeviceAddress)(uintptr_t)call.triangles,
        .triangleArrayStride = STRIDE,
    };
    call.geometries[0] = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .pNext = &call.data,
        .geometryType = VK_GEOMETRY_TYPE_MICROMAP_KHR,
    };
    call.info.type = VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR;
    call.info.geometryCount = 1;
}

/* Makes a micromap of two triangles from a texture of 4 x 3 texels. */
static void make_bake(void)
{
    make_micromap();
    call.bake = (struct bvhd_micromap_bake){
        .sType = BVHD_STRUCTURE_TYPE_MICROMAP_BAKE,
        .alpha = call.states,
        .width = 4,
        .height = 3,
        .row_stride = 10,
        .wrap_v = BVHD_BAKE_CLAMP_TO_EDGE,
        .mode = BVHD_BAKE_BLEND,
        .cutoff = 0.5f,
        .format = VK_OPACITY_MICROMAP_FORMAT_4_STATE_KHR,
        .level = BVHD_BAKE_LEVEL_AUTO,
        .coordinates = call.vertices,
        .coordinate_stride = 12,
        .vertex_count = 5,
        .triangle_count = 2,
        .index_type = VK_INDEX_TYPE_UINT16,
        .indices = call.indices,
    };
    call.geometries[0].pNext = &call.bake;
}

static enum bvhd_status convert(struct vulkan_input **ret_input, struct bvhd_error *ret_error)
{
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {call.ranges};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    return vulkan_input_create_in(&memory, &call.info, 1, call.has_ranges ? ranges : NULL, call.references, REFERENCES,
                                  &options, ret_input, ret_error);
}

/* Converts a call that is right. The caller destroys the input. */
static struct vulkan_input *accept(void)
{
    struct vulkan_input *input;
    struct bvhd_error error;
    assert_int_equal(convert(&input, &error), BVHD_OK);
    if (error.status != BVHD_OK)
        fail_msg("%s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    return input;
}

static void accept_all(void)
{
    vulkan_input_destroy(accept());
    assert_int_equal(memory.live, 0);
}

static void refuse(enum bvhd_status status, const char *vuid, const char *where)
{
    struct vulkan_input *input;
    struct bvhd_error error;
    assert_int_equal(convert(&input, &error), BVHD_OK);
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

/* The usage counts are copies, whichever form they come in. */
static void expect_usages(struct bytes usages, int first)
{
    assert_int_equal(usages.size, 2 * sizeof(struct micromap_usage));
    assert_memory_equal(usages.data, &call.usages[first], sizeof(struct micromap_usage));
    assert_memory_equal(usages.data + sizeof(struct micromap_usage), &call.usages[1 - first],
                        sizeof(struct micromap_usage));
    assert_ptr_not_equal(usages.data, call.usages);
}

#define EXT "VUID-VkAccelerationStructureTrianglesOpacityMicromapEXT-"
#define KHR "VUID-VkAccelerationStructureTrianglesOpacityMicromapKHR-"
#define DATA "VUID-VkAccelerationStructureGeometryMicromapDataKHR-"
#define HOST "VUID-vkBuildAccelerationStructuresKHR-"
#define SECOND "infos[0].geometries[1].triangles."
#define FIRST "infos[0].geometries[0]."

static void triangles_have_micromaps(void **state)
{
    (void)state;
    make_triangles();
    struct vulkan_input *input = accept();
    const struct build_input *entry = vulkan_input_entries(input);
    const struct triangle_micromap *micromap = &entry->geometries[1].triangles.micromap;
    assert_int_equal(entry->geometries[0].triangles.micromap.is_given, 0);
    assert_int_equal(micromap->is_given, 1);
    assert_int_equal(micromap->index_type, INDEX_UINT16);
    assert_int_equal(micromap->stride, 4);
    assert_int_equal(micromap->base_triangle, 5);
    assert_int_equal(micromap->has_usages, 1);
    assert_int_equal(micromap->micromap, KEYED);
    expect_bytes(micromap->indices, call.indices, 3 * 4 + 2);
    expect_usages(micromap->usages, 0);
    assert_int_equal(entry->reference_count, 1);
    assert_int_equal(entry->references[0].kind, REFERENCE_MICROMAP);
    assert_int_equal(entry->references[0].handle, KEYED);
    assert_int_equal(entry->references[0].key.bytes[0], 77);
    assert_true(entry->references[0].bounds.min[0] > entry->references[0].bounds.max[0]);
    vulkan_input_destroy(input);

    call.ext.pUsageCounts = NULL;
    call.ext.ppUsageCounts = call.usage_pointers;
    input = accept();
    expect_usages(vulkan_input_entries(input)->geometries[1].triangles.micromap.usages, 1);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

/* Micromaps and motion come in any order, and both may be there. */
static void micromaps_go_with_motion(void **state)
{
    (void)state;
    for (int order = 0; order < 2; order++) {
        make_triangles();
        call.ext.pNext = order == 0 ? &call.end : NULL;
        call.end.pNext = order == 0 ? NULL : &call.ext;
        call.geometries[1].geometry.triangles.pNext = order == 0 ? (void *)&call.ext : &call.end;
        struct vulkan_input *input = accept();
        const struct geometry *geometry = &vulkan_input_entries(input)->geometries[1];
        assert_int_equal(geometry->type, GEOMETRY_MOVING_TRIANGLES);
        assert_int_equal(geometry->triangles.micromap.micromap, KEYED);
        expect_bytes(geometry->triangles.end_vertices, call.vertices, 11 * 12 + 12);
        vulkan_input_destroy(input);
    }
    call.end.pNext = &call.ext;
    call.ext.pNext = &call.second_ext;
    refuse(BVHD_INVALID, "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-sType-unique", SECOND "pNext");
    call.ext.pNext = &call.end;
    refuse(BVHD_INVALID, "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-sType-unique", SECOND "pNext");
    call.ext.pNext = &call.khr;
    refuse(BVHD_INVALID, "", SECOND "pNext");
}

static void references_are_selected(void **state)
{
    (void)state;
    make_triangles();
    call.second_ext.micromap = (VkMicromapEXT)(uintptr_t)OTHER;
    call.geometries[0].geometry.triangles.pNext = &call.second_ext;
    struct vulkan_input *input = accept();
    assert_int_equal(vulkan_input_entries(input)->reference_count, 2);
    assert_int_equal(vulkan_input_entries(input)->references[1].handle, OTHER);
    vulkan_input_destroy(input);

    call.second_ext.micromap = (VkMicromapEXT)(uintptr_t)99; /* which prepare refuses */
    call.ext.micromap = VK_NULL_HANDLE;
    input = accept();
    assert_int_equal(vulkan_input_entries(input)->reference_count, 0);
    vulkan_input_destroy(input);

    call.ext.micromap = (VkMicromapEXT)(uintptr_t)KEYLESS;
    refuse(BVHD_INVALID, "", SECOND "micromap.micromap");
}

static void indices_are_there_or_not(void **state)
{
    (void)state;
    make_triangles();
    call.ext.indexType = VK_INDEX_TYPE_NONE_KHR;
    refuse(BVHD_INVALID, HOST "pInfos-10892", SECOND "micromap.indexBuffer");
    call.ext.indexBuffer.hostAddress = NULL;
    accept_all();
    call.ext.indexType = VK_INDEX_TYPE_UINT32;
    refuse(BVHD_INVALID, HOST "pInfos-11821", SECOND "micromap.indexBuffer");
    call.ext.indexBuffer.hostAddress = call.indices;
    accept_all();

    call.ext.indexStride = UINT64_C(1) << 33; /* which validate refuses: nothing is read */
    struct vulkan_input *input = accept();
    assert_int_equal(vulkan_input_entries(input)->geometries[1].triangles.micromap.indices.size, 0);
    vulkan_input_destroy(input);
}

static void usages_are_given_once(void **state)
{
    (void)state;
    make_triangles();
    call.ext.ppUsageCounts = call.usage_pointers;
    refuse(BVHD_INVALID, EXT "pUsageCounts-07335", SECOND "micromap.pUsageCounts");
    call.ext.pUsageCounts = NULL;
    accept_all();
    call.usage_pointers[1] = NULL;
    refuse(BVHD_INVALID, EXT "ppUsageCounts-parameter", SECOND "micromap.ppUsageCounts[1]");
    call.ext.ppUsageCounts = NULL;
    refuse(BVHD_INVALID, "", SECOND "micromap.pUsageCounts");
    call.ext.usageCountsCount = 0;
    accept_all();

    make_micromap();
    call.data.ppUsageCounts = (const void *)call.usage_pointers;
    refuse(BVHD_INVALID, DATA "pUsageCounts-11642", FIRST "micromap.pUsageCounts");
    call.data.pUsageCounts = NULL;
    accept_all();
    call.usage_pointers[0] = NULL;
    refuse(BVHD_INVALID, DATA "ppUsageCounts-parameter", FIRST "micromap.ppUsageCounts[0]");
}

/* In a host build, triangles have a micromap by the EXT struct, and special indices by both. */
static void the_newer_struct_has_no_micromap(void **state)
{
    (void)state;
    make_triangles();
    call.geometries[1].geometry.triangles.pNext = &call.khr;
    struct vulkan_input *input = accept();
    const struct triangle_micromap *micromap = &vulkan_input_entries(input)->geometries[1].triangles.micromap;
    assert_int_equal(micromap->is_given, 1);
    assert_int_equal(micromap->has_usages, 0);
    assert_int_equal(micromap->index_type, INDEX_UINT8);
    expect_bytes(micromap->indices, call.indices, 4);
    vulkan_input_destroy(input);
    call.khr.indexType = VK_INDEX_TYPE_NONE_KHR;
    refuse(BVHD_INVALID, KHR "indexBuffer-11571", SECOND "micromap.indexBuffer");
    call.khr.indexType = VK_INDEX_TYPE_UINT16;
    call.khr.indexBuffer = 0;
    refuse(BVHD_INVALID, KHR "indexBuffer-11572", SECOND "micromap.indexBuffer");
    call.khr.micromap = (VkAccelerationStructureKHR)(uintptr_t)KEYED;
    refuse(BVHD_INVALID, HOST "pInfos-11705", SECOND "micromap.micromap");
}

static void states_of_micromaps_are_found(void **state)
{
    (void)state;
    make_micromap();
    struct vulkan_input *input = accept();
    const struct geometry *geometry = vulkan_input_entries(input)->geometries;
    assert_int_equal(vulkan_input_entries(input)->type, STRUCTURE_MICROMAP);
    assert_int_equal(geometry->type, GEOMETRY_MICROMAP);
    assert_int_equal(geometry->range.primitive_count, TRIANGLES);
    assert_int_equal(geometry->micromap.stride, STRIDE);
    expect_usages(geometry->micromap.usages, 0);
    expect_bytes(geometry->micromap.triangles, call.triangles, 2 * STRIDE + 8);
    expect_bytes(geometry->micromap.states, call.states, 30 + 4); /* 16 states of two bits */
    vulkan_input_destroy(input);

    set_triangle(0, UINT32_MAX, 13, MICRO_4_STATE); /* which prepare refuses: it reaches nothing here */
    set_triangle(1, UINT32_MAX, 2, 3);
    input = accept();
    expect_bytes(vulkan_input_entries(input)->geometries[0].micromap.states, call.states, 1);
    vulkan_input_destroy(input);

    set_triangle(0, UINT32_MAX, 12, MICRO_4_STATE); /* over 2^32 bytes */
    input = accept();
    expect_bytes(vulkan_input_entries(input)->geometries[0].micromap.states, call.states,
                 UINT64_C(0xffffffff) + (UINT64_C(1) << 22));
    vulkan_input_destroy(input);
}

/* What breaks a rule that validate checks is converted, and its memory is not read. */
static void broken_micromaps_reach_nothing(void **state)
{
    (void)state;
    const uint64_t strides[] = {0, 4, 10, UINT64_C(1) << 33};
    for (size_t i = 0; i < sizeof strides / sizeof *strides; i++) {
        make_micromap();
        call.data.triangleArrayStride = strides[i];
        struct vulkan_input *input = accept();
        assert_int_equal(vulkan_input_entries(input)->geometries[0].micromap.triangles.size, 0);
        assert_int_equal(vulkan_input_entries(input)->geometries[0].micromap.states.size, 0);
        vulkan_input_destroy(input);
    }
    make_micromap();
    call.usages[0].count = call.usages[1].count = UINT32_MAX;
    struct vulkan_input *input = accept();
    assert_int_equal(vulkan_input_entries(input)->geometries[0].range.primitive_count, UINT32_MAX);
    assert_int_equal(vulkan_input_entries(input)->geometries[0].micromap.triangles.size, 0);
    vulkan_input_destroy(input);

    make_micromap();
    call.data.triangleArray = 0;
    input = accept();
    expect_bytes(vulkan_input_entries(input)->geometries[0].micromap.triangles, NULL, 0);
    vulkan_input_destroy(input);
}

static void data_is_in_the_chain(void **state)
{
    (void)state;
    make_micromap();
    call.geometries[0].pNext = NULL;
    refuse(BVHD_INVALID, "VUID-VkAccelerationStructureGeometryKHR-geometryType-11568", FIRST "pNext");
    call.geometries[0].pNext = &call.data;
    accept_all();
    make_bake();
    call.bake.pNext = &call.data;
    refuse(BVHD_INVALID, "", FIRST "pNext");
}

static void bakes_are_converted(void **state)
{
    (void)state;
    make_bake();
    struct vulkan_input *input = accept();
    const struct geometry *geometry = vulkan_input_entries(input)->geometries;
    const struct geometry_bake *bake = &geometry->bake;
    assert_int_equal(geometry->type, GEOMETRY_BAKED_MICROMAP);
    assert_int_equal(geometry->range.primitive_count, 2);
    expect_bytes(bake->alpha, call.states, 2 * 10 + 4);
    expect_bytes(bake->coordinates, call.vertices, 4 * 12 + 8);
    expect_bytes(bake->indices, call.indices, 12);
    assert_int_equal(bake->width, 4);
    assert_int_equal(bake->height, 3);
    assert_int_equal(bake->row_stride, 10);
    assert_int_equal(bake->wrap_u, BAKE_REPEAT);
    assert_int_equal(bake->wrap_v, BAKE_CLAMP_TO_EDGE);
    assert_int_equal(bake->mode, BAKE_BLEND);
    assert_true(bake->cutoff == 0.5f);
    assert_int_equal(bake->format, MICRO_4_STATE);
    assert_int_equal(bake->level, BAKE_LEVEL_AUTO);
    assert_int_equal(bake->index_type, INDEX_UINT16);
    assert_int_equal(bake->vertex_count, 5);
    vulkan_input_destroy(input);

    call.bake.row_stride = 3; /* which validate refuses */
    call.bake.index_type = VK_INDEX_TYPE_NONE_KHR;
    input = accept();
    expect_bytes(vulkan_input_entries(input)->geometries[0].bake.alpha, call.states, 0);
    expect_bytes(vulkan_input_entries(input)->geometries[0].bake.indices, NULL, 0);
    vulkan_input_destroy(input);
}

/* While micromaps are not built, their structs are refused by name. */
static void the_door_is_closed(void **state)
{
    (void)state;
    validate_micromaps = false;
    make_triangles();
    refuse(BVHD_UNSUPPORTED, "", SECOND "pNext");
    call.geometries[1].geometry.triangles.pNext = &call.khr;
    refuse(BVHD_UNSUPPORTED, "", SECOND "pNext");
    make_micromap();
    call.has_ranges = true;
    refuse(BVHD_UNSUPPORTED, "", FIRST "pNext");
    make_bake();
    call.has_ranges = true;
    refuse(BVHD_UNSUPPORTED, "", FIRST "pNext");
    validate_micromaps = true;
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    make_triangles();
    int failures = 0;
    for (enum bvhd_status status = BVHD_NO_MEMORY; status == BVHD_NO_MEMORY; failures++) {
        struct vulkan_input *input = NULL;
        struct bvhd_error error = {.status = BVHD_OK};
        memory.fail_after = failures;
        status = convert(&input, &error);
        memory.fail_after = -1;
        status = status == BVHD_OK ? error.status : status;
        vulkan_input_destroy(input);
        assert_int_equal(memory.live, 0);
    }
    assert_in_range(failures, 8, 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_have_micromaps),
        cmocka_unit_test(micromaps_go_with_motion),
        cmocka_unit_test(references_are_selected),
        cmocka_unit_test(indices_are_there_or_not),
        cmocka_unit_test(usages_are_given_once),
        cmocka_unit_test(the_newer_struct_has_no_micromap),
        cmocka_unit_test(states_of_micromaps_are_found),
        cmocka_unit_test(broken_micromaps_reach_nothing),
        cmocka_unit_test(data_is_in_the_chain),
        cmocka_unit_test(bakes_are_converted),
        cmocka_unit_test(the_door_is_closed),
        cmocka_unit_test(failing_allocations_hold_nothing),
    };
    validate_micromaps = true;
    return cmocka_run_group_tests(tests, NULL, NULL);
}

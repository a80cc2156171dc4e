/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_input_round.c - tests that Vulkan's structs of spheres and linear swept spheres are found in chains, and
 * that their arrays reach exactly as far as the primitives use them.
 */
#include "tests/support/unit.h"

#include <bvhd/vulkan_nv.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/mman.h>

#include "client/vulkan_input.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

enum { BYTES = 4096, NOWHERE = 16, MODES = 3 };

/* One bottom level over one geometry. */
struct call {
    VkAccelerationStructureGeometrySpheresDataNV spheres;
    VkAccelerationStructureGeometryLinearSweptSpheresDataNV swept;
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildRangeInfoKHR range;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    unsigned char vertices[BYTES], radii[BYTES], indices[BYTES];
};

#define SWEPT VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV

static void call_make(struct call *call, VkGeometryTypeKHR type)
{
    memset(call, 0, sizeof *call);
    call->spheres = (VkAccelerationStructureGeometrySpheresDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = call->vertices,
        .vertexStride = 12,
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = call->radii,
        .radiusStride = 4,
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.hostAddress = call->indices,
        .indexStride = 4,
    };
    memcpy(&call->swept, &call->spheres, sizeof call->spheres);
    call->swept.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV;
    call->geometry = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .pNext = type == SWEPT ? (const void *)&call->swept : &call->spheres,
        .geometryType = type,
        .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
    };
    call->range.primitiveCount = 5;
    call->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .geometryCount = 1,
        .pGeometries = &call->geometry,
    };
}

static struct vulkan_input *convert(const struct call *call, struct bvhd_error *ret_error)
{
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges[] = {&call->range};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    struct vulkan_input *input;
    assert_int_equal(vulkan_input_create_in(&memory, &call->info, 1, ranges, NULL, 0, &options, &input, ret_error),
                     BVHD_OK);
    return input;
}

static struct geometry converted(const struct call *call)
{
    struct bvhd_error error;
    struct vulkan_input *input = convert(call, &error);
    if (error.status != BVHD_OK)
        fail_msg("%s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    const struct geometry geometry = vulkan_input_entries(input)->geometries[0];
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
    return geometry;
}

static void refuse(const struct call *call, enum bvhd_status status, const char *vuid, const char *where)
{
    struct bvhd_error error;
    struct vulkan_input *input = convert(call, &error);
    if (error.status != status || strcmp(bvhd_vuid_string(error.vuid), vuid) != 0 || strcmp(error.where, where) != 0)
        fail_msg("%s instead of %s at %s: %s", bvhd_vuid_string(error.vuid), vuid, error.where, error.text);
    assert_int_equal(vulkan_input_entries(input)->geometry_count, 0);
    vulkan_input_destroy(input);
    assert_int_equal(memory.live, 0);
}

/* The structs are Vulkan's, whichever header declares them. */
static void structs_have_their_layout(void **state)
{
    (void)state;
#define OFFSETS(type)                                                                                                  \
    assert_int_equal(offsetof(type, sType), 0);                                                                        \
    assert_int_equal(offsetof(type, pNext), 8);                                                                        \
    assert_int_equal(offsetof(type, vertexFormat), 16);                                                                \
    assert_int_equal(offsetof(type, vertexData), 24);                                                                  \
    assert_int_equal(offsetof(type, vertexStride), 32);                                                                \
    assert_int_equal(offsetof(type, radiusFormat), 40);                                                                \
    assert_int_equal(offsetof(type, radiusData), 48);                                                                  \
    assert_int_equal(offsetof(type, radiusStride), 56);                                                                \
    assert_int_equal(offsetof(type, indexType), 64);                                                                   \
    assert_int_equal(offsetof(type, indexData), 72);                                                                   \
    assert_int_equal(offsetof(type, indexStride), 80)
    OFFSETS(VkAccelerationStructureGeometrySpheresDataNV);
    OFFSETS(VkAccelerationStructureGeometryLinearSweptSpheresDataNV);
#undef OFFSETS
    _Static_assert(sizeof(VkAccelerationStructureGeometrySpheresDataNV) == 88, "Vulkan's size");
    _Static_assert(sizeof(VkAccelerationStructureGeometryLinearSweptSpheresDataNV) == 96, "Vulkan's size");
    assert_int_equal(offsetof(VkAccelerationStructureGeometryLinearSweptSpheresDataNV, indexingMode), 88);
    assert_int_equal(offsetof(VkAccelerationStructureGeometryLinearSweptSpheresDataNV, endCapsMode), 92);
    assert_int_equal(VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV, 1000429009);
    assert_int_equal(VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV, 1000429010);
    assert_int_equal(VK_GEOMETRY_TYPE_SPHERES_NV, GEOMETRY_SPHERES);
    assert_int_equal(VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV, GEOMETRY_SWEPT_SPHERES);
    assert_int_equal(VK_RAY_TRACING_LSS_INDEXING_MODE_LIST_NV, SWEPT_LIST);
    assert_int_equal(VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV, SWEPT_SUCCESSIVE);
    assert_int_equal(VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV, SWEPT_CAPS_NONE);
    assert_int_equal(VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV, SWEPT_CAPS_CHAINED);
}

static void fields_are_converted(void **state)
{
    (void)state;
    struct call call;
    call_make(&call, SWEPT);
    call.swept.vertexFormat = VK_FORMAT_R16G16B16A16_SFLOAT;
    call.swept.vertexStride = 24;
    call.swept.radiusFormat = VK_FORMAT_R16_SFLOAT;
    call.swept.radiusStride = 6;
    call.swept.indexType = VK_INDEX_TYPE_UINT16;
    call.swept.indexStride = 10;
    call.swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV;
    call.swept.endCapsMode = VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV;
    call.range = (VkAccelerationStructureBuildRangeInfoKHR){5, 2, 3, 0};
    const struct geometry geometry = converted(&call);
    const struct geometry_spheres *ends = &geometry.swept_spheres.ends;
    assert_int_equal(geometry.type, GEOMETRY_SWEPT_SPHERES);
    assert_int_equal(geometry.flags, GEOMETRY_OPAQUE);
    assert_int_equal(geometry.range.primitive_count, 5);
    assert_int_equal(geometry.range.primitive_offset, 2);
    assert_int_equal(geometry.range.first_vertex, 3);
    assert_int_equal(geometry.swept_spheres.indexing_mode, SWEPT_SUCCESSIVE);
    assert_int_equal(geometry.swept_spheres.end_caps_mode, SWEPT_CAPS_CHAINED);
    assert_int_equal(ends->vertex_format, VK_FORMAT_R16G16B16A16_SFLOAT);
    assert_int_equal(ends->radius_format, VK_FORMAT_R16_SFLOAT);
    assert_int_equal(ends->index_type, INDEX_UINT16);
    assert_int_equal(ends->vertex_stride, 24);
    assert_int_equal(ends->radius_stride, 6);
    assert_int_equal(ends->index_stride, 10);
    assert_ptr_equal(ends->vertices.data, call.vertices);
    assert_ptr_equal(ends->radii.data, call.radii);
    assert_ptr_equal(ends->indices.data, call.indices);
}

static uint64_t larger(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

/* Where the last byte ends that primitives use of each array, found from one vertex after the other. */
struct ends {
    uint64_t vertices, radii, indices;
};

static void use_vertex(const struct call *call, uint64_t vertex, struct ends *ends)
{
    const VkAccelerationStructureGeometrySpheresDataNV *source = &call->spheres;
    const uint64_t offset = source->indexType == VK_INDEX_TYPE_NONE_KHR ? call->range.primitiveOffset : 0;
    vertex += call->range.firstVertex;
    ends->vertices = larger(ends->vertices, offset + vertex * source->vertexStride + 12);
    ends->radii = larger(ends->radii, offset + vertex * source->radiusStride +
                                          (source->radiusFormat == VK_FORMAT_R16_SFLOAT ? 2 : 4));
}

static uint32_t use_index(const struct call *call, uint64_t number, struct ends *ends)
{
    const VkAccelerationStructureGeometrySpheresDataNV *source = &call->spheres;
    const bool is_short = source->indexType == VK_INDEX_TYPE_UINT16;
    const uint64_t at = call->range.primitiveOffset + number * source->indexStride;
    ends->indices = larger(ends->indices, at + (is_short ? 2 : 4));
    return is_short ? bytes_get16(call->indices + at) : bytes_get32(call->indices + at);
}

/* What the spheres (mode 2), or the linear swept spheres of a mode, of call->spheres use. */
static struct ends used(const struct call *call, uint32_t mode)
{
    const bool indexed = call->spheres.indexType != VK_INDEX_TYPE_NONE_KHR;
    struct ends ends = {0};
    for (uint32_t i = 0; i < call->range.primitiveCount; i++) {
        const uint32_t count = mode == SWEPT_LIST ? 2 : 1;
        for (uint32_t k = 0; k < count; k++) {
            const uint64_t number = (uint64_t)count * i + k;
            const uint64_t vertex = indexed ? use_index(call, number, &ends) : number;
            use_vertex(call, vertex, &ends);
            if (mode == SWEPT_SUCCESSIVE)
                use_vertex(call, vertex + 1, &ends);
        }
    }
    return ends;
}

static uint32_t random_state = 1;

static uint32_t random_below(uint32_t limit)
{
    random_state = random_state * 1664525 + 1013904223;
    return (random_state >> 8) % limit;
}

static void call_make_random(struct call *call, uint32_t mode)
{
    static const VkIndexType types[] = {VK_INDEX_TYPE_UINT16, VK_INDEX_TYPE_UINT32, VK_INDEX_TYPE_NONE_KHR};
    call_make(call, mode < 2 ? SWEPT : VK_GEOMETRY_TYPE_SPHERES_NV);
    VkAccelerationStructureGeometrySpheresDataNV *spheres = &call->spheres;
    spheres->indexType = types[random_below(mode == SWEPT_SUCCESSIVE ? 2 : 3)];
    spheres->vertexStride = 4 * random_below(5);
    spheres->radiusFormat = random_below(2) ? VK_FORMAT_R32_SFLOAT : VK_FORMAT_R16_SFLOAT;
    spheres->radiusStride = 2 * random_below(5);
    spheres->indexStride = 2 * random_below(5);
    call->range = (VkAccelerationStructureBuildRangeInfoKHR){random_below(9), 4 * random_below(4), random_below(5), 0};
    for (int i = 0; i < BYTES; i += spheres->indexType == VK_INDEX_TYPE_UINT16 ? 2 : 4)
        call->indices[i] = (unsigned char)random_below(100);
    call->swept.indexingMode = (VkRayTracingLssIndexingModeNV)mode;
    const VkStructureType type = call->swept.sType;
    memcpy(&call->swept, spheres, sizeof *spheres);
    call->swept.sType = type;
}

static void arrays_reach_what_is_used(void **state)
{
    (void)state;
    for (int i = 0; i < 3000; i++) {
        struct call call;
        const uint32_t mode = random_below(MODES);
        call_make_random(&call, mode);
        const struct ends want = used(&call, mode);
        const struct geometry geometry = converted(&call);
        const struct geometry_spheres *spheres = mode < 2 ? &geometry.swept_spheres.ends : &geometry.spheres;
        assert_int_equal(spheres->vertices.size, want.vertices);
        assert_int_equal(spheres->radii.size, want.radii);
        assert_int_equal(spheres->indices.size, want.indices);
    }
}

/* The greatest numbers do not overflow: the arrays would be larger than an address space, and are empty. */
static void great_numbers_do_not_overflow(void **state)
{
    (void)state;
    struct call call;
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    memset(call.indices, 0xff, sizeof call.indices);
    call.spheres.vertexStride = UINT32_MAX;
    call.range.firstVertex = UINT32_MAX;
    const struct geometry spheres = converted(&call);
    assert_int_equal(spheres.spheres.vertices.size, 0);
    assert_int_equal(spheres.spheres.radii.size, 4 * (2 * (uint64_t)UINT32_MAX + 1));
    call_make(&call, SWEPT);
    memset(call.indices, 0xff, sizeof call.indices);
    call.swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV;
    const struct geometry swept = converted(&call);
    assert_int_equal(swept.swept_spheres.ends.radii.size, 4 * ((uint64_t)UINT32_MAX + 2));
}

/* Numbers, types and modes that break a rule lead to no memory: the addresses here belong to none. */
static void what_breaks_rules_is_not_read(void **state)
{
    (void)state;
    for (int i = 0; i < 7; i++) {
        struct call call;
        call_make(&call, SWEPT);
        call.swept.vertexData.hostAddress = call.swept.radiusData.hostAddress = call.swept.indexData.hostAddress =
            (const void *)(uintptr_t)NOWHERE;
        switch (i) {
        case 0:
            call.swept.indexType = (VkIndexType)1000265000; /* UINT8 */
            break;
        case 1:
            call.swept.indexStride = UINT64_MAX; /* beyond all memory */
            break;
        case 2:
            call.swept.indexingMode = (VkRayTracingLssIndexingModeNV)2;
            break;
        case 3:
            call.swept.indexType = VK_INDEX_TYPE_NONE_KHR;
            call.swept.indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV;
            break;
        case 4:
            call.range.primitiveCount = UINT32_MAX;
            break;
        case 5:
            call.range.primitiveCount = 0;
            break;
        default:
            call.swept.indexData.hostAddress = NULL;
        }
        const struct geometry geometry = converted(&call);
        assert_int_equal(geometry.swept_spheres.ends.vertices.size, 0);
        assert_int_equal(geometry.swept_spheres.ends.radii.size, 0);
        assert_int_equal(geometry.swept_spheres.ends.indices.size, 0);
    }
}

/* Vulkan has no rule about the strides of indices: two may be farther apart than vertices may. */
static void indices_may_be_far_apart(void **state)
{
    (void)state;
    const uint64_t stride = UINT64_C(1) << 32, size = stride + sizeof(uint32_t);
    struct call call;
    unsigned char *indices =
        mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    assert_true(indices != MAP_FAILED);
    bytes_put32(indices + stride, 3);
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    call.spheres.indexType = VK_INDEX_TYPE_UINT32;
    call.spheres.indexStride = stride;
    call.spheres.indexData.hostAddress = indices;
    call.range = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = 2};
    struct geometry geometry = converted(&call);
    assert_int_equal(geometry.spheres.indices.size, size);
    assert_int_equal(geometry.spheres.radii.size, 3 * call.spheres.radiusStride + 4);
    call.range.primitiveCount = 1;
    call.spheres.indexStride = UINT64_MAX;
    geometry = converted(&call);
    assert_int_equal(geometry.spheres.indices.size, 4);
    assert_int_equal(geometry.spheres.radii.size, 4);
    munmap(indices, size);
}

/* One array alone may break a rule, or be missing. */
static void arrays_are_judged_alone(void **state)
{
    (void)state;
    struct call call;
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    call.spheres.vertexFormat = VK_FORMAT_R8_UNORM;
    call.spheres.radiusStride = UINT64_C(1) << 32;
    struct geometry geometry = converted(&call);
    assert_int_equal(geometry.spheres.vertices.size, 0);
    assert_int_equal(geometry.spheres.radii.size, 0);
    assert_int_equal(geometry.spheres.indices.size, 20);
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    call.spheres.radiusFormat = VK_FORMAT_R8_UNORM;
    geometry = converted(&call);
    assert_int_equal(geometry.spheres.vertices.size, 12);
    assert_int_equal(geometry.spheres.radii.size, 0);
    call.spheres.indexType = VK_INDEX_TYPE_NONE_KHR; /* indices that are given against a rule are left to validation */
    geometry = converted(&call);
    assert_ptr_equal(geometry.spheres.indices.data, call.indices);
    assert_int_equal(geometry.spheres.indices.size, 0);
    call.spheres.radiusFormat = VK_FORMAT_R32_SFLOAT;
    call.spheres.radiusData.hostAddress = NULL;
    geometry = converted(&call);
    assert_null(geometry.spheres.radii.data);
    assert_int_equal(geometry.spheres.radii.size, 0);
}

static void structs_are_found_in_chains(void **state)
{
    (void)state;
    struct call call;
    for (int i = 0; i < 3; i++) {
        call_make(&call, i == 0 ? SWEPT : i == 1 ? VK_GEOMETRY_TYPE_SPHERES_NV : VK_GEOMETRY_TYPE_TRIANGLES_KHR);
        call.spheres.pNext = &call.swept;
        call.swept.radiusStride = 8;
        call.geometry.pNext = &call.spheres;
        call.geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexStride = 48,
            .indexType = VK_INDEX_TYPE_NONE_KHR,
        };
        const struct geometry geometry = converted(&call);
        if (i == 2)
            assert_int_equal(geometry.triangles.vertex_stride, 48);
        else
            assert_int_equal(geometry.spheres.radius_stride, i == 0 ? 8 : 4);
    }
}

static void chains_are_checked(void **state)
{
    (void)state;
    struct call call;
    const VkBaseInStructure micromap = {.sType = (VkStructureType)1000623002};
#define GEOMETRY_RULE "VUID-VkAccelerationStructureGeometryKHR-"
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    call.geometry.pNext = NULL;
    refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureGeometrySpheresDataNV-sType-sType",
           "infos[0].geometries[0].pNext");
    call.geometry.pNext = &call.swept;
    refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureGeometrySpheresDataNV-sType-sType",
           "infos[0].geometries[0].pNext");
    call.geometry.geometryType = SWEPT;
    call.geometry.pNext = &call.spheres;
    refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryLinearSweptSpheresDataNV-sType-sType",
           "infos[0].geometries[0].pNext");
    call.spheres.pNext = &call.spheres;
    refuse(&call, BVHD_INVALID, GEOMETRY_RULE "sType-unique", "infos[0].geometries[0].pNext");
    call.spheres.pNext = &call.swept;
    call.swept.pNext = &call.spheres;
    refuse(&call, BVHD_INVALID, GEOMETRY_RULE "sType-unique", "infos[0].geometries[0].pNext");
    call.swept.pNext = &micromap;
    refuse(&call, BVHD_UNSUPPORTED, "", "infos[0].geometries[0].pNext");
    call.swept.pNext = &call.info;
    refuse(&call, BVHD_INVALID, GEOMETRY_RULE "pNext-pNext", "infos[0].geometries[0].pNext");
    call.spheres.sType = 0;
    refuse(&call, BVHD_INVALID, GEOMETRY_RULE "pNext-pNext", "infos[0].geometries[0].pNext");
    /* A struct that belongs to the geometry does not belong to the build. */
    call_make(&call, VK_GEOMETRY_TYPE_SPHERES_NV);
    call.info.pNext = &call.spheres;
    refuse(&call, BVHD_INVALID, "VUID-VkAccelerationStructureBuildGeometryInfoKHR-pNext-pNext", "infos[0].pNext");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structs_have_their_layout),
        cmocka_unit_test(fields_are_converted),
        cmocka_unit_test(arrays_reach_what_is_used),
        cmocka_unit_test(great_numbers_do_not_overflow),
        cmocka_unit_test(what_breaks_rules_is_not_read),
        cmocka_unit_test(indices_may_be_far_apart),
        cmocka_unit_test(arrays_are_judged_alone),
        cmocka_unit_test(structs_are_found_in_chains),
        cmocka_unit_test(chains_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

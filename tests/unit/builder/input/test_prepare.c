/* SPDX-License-Identifier: Apache-2.0 */
/* test_prepare.c - tests that equal requests give equal canonical bytes, and that contents are checked. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/builder/inputs.h"
#include "tests/support/builder/prepare_bed.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "builder/input/vertex_format.h"

static void triangles_are_copied(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    struct canonical canonical = bed_make(&test);
    assert_int_equal(canonical.type, STRUCTURE_BOTTOM);
    assert_int_equal(canonical.geometry_count, 2);
    assert_int_equal(canonical.primitive_count, 5);
    assert_int_equal(canonical.vertex_count, 4 + 9);
    assert_int_equal(canonical.reference_count, 0);
    assert_int_equal(canonical.size % 16, 0);

    const struct canonical_geometry *geometry = canonical.geometries;
    static const uint32_t indices[6] = {0, 1, 2, 2, 1, 3};
    assert_int_equal(geometry->flags, GEOMETRY_OPAQUE);
    assert_int_equal(geometry->vertex_count, 4);
    assert_memory_equal(geometry->indices, indices, sizeof indices);
    for (int i = 0; i < 4; i++) {
        const float *p = test.vertices[i + 1], want[3] = {-2 * p[1] + 1, 2 * p[0] - 1, 0.5f * p[2] + 3};
        assert_memory_equal(geometry->positions + (ptrdiff_t)3 * i, want, sizeof want);
    }
    geometry++;
    assert_int_equal(geometry->first_primitive, 2);
    assert_int_equal(geometry->first_vertex, 4);
    assert_int_equal(geometry->vertex_count, 9);
    assert_null(geometry->indices);
    for (int i = 0; i < 9; i++)
        assert_memory_equal(geometry->positions + (ptrdiff_t)3 * i, test.vertices[i], 12);
    bed_finish(&canonical);
}

static void boxes_are_copied(void **state)
{
    (void)state;
    struct test_input test;
    float wide[INPUTS_BOXES][8];
    inputs_aabbs(&test);
    test.boxes[1][4] = NAN; /* makes the box inactive */
    test.boxes[1][3] = -3; /* would be invalid in an active box */
    struct canonical canonical = bed_make(&test);
    const float *boxes = canonical.geometries[0].boxes;
    assert_memory_equal(boxes, test.boxes[0], 24);
    assert_true(isnan(boxes[6]) && isnan(boxes[10]) && boxes[9] == -3);
    assert_memory_equal(boxes + 12, test.boxes[2], 24);
    bed_finish(&canonical);

    struct test_input spread;
    inputs_aabbs(&spread);
    memcpy(spread.boxes, test.boxes, sizeof test.boxes);
    for (int i = 0; i < INPUTS_BOXES; i++)
        memcpy(wide[i], test.boxes[i], 24);
    spread.geometries[0].aabbs.boxes = (struct bytes){(const unsigned char *)wide, sizeof wide - 8};
    spread.geometries[0].aabbs.stride = 32;
    bed_compare(&test, &spread, true);
    spread.geometries[0].aabbs.stride = 0;
    canonical = bed_make(&spread);
    for (int i = 0; i < INPUTS_BOXES; i++)
        assert_memory_equal(canonical.geometries[0].boxes + (ptrdiff_t)6 * i, test.boxes[0], 24);
    bed_finish(&canonical);
}

/* Strides, offsets, first vertices, maxVertex and index widths do not change the bytes. */
static void layout_of_input_does_not_count(void **state)
{
    (void)state;
    struct test_input test, other;
    inputs_triangles(&test);
    static float loose[200];
    static uint32_t wide[20];
    for (uint32_t words = 3; words < 9; words++)
        for (uint32_t first = 0; first < 3; first++) {
            inputs_triangles(&other);
            for (uint32_t i = 0; i < 9; i++)
                memcpy(loose + (i + first) * words, test.vertices[i], 12);
            for (int i = 0; i < 6; i++)
                wide[i + 5] = test.indices[i + 2];
            struct geometry_triangles *triangles = &other.geometries[0].triangles;
            triangles->vertices = (struct bytes){(const unsigned char *)loose, ((first + 4) * words + 3) * 4};
            triangles->vertex_stride = 4 * words;
            triangles->max_vertex = first + 4 + words % 2 * 1000;
            triangles->index_type = INDEX_UINT32;
            triangles->indices = (struct bytes){(const unsigned char *)wide, sizeof wide};
            other.geometries[0].range.first_vertex = first + 1;
            other.geometries[0].range.primitive_offset = 20;

            triangles = &other.geometries[1].triangles;
            triangles->vertices = (struct bytes){(const unsigned char *)loose, ((first + 8) * words + 3) * 4};
            triangles->vertex_stride = 4 * words;
            triangles->max_vertex = UINT32_MAX;
            other.geometries[1].range.first_vertex = first ? first - 1 : 0;
            other.geometries[1].range.primitive_offset = first ? 4 * words : 0;
            bed_compare(&test, &other, true);
            loose[(first + 2) * words + 1] += 1;
            bed_compare(&test, &other, false);
        }
}

/* Indices that start anywhere in a large array keep only the span of vertices that they use. */
static void only_the_span_in_use_is_kept(void **state)
{
    (void)state;
    enum { FROM = 1000 };
    static float many[FROM + 9][3];
    static uint32_t indices[6];
    struct test_input test, other;
    inputs_triangles(&test);
    inputs_triangles(&other);
    for (int i = 0; i < 4; i++)
        memcpy(many[FROM + i], test.vertices[i + 1], sizeof *many);
    for (int i = 0; i < 6; i++)
        indices[i] = FROM + test.indices[i + 2];
    struct geometry_triangles *triangles = &other.geometries[0].triangles;
    triangles->vertices = (struct bytes){(const unsigned char *)many, sizeof many};
    triangles->vertex_stride = sizeof *many;
    triangles->max_vertex = FROM + 8;
    triangles->index_type = INDEX_UINT32;
    triangles->indices = (struct bytes){(const unsigned char *)indices, sizeof indices};
    other.geometries[0].range.first_vertex = 0;
    other.geometries[0].range.primitive_offset = 0;
    bed_compare(&test, &other, true);

    /* Fields that updates compare make them different. */
    test.input.flags |= BUILD_ALLOW_UPDATE;
    other.input.flags |= BUILD_ALLOW_UPDATE;
    test.geometries[0].triangles.max_vertex = triangles->max_vertex;
    bed_compare(&test, &other, false);
}

/* Positions that several formats can express give the same bytes in each of them. */
static void formats_of_equal_value_do_not_count(void **state)
{
    (void)state;
    static const int values[9][3] = {{0, 1, 0},  {1, 0, 0},  {0, 0, 0},  {1, 1, 0},  {-1, 0, 0},
                                     {0, -1, 0}, {1, -1, 0}, {-1, 1, 0}, {-1, -1, 0}};
    static const uint16_t halves[3] = {0xbc00, 0, 0x3c00};
    struct test_input test, other;
    inputs_triangles(&test);
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < 3; k++)
            test.vertices[i][k] = (float)values[i][k];
    uint32_t count;
    const struct vertex_format *formats = vertex_formats(&count);
    for (uint32_t f = 0; f < count; f++) {
        static uint64_t data[9][4];
        memset(data, 0, sizeof data);
        bool negative = !strstr(formats[f].name, "UNORM"),
             half = strstr(formats[f].name, "16") && strstr(formats[f].name, "SFLOAT");
        for (int i = 0; i < 9; i++)
            for (int k = 0; k < 3; k++) {
                int value = values[i][k];
                unsigned char *at = (unsigned char *)data[i] + (uint32_t)k * formats[f].alignment;
                if (strstr(formats[f].name, "R64"))
                    memcpy(at, &(double){value}, 8);
                else if (strstr(formats[f].name, "R32"))
                    memcpy(at, &(float){(float)value}, 4);
                else if (half)
                    memcpy(at, &halves[value + 1], 2);
                else if (strstr(formats[f].name, "R16"))
                    memcpy(at, &(uint16_t){(uint16_t)(negative ? value * 32767 : value > 0 ? 65535 : 0)}, 2);
                else if (strstr(formats[f].name, "R8"))
                    *at = (unsigned char)(negative ? value * 127 : value > 0 ? 255 : 0);
                else if (value > 0)
                    data[i][0] |= UINT64_C(1023) << 10 * k;
            }
        struct test_input reference = test;
        reference.input.geometries = reference.geometries;
        for (int g = 0; g < 2; g++)
            reference.geometries[g].triangles.vertices.data = (const unsigned char *)reference.vertices;
        for (int i = 0; i < 9 && !negative; i++)
            for (int k = 0; k < 3; k++)
                reference.vertices[i][k] = values[i][k] > 0 ? 1 : 0;
        other = test;
        other.input.geometries = other.geometries;
        for (int g = 0; g < 2; g++) {
            other.geometries[g].triangles.vertex_format = formats[f].format;
            other.geometries[g].triangles.vertex_stride = 32;
            other.geometries[g].triangles.vertices = (struct bytes){(const unsigned char *)data, sizeof data};
        }
        bed_compare(&reference, &other, true);
    }
}

static void stride_zero_keeps_one_vertex(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    for (int g = 0; g < 2; g++) {
        test.geometries[g].triangles.vertex_stride = 0;
        test.geometries[g].triangles.vertices.size = 12;
    }
    struct canonical canonical = bed_make(&test);
    for (int g = 0; g < 2; g++) {
        const struct canonical_geometry *geometry = &canonical.geometries[g];
        assert_int_equal(geometry->vertex_count, 1);
        for (uint32_t i = 0; i < 3 * geometry->primitive_count; i++)
            assert_int_equal(geometry->indices[i], 0);
    }
    assert_memory_equal(canonical.geometries[1].positions, test.vertices[0], 12);
    bed_finish(&canonical);
    test.geometries[0].triangles.max_vertex = 3;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildRangeInfoKHR-maxVertex-10774",
               "infos[2].geometries[0].triangles.indices[5]");
}

static void what_counts_changes_the_bytes(void **state)
{
    (void)state;
    struct test_input test, other;
    inputs_triangles(&test);
#define DIFFERS(equal, ...)                                                                                            \
    do {                                                                                                               \
        inputs_triangles(&other);                                                                                      \
        other.input.flags = test.input.flags;                                                                          \
        __VA_ARGS__;                                                                                                   \
        bed_compare(&test, &other, equal);                                                                             \
    } while (0)
    for (test.input.flags = 0; test.input.flags <= BUILD_ALLOW_UPDATE; test.input.flags++) {
        bool update = test.input.flags & BUILD_ALLOW_UPDATE;
        static const float identity[16] = {0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -0.0f, 0, 0, 1, 0};
        DIFFERS(true, (void)0);
        DIFFERS(true, other.geometries[0].triangles.vertices.size -= 5; other.input.destination = 9);
        DIFFERS(false, other.input.flags ^= BUILD_ALLOW_UPDATE);
        DIFFERS(false, other.input.flags ^= BUILD_LOW_MEMORY);
        DIFFERS(false, other.geometries[1].flags = GEOMETRY_NO_DUPLICATE_ANY_HIT);
        DIFFERS(false, other.indices[4] = 1);
        DIFFERS(false, other.vertices[2][2] += 1);
        DIFFERS(false, other.geometries[1].range.primitive_count--);
        DIFFERS(false, other.input.geometry_count--);
        DIFFERS(false, other.transform[7] += 1);
        DIFFERS(false, other.vertices[5][1] = -0.0f);
        /* fields that only updates compare */
        DIFFERS(!update, other.geometries[0].triangles.max_vertex++);
        DIFFERS(!update, other.geometries[1].triangles.transform = (struct bytes){(const unsigned char *)identity, 64};
                other.geometries[1].range.transform_offset = 16);
        DIFFERS(!update, other.geometries[1].triangles.vertex_format = 109);
    }
#undef DIFFERS
}

static void contents_are_checked(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.indices[5] = 8;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildRangeInfoKHR-maxVertex-10774",
               "infos[2].geometries[0].triangles.indices[3]");
    inputs_triangles(&test);
    test.geometries[0].triangles.vertices.size = 4 * 20 + 11;
    bed_refuse(&test, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03771",
               "infos[2].geometries[0].triangles.vertexData");
    inputs_triangles(&test);
    test.transform[14] = 0;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799",
               "infos[2].geometries[0].triangles.transformData");
    test.transform[14] = NAN;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799",
               "infos[2].geometries[0].triangles.transformData");
    inputs_triangles(&test);
    test.geometries[0].range.first_vertex = UINT32_MAX;
    test.geometries[0].triangles.max_vertex = UINT32_MAX;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildRangeInfoKHR-maxVertex-10774",
               "infos[2].geometries[0].triangles.indices[1]");

    static const char *const rules[3] = {"VUID-VkAabbPositionsKHR-minX-03546", "VUID-VkAabbPositionsKHR-minY-03547",
                                         "VUID-VkAabbPositionsKHR-minZ-03548"};
    static const char *const places[3] = {"infos[2].geometries[0].aabbs[1].minX",
                                          "infos[2].geometries[0].aabbs[1].minY",
                                          "infos[2].geometries[0].aabbs[1].minZ"};
    for (int axis = 0; axis < 3; axis++) {
        inputs_aabbs(&test);
        test.boxes[1][axis] = -0.5f;
        bed_refuse(&test, BVHD_INVALID, rules[axis], places[axis]);
    }
    inputs_instances(&test);
    test.records[2][14] = 56;
    bed_refuse(&test, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-03779",
               "infos[2].geometries[0].instances[2].accelerationStructureReference");
    inputs_instances(&test);
    memcpy(test.records[3], (uint32_t[4]){0}, 16);
    bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799",
               "infos[2].geometries[0].instances[3].transform");
    inputs_instances(&test);
    test.records[3][5] = 0x7fc00000;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799",
               "infos[2].geometries[0].instances[3].transform");
    for (uint32_t flags = 0; flags < 256; flags++) {
        inputs_instances(&test);
        test.records[1][13] = flags << 24 | 5;
        bool own = flags < 16 && (flags & 12) != 12;
        const char *rule = flags < 64 && flags & 0x30 ? "" : "VUID-VkAccelerationStructureInstanceKHR-flags-parameter";
        if (!own) {
            bed_refuse(&test, *rule ? BVHD_INVALID : BVHD_UNSUPPORTED, rule,
                       "infos[2].geometries[0].instances[1].flags");
            continue;
        }
        struct canonical canonical = bed_make(&test);
        assert_int_equal(canonical_instance(canonical.geometries, 1).flags, flags);
        bed_finish(&canonical);
    }
    inputs_instances(&test);
    /* The transform of an inactive instance is not checked. */
    memset(test.records[1], 0xff, 48);
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
}

static void radii_are_checked(void **state)
{
    (void)state;
    struct test_input test;
    inputs_spheres(&test);
    test.vertices[3][3] = -0.25f; /* which indices 3 and 4 name */
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureGeometrySpheresDataNV-radiusData-10436",
               "infos[2].geometries[0].spheres[2].radius");
    inputs_spheres(&test);
    test.vertices[8][3] = -INFINITY; /* which no sphere has */
    test.vertices[2][3] = -0.0f;
    test.vertices[1][3] = NAN;
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
    inputs_swept_spheres(&test);
    test.vertices[5][3] = -FLT_MIN;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureGeometryLinearSweptSpheresDataNV-radiusData-10426",
               "infos[2].geometries[0].linearSweptSpheres[5].radii[1]");
}

/* Indices may name any vertex that is there; which are not is known when all have been read. */
static void named_spheres_are_there(void **state)
{
    (void)state;
    struct test_input test;
    inputs_spheres(&test);
    test.indices[5] = 8;
    bed_refuse(&test, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-11824",
               "infos[2].geometries[0].spheres.indices[3]");
    inputs_spheres(&test);
    test.geometries[0].spheres.radii.size = 4 * 20 + 3;
    bed_refuse(&test, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-11825",
               "infos[2].geometries[0].spheres.indices[5]");
    inputs_swept_spheres(&test);
    test.indices[3] = 7; /* its second end would be vertex 9 */
    bed_refuse(&test, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-11828",
               "infos[2].geometries[0].linearSweptSpheres.indices[1]");
    test.indices[3] = 6;
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
}

static void empty_structures_are_small(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.geometries[0].range.primitive_count = test.geometries[1].range.primitive_count = 0;
    struct canonical canonical = bed_make(&test);
    assert_int_equal(canonical.primitive_count, 0);
    assert_int_equal(canonical.size, 64 + 2 * 64);
    assert_null(canonical.geometries[0].positions);
    assert_null(canonical.geometries[0].indices);
    bed_finish(&canonical);
    test.input.geometry_count = 0;
    canonical = bed_make(&test);
    assert_int_equal(canonical.size, 64);
    bed_finish(&canonical);
    inputs_instances(&test);
    test.geometries[0].range.primitive_count = 0;
    canonical = bed_make(&test);
    assert_int_equal(canonical.reference_count, 0);
    bed_finish(&canonical);
}

/* Makes a copy of 2,000 triangles over the vertices below `used`, of `given` ones. */
static struct canonical make_span(uint32_t used, uint32_t given)
{
    enum { TRIANGLES = 2000, MOST = 6000 };
    static float vertices[MOST][3];
    static uint32_t indices[3 * TRIANGLES];
    struct test_input test;
    inputs_start(&test, STRUCTURE_BOTTOM, 1);
    for (uint32_t i = 0; i < 3 * TRIANGLES; i++)
        indices[i] = i % used;
    test.geometries[0] = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = given - 1,
                      .vertex_stride = sizeof *vertices,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)vertices, given * sizeof *vertices},
                      .indices = {(const unsigned char *)indices, sizeof indices}},
        .range = {.primitive_count = TRIANGLES},
    };
    return bed_make(&test);
}

/* The copy has room for all positions at first; what is not needed is given back. */
static void unused_room_is_given_back(void **state)
{
    enum { TABLES = 1024 };
    (void)state;
    static const uint32_t used[] = {3, 100, 1000, 5999, 6000};
    for (size_t i = 0; i < sizeof used / sizeof *used; i++) {
        struct canonical canonical = make_span(used[i], 6000);
        assert_int_equal(canonical.vertex_count, used[i]);
        assert_true(bed_memory.live <= canonical.size + canonical.size / 8 + TABLES);
        bed_finish(&canonical);
    }
}

/* A copy whose room was known at once never lies in memory twice. */
static void known_room_is_taken_once(void **state)
{
    enum { TABLES = 1024 };
    (void)state;
    atomic_store(&bed_memory.peak, 0);
    struct canonical canonical = make_span(6000, 6000);
    assert_true(bed_memory.peak <= canonical.size + 2 * TABLES);
    bed_finish(&canonical);
}

static void limits_are_kept(void **state)
{
    (void)state;
    struct test_input test;
    struct canonical canonical;
    struct bvhd_error error;
    void (*const kinds[3])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances};
    for (int kind = 0; kind < 3; kind++) {
        struct limits limits = limits_default();
        kinds[kind](&test);
        canonical = bed_make(&test);
        uint64_t size = canonical.size;
        bed_finish(&canonical);
        for (limits.max_canonical_bytes = 0; limits.max_canonical_bytes < size; limits.max_canonical_bytes++) {
            assert_int_equal(prepare(&test.input, 7, &limits, &bed_context, &canonical, &error), BVHD_TOO_LARGE);
            assert_string_equal(error.where, "infos[7]");
            assert_int_equal(bed_memory.live, 0);
        }
        assert_int_equal(prepare(&test.input, 7, &limits, &bed_context, &canonical, &error), BVHD_OK);
        bed_finish(&canonical);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct test_input test;
    struct canonical canonical;
    struct bvhd_error error;
    void (*const kinds[3])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances};
    for (int kind = 0; kind < 3; kind++) {
        kinds[kind](&test);
        int failures = 0;
        for (enum bvhd_status status = BVHD_NO_MEMORY; status != BVHD_OK; failures++) {
            atomic_store(&bed_memory.fail_after, failures);
            status = bed_try(&test, &canonical, &error);
            if (status != BVHD_OK) {
                assert_int_equal(status, BVHD_NO_MEMORY);
                assert_int_equal(error.status, BVHD_NO_MEMORY);
                assert_int_equal(bed_memory.live, 0);
            }
        }
        atomic_store(&bed_memory.fail_after, -1);
        assert_true(failures > 4);
        bed_finish(&canonical);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_are_copied),
        cmocka_unit_test(boxes_are_copied),
        cmocka_unit_test(layout_of_input_does_not_count),
        cmocka_unit_test(only_the_span_in_use_is_kept),
        cmocka_unit_test(formats_of_equal_value_do_not_count),
        cmocka_unit_test(stride_zero_keeps_one_vertex),
        cmocka_unit_test(what_counts_changes_the_bytes),
        cmocka_unit_test(contents_are_checked),
        cmocka_unit_test(radii_are_checked),
        cmocka_unit_test(named_spheres_are_there),
        cmocka_unit_test(empty_structures_are_small),
        cmocka_unit_test(unused_room_is_given_back),
        cmocka_unit_test(known_room_is_taken_once),
        cmocka_unit_test(limits_are_kept),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_kind.c - tests that each kind of geometry is found, counts its vertices and refuses wrong shapes. */
#include "tests/support/unit.h"

#include "proto/base/kind.h"
#include "proto/base/validate_shape.h"

static void every_type_has_one_kind(void **state)
{
    (void)state;
    static const uint32_t types[KIND_COUNT] = {GEOMETRY_TRIANGLES, GEOMETRY_AABBS, GEOMETRY_INSTANCES};
    for (int i = 0; i < KIND_COUNT; i++) {
        const struct kind *kind = kind_find(types[i]);
        assert_non_null(kind);
        assert_int_equal(kind->number, i);
        assert_int_equal(kind->type, types[i]);
        assert_int_equal(kind->is_top, types[i] == GEOMETRY_INSTANCES);
    }
    static const uint32_t foreign[] = {3, 1000429004, 1000429005, 1000478000, UINT32_MAX};
    for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++)
        assert_null(kind_find(foreign[i]));
}

/* Vertices are those of the arrays that the caller describes, whether or not they are there. */
static void vertices_are_counted(void **state)
{
    (void)state;
    static const struct {
        uint32_t count, index_type, max_vertex;
        uint64_t stride, bytes, vertices;
    } cases[] = {
        {0, INDEX_NONE, 100, 12, 1200, 0},
        {5, INDEX_UINT32, UINT32_MAX, 0, 12, 1},
        {5, INDEX_NONE, 14, 12, 180, 15},
        {UINT32_MAX, INDEX_NONE, 0, 12, 0, 3 * (uint64_t)UINT32_MAX},
        {5, INDEX_UINT16, 9, 12, 120, 10},
        {5, INDEX_UINT32, 9, 12, 108, 10}, /* the last vertex may end before its stride does */
        {5, INDEX_UINT32, UINT32_MAX, 12, 120, 11},
        {5, INDEX_UINT32, UINT32_MAX, 1, UINT64_MAX, UINT64_C(1) << 32},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                    .triangles = {.max_vertex = cases[i].max_vertex,
                                                  .vertex_stride = cases[i].stride,
                                                  .index_type = cases[i].index_type,
                                                  .vertices = {NULL, cases[i].bytes}},
                                    .range = {.primitive_count = cases[i].count}};
        if (kind_find(GEOMETRY_TRIANGLES)->vertices(&geometry) != cases[i].vertices)
            fail_msg("case %zu", i);
        assert_int_equal(kind_find(GEOMETRY_AABBS)->vertices(&geometry), 0);
        assert_int_equal(kind_find(GEOMETRY_INSTANCES)->vertices(&geometry), 0);
    }
}

/* Checks the shape of a geometry twice: with its strides, and without. */
static void expect(const struct geometry *geometry, enum bvhd_vuid with_strides, enum bvhd_vuid without)
{
    struct bvhd_error error = {.status = BVHD_OK, .vuid = BVHD_VUID_NONE};
    struct validate_subject subject = {geometry, 1, 2, &error, .ignores_strides = false};
    const struct kind *kind = kind_find(geometry->type);
    char prefix[64];
    assert_int_equal(kind->check_shape(&subject), with_strides == BVHD_VUID_NONE ? BVHD_OK : BVHD_INVALID);
    assert_int_equal(error.vuid, with_strides);
    snprintf(prefix, sizeof prefix, "infos[1].geometries[2].%s.", kind->member);
    if (with_strides != BVHD_VUID_NONE)
        assert_memory_equal(error.where, prefix, strlen(prefix));
    error = (struct bvhd_error){.status = BVHD_OK, .vuid = BVHD_VUID_NONE};
    subject.ignores_strides = true;
    assert_int_equal(kind->check_shape(&subject), without == BVHD_VUID_NONE ? BVHD_OK : BVHD_INVALID);
    assert_int_equal(error.vuid, without);
}

static void wrong_shapes_are_refused(void **state)
{
    (void)state;
    struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106, .vertex_stride = 12, .index_type = INDEX_UINT32},
    };
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.triangles.index_type = 4711;
    expect(&geometry, BVHD_VUID_TrianglesData_indexType_parameter, BVHD_VUID_TrianglesData_indexType_parameter);
    geometry.triangles.vertex_stride = 13;
    expect(&geometry, BVHD_VUID_03735, BVHD_VUID_TrianglesData_indexType_parameter);
    geometry.triangles.vertex_stride = UINT64_C(1) << 32;
    expect(&geometry, BVHD_VUID_03819, BVHD_VUID_TrianglesData_indexType_parameter);
    geometry.triangles.vertex_format = 98;
    expect(&geometry, BVHD_VUID_03797, BVHD_VUID_03797);
    geometry = (struct geometry){.type = GEOMETRY_AABBS, .aabbs = {.stride = 24}};
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.aabbs.stride = 28;
    expect(&geometry, BVHD_VUID_03545, BVHD_VUID_NONE);
    geometry.aabbs.stride = UINT64_C(1) << 32;
    expect(&geometry, BVHD_VUID_03820, BVHD_VUID_NONE);
    geometry = (struct geometry){.type = GEOMETRY_INSTANCES};
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_has_one_kind),
        cmocka_unit_test(vertices_are_counted),
        cmocka_unit_test(wrong_shapes_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

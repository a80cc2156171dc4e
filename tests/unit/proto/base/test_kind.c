/* SPDX-License-Identifier: Apache-2.0 */
/* test_kind.c - tests that each kind of geometry is found, counts its vertices and refuses wrong shapes. */
#include "tests/support/unit.h"

#include "proto/base/kind.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vertex_element.h"

static void every_type_has_one_kind(void **state)
{
    (void)state;
    static const uint32_t types[KIND_COUNT] = {
        GEOMETRY_TRIANGLES,        GEOMETRY_AABBS,         GEOMETRY_INSTANCES,
        GEOMETRY_SPHERES,          GEOMETRY_SWEPT_SPHERES, GEOMETRY_MOVING_TRIANGLES,
        GEOMETRY_MOVING_INSTANCES, GEOMETRY_MICROMAP,      GEOMETRY_BAKED_MICROMAP};
    static const uint32_t vulkan_types[KIND_COUNT] = {0, 1, 2, 1000429004, 1000429005, 0, 2, 1000623000, 1000623000};
    for (int i = 0; i < KIND_COUNT; i++) {
        const struct kind *kind = kind_find(types[i]);
        assert_non_null(kind);
        assert_int_equal(kind->number, i);
        assert_int_equal(kind->type, types[i]);
        assert_int_equal(kind->vulkan_type, vulkan_types[i]);
        assert_int_equal(kind->is_top, vulkan_types[i] == GEOMETRY_INSTANCES);
        assert_int_equal(kind->moves, i == KIND_MOVING_TRIANGLES || i == KIND_MOVING_INSTANCES);
        assert_int_equal(kind->is_micromap, i >= KIND_OF_RAYS);
    }
    assert_ptr_equal(kind_find_vulkan(1000623000, false), kind_find(GEOMETRY_MICROMAP));
    static const uint32_t foreign[] = {3, 1000429003, 1000429006, 1000478000, UINT32_MAX};
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
        assert_int_equal(kind_find(GEOMETRY_MOVING_TRIANGLES)->vertices(&geometry), cases[i].vertices);
        assert_int_equal(kind_find(GEOMETRY_MOVING_INSTANCES)->vertices(&geometry), 0);
        assert_int_equal(kind_find(GEOMETRY_AABBS)->vertices(&geometry), 0);
        assert_int_equal(kind_find(GEOMETRY_INSTANCES)->vertices(&geometry), 0);
    }
}

static struct geometry make_spheres(uint32_t index_type)
{
    return (struct geometry){
        .type = GEOMETRY_SPHERES,
        .spheres = {.vertex_format = 106,
                    .radius_format = RADIUS_FLOAT32,
                    .index_type = index_type,
                    .vertex_stride = 12,
                    .radius_stride = 4,
                    .vertices = {NULL, 1200},
                    .radii = {NULL, 400}},
    };
}

static struct geometry make_swept(uint32_t index_type, uint32_t mode)
{
    struct geometry geometry = {.type = GEOMETRY_SWEPT_SPHERES};
    geometry.swept_spheres.ends = make_spheres(index_type).spheres;
    geometry.swept_spheres.indexing_mode = mode;
    return geometry;
}

static void expect_vertices(struct geometry geometry, uint32_t count, uint64_t vertices)
{
    geometry.range.primitive_count = count;
    assert_int_equal(kind_find(geometry.type)->vertices(&geometry), vertices);
}

static void vertices_of_spheres_are_counted(void **state)
{
    (void)state;
    struct geometry geometry = make_spheres(INDEX_NONE);
    expect_vertices(geometry, 0, 0);
    expect_vertices(geometry, 7, 7);
    expect_vertices(geometry, UINT32_MAX, UINT32_MAX);
    geometry.spheres.radius_stride = geometry.spheres.vertex_stride = 0;
    expect_vertices(geometry, 7, 1);
    geometry = make_spheres(INDEX_UINT32);
    expect_vertices(geometry, 0, 0);
    expect_vertices(geometry, 7, 100);
    geometry.spheres.radii.size = 197; /* the last radius may end before its stride does */
    expect_vertices(geometry, 7, 50);
    geometry.spheres.radius_stride = 0;
    expect_vertices(geometry, 7, 100);
    geometry.spheres.vertex_stride = 0;
    expect_vertices(geometry, 7, 1);
    geometry.spheres.radius_stride = 1;
    expect_vertices(geometry, 7, 197);
    geometry.spheres.radii.size = UINT64_MAX;
    expect_vertices(geometry, 7, UINT64_C(1) << 32);
    geometry.spheres.index_type = INDEX_UINT16;
    expect_vertices(geometry, 7, 1 << 16);
}

static void ends_of_swept_spheres_are_counted(void **state)
{
    (void)state;
    expect_vertices(make_swept(INDEX_NONE, SWEPT_LIST), 0, 0);
    expect_vertices(make_swept(INDEX_NONE, SWEPT_LIST), UINT32_MAX, 2 * (uint64_t)UINT32_MAX);
    expect_vertices(make_swept(INDEX_UINT16, SWEPT_LIST), 1000, 2000);
    expect_vertices(make_swept(INDEX_UINT32, SWEPT_SUCCESSIVE), 0, 0);
    expect_vertices(make_swept(INDEX_UINT32, SWEPT_SUCCESSIVE), 1000, 101);
    struct geometry geometry = make_swept(INDEX_UINT32, SWEPT_LIST);
    geometry.swept_spheres.ends.vertex_stride = 0;
    expect_vertices(geometry, 1000, 2000);
    geometry.swept_spheres.ends.radius_stride = 0;
    expect_vertices(geometry, 1000, 2);
    expect_vertices(geometry, 0, 0);
    geometry.swept_spheres.indexing_mode = SWEPT_SUCCESSIVE;
    expect_vertices(geometry, 1000, 2);
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

static void expect_wrong_triangles(uint32_t type)
{
    struct geometry geometry = {
        .type = type,
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
}

static void wrong_shapes_are_refused(void **state)
{
    (void)state;
    expect_wrong_triangles(GEOMETRY_TRIANGLES);
    expect_wrong_triangles(GEOMETRY_MOVING_TRIANGLES);
    struct geometry geometry = {.type = GEOMETRY_AABBS, .aabbs = {.stride = 24}};
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.aabbs.stride = 28;
    expect(&geometry, BVHD_VUID_03545, BVHD_VUID_NONE);
    geometry.aabbs.stride = UINT64_C(1) << 32;
    expect(&geometry, BVHD_VUID_03820, BVHD_VUID_NONE);
    geometry = (struct geometry){.type = GEOMETRY_INSTANCES};
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.type = GEOMETRY_MOVING_INSTANCES;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
}

static void wrong_micromaps_are_refused(void **state)
{
    (void)state;
    struct geometry geometry = {.type = GEOMETRY_MICROMAP, .micromap = {.stride = 8, .states = {NULL, 77}}};
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    assert_int_equal(kind_find(GEOMETRY_MICROMAP)->vertices(&geometry), 77);
    geometry.micromap.stride = 12;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.micromap.stride = UINT64_C(1) << 40;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.micromap.stride = 4;
    expect(&geometry, BVHD_VUID_11646, BVHD_VUID_NONE);
    geometry.micromap.stride = 10;
    expect(&geometry, BVHD_VUID_11647, BVHD_VUID_NONE);
}

static void wrong_indices_of_micromaps_are_refused(void **state)
{
    (void)state;
    for (int is_ext = 0; is_ext < 2; is_ext++) {
        struct geometry geometry = {
            .type = GEOMETRY_MOVING_TRIANGLES,
            .triangles = {.vertex_format = 106, .vertex_stride = 12, .index_type = INDEX_UINT32},
        };
        struct triangle_micromap *micromap = &geometry.triangles.micromap;
        const enum bvhd_vuid type = is_ext ? BVHD_VUID_10719 : BVHD_VUID_11570;
        micromap->index_type = 4711;
        expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE); /* it is not given */
        micromap->is_given = 1;
        micromap->has_usages = (uint32_t)is_ext;
        expect(&geometry, type, type);
        micromap->index_type = INDEX_UINT8;
        micromap->stride = 3;
        expect(&geometry, is_ext ? type : BVHD_VUID_NONE, is_ext ? type : BVHD_VUID_NONE);
        micromap->index_type = INDEX_UINT16;
        expect(&geometry, is_ext ? BVHD_VUID_10722 : BVHD_VUID_11573, BVHD_VUID_NONE);
        micromap->stride = 0;
        expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
        micromap->index_type = INDEX_UINT32;
        micromap->stride = UINT64_C(1) << 32;
        expect(&geometry, is_ext ? BVHD_VUID_10723 : BVHD_VUID_11574, BVHD_VUID_NONE);
        micromap->stride = UINT32_MAX - 3;
        expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
        micromap->index_type = INDEX_NONE;
        micromap->stride = UINT64_MAX;
        expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    }
}

/* Expects that a bake is refused for one field, without a rule's number. */
static void expect_bake(const struct geometry *geometry, const char *field)
{
    struct bvhd_error error = {.status = BVHD_OK};
    const struct validate_subject subject = {geometry, 1, 2, &error, .ignores_strides = false};
    char where[64];
    snprintf(where, sizeof where, "infos[1].geometries[2].bake.%s", field);
    assert_int_equal(kind_find(GEOMETRY_BAKED_MICROMAP)->check_shape(&subject), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_NONE);
    assert_string_equal(error.where, where);
}

static void wrong_bakes_are_refused(void **state)
{
    (void)state;
    const struct geometry good = {.type = GEOMETRY_BAKED_MICROMAP,
                                  .bake = {.width = 16384,
                                           .height = 1,
                                           .row_stride = 16384,
                                           .wrap_u = BAKE_CLAMP_TO_EDGE,
                                           .is_nearest = 1,
                                           .cutoff = 1,
                                           .format = 2,
                                           .level = BAKE_LEVEL_AUTO,
                                           .coordinate_stride = 8,
                                           .vertex_count = 5,
                                           .index_type = INDEX_NONE}};
    struct geometry geometry = good;
    expect(&good, BVHD_VUID_NONE, BVHD_VUID_NONE);
    assert_int_equal(kind_find(GEOMETRY_BAKED_MICROMAP)->vertices(&good), 16384 + 40);
#define BREAK(member, value, name)                                                                                     \
    do {                                                                                                               \
        geometry = good;                                                                                               \
        geometry.bake.member = value;                                                                                  \
        expect_bake(&geometry, name);                                                                                  \
    } while (0)
    BREAK(width, 0, "width");
    BREAK(width, 16385, "width");
    BREAK(height, 0, "height");
    BREAK(wrap_u, 3, "wrapU");
    BREAK(wrap_v, UINT32_MAX, "wrapV");
    BREAK(is_nearest, 2, "isNearest");
    BREAK(mode, 2, "mode");
    BREAK(format, 0, "format");
    BREAK(format, 3, "format");
    BREAK(level, 13, "level");
    BREAK(cutoff, -0.5f, "cutoff");
    BREAK(cutoff, __builtin_nanf(""), "cutoff");
    BREAK(index_type, INDEX_UINT8, "indexType");
    BREAK(row_stride, 16383, "rowStride");
    BREAK(row_stride, UINT64_C(1) << 32, "rowStride");
    BREAK(coordinate_stride, 6, "coordinateStride");
#undef BREAK
    geometry = good;
    geometry.bake.mode = BAKE_BLEND;
    geometry.bake.cutoff = -1; /* BLEND has no cutoff */
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
}

/* Breaks each rule that both round kinds have, one after the other: an earlier one is reported before a later one. */
static void expect_round(struct geometry *geometry, struct geometry_spheres *spheres, const enum bvhd_vuid rules[8])
{
    expect(geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    spheres->index_type = 1000265000;
    expect(geometry, rules[7], rules[7]);
    spheres->index_type = 4711;
    expect(geometry, rules[6], rules[6]);
    spheres->radius_stride = UINT64_C(1) << 32;
    expect(geometry, rules[5], rules[6]);
    spheres->radius_format = 112;
    expect(geometry, rules[4], rules[4]);
    spheres->radius_format = 999999999;
    expect(geometry, rules[3], rules[3]);
    spheres->vertex_stride = UINT64_C(1) << 32;
    expect(geometry, rules[5], rules[3]);
    spheres->vertex_stride = 14;
    expect(geometry, rules[2], rules[3]);
    spheres->vertex_format = RADIUS_FLOAT32;
    expect(geometry, rules[1], rules[1]);
    spheres->vertex_format = 185;
    expect(geometry, rules[0], rules[0]);
}

static void wrong_spheres_are_refused(void **state)
{
    (void)state;
    static const enum bvhd_vuid rules[8] = {
        BVHD_VUID_SpheresData_vertexFormat_parameter, BVHD_VUID_10434, BVHD_VUID_10431,
        BVHD_VUID_SpheresData_radiusFormat_parameter, BVHD_VUID_10435, BVHD_VUID_10432,
        BVHD_VUID_SpheresData_indexType_parameter,    BVHD_VUID_10437,
    };
    struct geometry geometry = make_spheres(INDEX_UINT16);
    expect_round(&geometry, &geometry.spheres, rules);
}

static void wrong_swept_spheres_are_refused(void **state)
{
    (void)state;
    static const enum bvhd_vuid rules[8] = {
        BVHD_VUID_LinearSweptSpheresData_vertexFormat_parameter, BVHD_VUID_10423, BVHD_VUID_10421,
        BVHD_VUID_LinearSweptSpheresData_radiusFormat_parameter, BVHD_VUID_10424, BVHD_VUID_10422,
        BVHD_VUID_LinearSweptSpheresData_indexType_parameter,    BVHD_VUID_10428,
    };
    struct geometry geometry = make_swept(INDEX_UINT32, SWEPT_SUCCESSIVE);
    expect_round(&geometry, &geometry.swept_spheres.ends, rules);

    geometry = make_swept(INDEX_NONE, SWEPT_LIST);
    geometry.swept_spheres.end_caps_mode = SWEPT_CAPS_CHAINED;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.swept_spheres.indexing_mode = SWEPT_SUCCESSIVE;
    expect(&geometry, BVHD_VUID_10427, BVHD_VUID_10427);
    geometry.swept_spheres.end_caps_mode = 2;
    expect(&geometry, BVHD_VUID_LinearSweptSpheresData_endCapsMode_parameter,
           BVHD_VUID_LinearSweptSpheresData_endCapsMode_parameter);
    geometry.swept_spheres.indexing_mode = 2;
    expect(&geometry, BVHD_VUID_LinearSweptSpheresData_indexingMode_parameter,
           BVHD_VUID_LinearSweptSpheresData_indexingMode_parameter);
}

/* What Vulkan has no rule about is legal: the alignment of radii, and the strides of indices. */
static void unusual_spheres_are_accepted(void **state)
{
    (void)state;
    struct geometry geometry = make_spheres(INDEX_UINT32);
    geometry.spheres.radius_stride = 3;
    geometry.spheres.index_stride = UINT64_MAX;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
    geometry.spheres.radius_format = RADIUS_FLOAT16;
    geometry.spheres.vertex_stride = geometry.spheres.radius_stride = geometry.spheres.index_stride = 0;
    expect(&geometry, BVHD_VUID_NONE, BVHD_VUID_NONE);
}

/* Vulkan's limit counts triangles and AABBs. */
static void many_round_primitives_are_too_large(void **state)
{
    (void)state;
    struct geometry geometries[] = {make_spheres(INDEX_NONE), make_swept(INDEX_NONE, SWEPT_LIST)};
    const struct limits limits = limits_default();
    for (int i = 0; i < 2; i++) {
        struct geometry *geometry = &geometries[i];
        struct bvhd_error error = {.status = BVHD_OK};
        const struct validate_subject subject = {geometry, 1, 0, &error, false};
        const struct build_input input = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = geometry};
        uint64_t total = 0;
        geometry->range.primitive_count = (uint32_t)limits.max_primitives;
        assert_int_equal(validate_geometry(&subject, &input, &limits, &total), BVHD_OK);
        geometry->range.primitive_count = 1;
        assert_int_equal(validate_geometry(&subject, &input, &limits, &total), BVHD_TOO_LARGE);
        assert_string_equal(error.where, "ranges[1][0].primitiveCount");
        assert_int_equal(error.vuid, BVHD_VUID_NONE);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_has_one_kind),
        cmocka_unit_test(vertices_are_counted),
        cmocka_unit_test(vertices_of_spheres_are_counted),
        cmocka_unit_test(ends_of_swept_spheres_are_counted),
        cmocka_unit_test(wrong_shapes_are_refused),
        cmocka_unit_test(wrong_micromaps_are_refused),
        cmocka_unit_test(wrong_indices_of_micromaps_are_refused),
        cmocka_unit_test(wrong_bakes_are_refused),
        cmocka_unit_test(wrong_spheres_are_refused),
        cmocka_unit_test(wrong_swept_spheres_are_refused),
        cmocka_unit_test(unusual_spheres_are_accepted),
        cmocka_unit_test(many_round_primitives_are_too_large),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_spheres.c - tests the canonical form of spheres, its rules, and which spheres get a ref. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/primitive.h"
#include "proto/base/place.h"
#include "tests/support/builder/prepare_bed.h"

static uint32_t version_of(const struct canonical *canonical)
{
    return bytes_get32(canonical->bytes + 4);
}

static void spheres_are_copied(void **state)
{
    (void)state;
    struct test_input test;
    inputs_spheres(&test);
    struct canonical canonical = bed_make(&test);
    static const uint32_t indices[6] = {0, 1, 2, 2, 1, 3};
    assert_int_equal(version_of(&canonical), CANONICAL_VERSION_ROUND);
    assert_int_equal(canonical.primitive_count, 9);
    assert_int_equal(canonical.vertex_count, 4 + 3);
    const struct canonical_geometry *geometry = canonical.geometries;
    assert_int_equal(geometry->flags, GEOMETRY_OPAQUE);
    assert_memory_equal(geometry->indices, indices, sizeof indices);
    for (int i = 0; i < 4; i++)
        assert_memory_equal(geometry->positions + (ptrdiff_t)4 * i, test.vertices[i + 1], 16);
    geometry++;
    assert_null(geometry->indices);
    assert_int_equal(geometry->vertex_count, 3);
    for (int i = 0; i < 3; i++)
        assert_memory_equal(geometry->positions + (ptrdiff_t)4 * i, test.vertices[i], 16);
    bed_finish(&canonical);

    inputs_triangles(&test);
    canonical = bed_make(&test);
    assert_int_equal(version_of(&canonical), CANONICAL_VERSION);
    bed_finish(&canonical);
    test.input.geometry_count = 0;
    canonical = bed_make(&test);
    assert_int_equal(version_of(&canonical), CANONICAL_VERSION);
    bed_finish(&canonical);
}

/* Arrays of their own, strides, offsets, index widths and the format of radii do not change the bytes. */
static void layout_of_input_does_not_count(void **state)
{
    (void)state;
    static float centres[20][6];
    static uint16_t halves[20][3];
    static uint32_t wide[30];
    static const uint16_t half_of_quarters[] = {0, 0x3400, 0x3800, 0x3a00, 0x3c00, 0x3d00, 0x3e00, 0x3f00, 0x4000};
    struct test_input test, other;
    inputs_spheres(&test);
    for (int i = 0; i < INPUTS_VERTICES; i++)
        test.vertices[i][3] = 0.25f * (float)i;
    for (uint32_t first = 0; first < 4; first++) {
        inputs_spheres(&other);
        for (uint32_t i = 0; i < INPUTS_VERTICES; i++) {
            other.vertices[i][3] = test.vertices[i][3];
            memcpy(centres[i + first], test.vertices[i], 12);
            memcpy(halves[i + first], &half_of_quarters[i], 2);
        }
        for (int i = 0; i < 6; i++)
            wide[3 * i + 5] = test.indices[i + 2] + 7u;
        struct geometry_spheres *spheres = &other.geometries[0].spheres;
        spheres->vertices = (struct bytes){(const unsigned char *)centres, sizeof centres};
        spheres->vertex_stride = sizeof centres[0];
        spheres->radii = (struct bytes){(const unsigned char *)halves, sizeof halves};
        spheres->radius_format = 76;
        spheres->radius_stride = sizeof halves[0];
        spheres->index_type = INDEX_UINT32;
        spheres->indices = (struct bytes){(const unsigned char *)wide, sizeof wide};
        spheres->index_stride = 12;
        other.geometries[0].range.first_vertex = first + 1 - 7; /* the sum counts, which must not wrap around */
        other.geometries[0].range.primitive_offset = 20;
        bed_refuse(&other, BVHD_INVALID, "VUID-vkBuildAccelerationStructuresKHR-pInfos-11824",
                   "infos[2].geometries[0].spheres.indices[0]");
        for (int i = 0; i < 6; i++)
            wide[3 * i + 5] -= 7;
        other.geometries[0].range.first_vertex = first + 1;
        bed_compare(&test, &other, true);
        halves[first + 2][0] ^= 1;
        bed_compare(&test, &other, false);
    }
}

/* Strides of 0 leave one vertex, with indices or without; a stride of 0 of one array does not. */
static void strides_may_be_zero(void **state)
{
    (void)state;
    struct test_input test;
    inputs_spheres(&test);
    for (int g = 0; g < 2; g++)
        test.geometries[g].spheres.vertex_stride = test.geometries[g].spheres.radius_stride = 0;
    struct canonical canonical = bed_make(&test);
    for (int g = 0; g < 2; g++) {
        const struct canonical_geometry *geometry = &canonical.geometries[g];
        assert_int_equal(geometry->vertex_count, 1);
        assert_memory_equal(geometry->positions, test.vertices[0], 16);
        for (uint32_t i = 0; i < geometry->primitive_count; i++)
            assert_int_equal(geometry->indices[i], 0);
    }
    bed_finish(&canonical);

    inputs_spheres(&test);
    test.geometries[0].spheres.radius_stride = test.geometries[0].spheres.index_stride = 0;
    test.geometries[1].spheres.vertex_stride = 0;
    canonical = bed_make(&test);
    assert_int_equal(canonical.geometries[0].vertex_count, 1); /* one index */
    assert_int_equal(canonical.geometries[1].vertex_count, 3);
    for (int i = 0; i < 3; i++) {
        assert_memory_equal(canonical.geometries[1].positions + (ptrdiff_t)4 * i, test.vertices[0], 12);
        assert_true(canonical.geometries[1].positions[4 * i + 3] == test.vertices[i][3]);
    }
    bed_finish(&canonical);
}

static void empty_geometries_are_read_nowhere(void **state)
{
    (void)state;
    struct test_input test;
    inputs_spheres(&test);
    for (int g = 0; g < 2; g++) {
        test.geometries[g].range.primitive_count = 0;
        test.geometries[g].spheres.vertices = test.geometries[g].spheres.radii = test.geometries[g].spheres.indices =
            (struct bytes){NULL, 0};
    }
    struct canonical canonical = bed_make(&test);
    assert_int_equal(canonical.vertex_count, 0);
    assert_int_equal(version_of(&canonical), CANONICAL_VERSION_ROUND);
    bed_finish(&canonical);
}

#define RULE(number) "VUID-vkBuildAccelerationStructuresKHR-pInfos-" #number

static void rules_are_kept(void **state)
{
    (void)state;
    static const char *const radius = "VUID-VkAccelerationStructureGeometrySpheresDataNV-radiusData-10436";
    struct test_input test;
    struct geometry_spheres *indexed = &test.geometries[0].spheres, *plain = &test.geometries[1].spheres;

    inputs_spheres(&test);
    plain->indices = indexed->indices;
    bed_refuse(&test, BVHD_INVALID, RULE(11822), "infos[2].geometries[1].spheres.indexData");
    inputs_spheres(&test);
    indexed->indices.data = NULL;
    bed_refuse(&test, BVHD_INVALID, RULE(11823), "infos[2].geometries[0].spheres.indexData");
    inputs_spheres(&test);
    indexed->indices.size--;
    bed_refuse(&test, BVHD_INVALID, RULE(11823), "infos[2].geometries[0].spheres.indexData");
    for (int g = 0; g < 2; g++) {
        struct geometry_spheres *spheres = &test.geometries[g].spheres;
        const struct place geometry = place("infos[2].geometries[%d].spheres", g);
        inputs_spheres(&test);
        spheres->vertices.data = NULL;
        bed_refuse(&test, BVHD_INVALID, RULE(11824), place("%s.vertexData", geometry.text).text);
        inputs_spheres(&test);
        spheres->radii.data = NULL;
        bed_refuse(&test, BVHD_INVALID, RULE(11825), place("%s.radiusData", geometry.text).text);
    }
    inputs_spheres(&test);
    plain->vertices.size = 2 * 20 + 11;
    bed_refuse(&test, BVHD_INVALID, RULE(11824), "infos[2].geometries[1].spheres.vertexData");
    inputs_spheres(&test);
    plain->radii.size = 2 * 20 + 3;
    bed_refuse(&test, BVHD_INVALID, RULE(11825), "infos[2].geometries[1].spheres.radiusData");
    inputs_spheres(&test);
    indexed->vertices.size = 4 * 20 + 11; /* the last index is 3, from vertex 1 on */
    bed_refuse(&test, BVHD_INVALID, RULE(11824), "infos[2].geometries[0].spheres.indices[5]");
    inputs_spheres(&test);
    indexed->radii.size = 4 * 20 + 3;
    bed_refuse(&test, BVHD_INVALID, RULE(11825), "infos[2].geometries[0].spheres.indices[5]");
    inputs_spheres(&test);
    plain->vertex_stride = plain->radius_stride = 0;
    test.geometries[1].range.first_vertex = UINT32_MAX;
    bed_refuse(&test, BVHD_INVALID, RULE(11824), "infos[2].geometries[1].spheres.vertexData");
    inputs_spheres(&test);
    indexed->vertex_stride = indexed->radius_stride = 0;
    test.geometries[0].range.first_vertex = UINT32_MAX - 2;
    bed_refuse(&test, BVHD_INVALID, RULE(11824), "infos[2].geometries[0].spheres.indices[5]");

    inputs_spheres(&test);
    test.vertices[2][3] = -0.5f;
    bed_refuse(&test, BVHD_INVALID, radius, "infos[2].geometries[0].spheres[1].radius");
    test.geometries[0].range.primitive_count = 1;
    bed_refuse(&test, BVHD_INVALID, radius, "infos[2].geometries[1].spheres[2].radius");
    inputs_spheres(&test);
    test.vertices[2][3] = -0.0f;
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
    /* A negative radius that no sphere names does no harm: vertex 3 is that of index 2. */
    test.vertices[3][3] = -1;
    test.indices[4] = test.indices[5] = 1;
    canonical = bed_make(&test);
    assert_int_equal(canonical.geometries[0].vertex_count, 4);
    bed_finish(&canonical);
}

/* A NaN makes a sphere inactive; those of no extent or infinite ones are left out, or kept for updates. */
static void special_spheres_get_no_ref(void **state)
{
    (void)state;
    static float vertices[][4] = {{1, 2, 3, 0.5f},      {NAN, 0, 0, 1},      {0, 0, NAN, 1},      {0, 0, 0, NAN},
                                  {4, 5, 6, 0},         {INFINITY, 0, 0, 1}, {0, 0, 0, INFINITY}, {1e30f, 0, 0, 1e30f},
                                  {3e38f, 0, 0, 3e38f}, {0, 1, 0, 1e-40f}};
    enum { COUNT = sizeof vertices / sizeof *vertices };
    for (int updatable = 0; updatable < 2; updatable++) {
        struct test_input test;
        inputs_spheres(&test);
        test.input.geometry_count = 1;
        test.input.flags = updatable ? BUILD_ALLOW_UPDATE : 0;
        test.geometries[0] = test.geometries[1];
        struct geometry_spheres *spheres = &test.geometries[0].spheres;
        spheres->vertices = (struct bytes){(const unsigned char *)vertices, sizeof vertices};
        spheres->radii = (struct bytes){(const unsigned char *)&vertices[0][3], sizeof vertices - 12};
        spheres->vertex_stride = spheres->radius_stride = 16;
        test.geometries[0].range.primitive_count = COUNT;
        struct canonical canonical = bed_make(&test);
        struct primitive_refs refs;
        assert_int_equal(primitive_collect_blocks(&canonical, NULL, &bed_context, &refs, NULL), BVHD_OK);
        assert_int_equal(refs.count, updatable ? 7 : 4);
        assert_int_equal(refs.inactive, 3);
        assert_int_equal(refs.degenerate, 1);
        assert_int_equal(refs.skipped, updatable ? 0 : 3);
        assert_true(refs.refs[0].min[0] == 0.5f && refs.refs[0].max[2] == 3.5f);
        for (uint32_t i = 0; i < refs.count; i++)
            for (int k = 0; k < 3; k++)
                assert_true(isfinite(refs.refs[i].min[k]) && isfinite(refs.refs[i].max[k]) &&
                            refs.refs[i].min[k] <= refs.refs[i].max[k]);
        memory_free(&bed_memory, refs.refs);
        memory_free(&bed_memory, refs.blocks);
        bed_finish(&canonical);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct test_input test;
    struct canonical canonical;
    struct bvhd_error error;
    int failures = 0;
    inputs_spheres(&test);
    for (enum bvhd_status status = BVHD_NO_MEMORY; status != BVHD_OK; failures++) {
        atomic_store(&bed_memory.fail_after, failures);
        status = bed_try(&test, &canonical, &error);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && error.status == status && bed_memory.live == 0));
    }
    atomic_store(&bed_memory.fail_after, -1);
    assert_true(failures > 3);
    bed_finish(&canonical);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_are_copied),
        cmocka_unit_test(layout_of_input_does_not_count),
        cmocka_unit_test(strides_may_be_zero),
        cmocka_unit_test(empty_geometries_are_read_nowhere),
        cmocka_unit_test(rules_are_kept),
        cmocka_unit_test(special_spheres_get_no_ref),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

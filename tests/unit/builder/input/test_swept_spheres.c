/* SPDX-License-Identifier: Apache-2.0 */
/* test_swept_spheres.c - tests the canonical form of linear swept spheres, its rules, and which of them get a ref. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "builder/input/input_kind.h"
#include "builder/input/primitive.h"
#include "tests/support/builder/prepare_bed.h"

#define FIRST CANONICAL_CAP_FIRST
#define SECOND CANONICAL_CAP_SECOND
#define BOTH (FIRST | SECOND)

/* Makes one geometry with these 16-bit indices, from vertex 1 on. */
static void make_indexed(struct test_input *test, uint32_t mode, uint32_t caps, const uint16_t *indices, uint32_t count)
{
    inputs_swept_spheres(test);
    memcpy(test->indices, indices, count * sizeof *indices);
    test->input.geometry_count = 1;
    test->geometries[0].swept_spheres.indexing_mode = mode;
    test->geometries[0].swept_spheres.end_caps_mode = caps;
    test->geometries[0].swept_spheres.ends.indices.size = count * sizeof *indices;
    test->geometries[0].range.primitive_offset = 0;
    test->geometries[0].range.primitive_count = mode == SWEPT_LIST ? count / 2 : count;
}

static void expect(const struct test_input *test, const uint32_t *indices, uint32_t count, const int *vertices,
                   uint32_t vertex_count)
{
    struct canonical canonical = bed_make(test);
    const struct canonical_geometry *geometry = &canonical.geometries[0];
    assert_int_equal(bytes_get32(canonical.bytes + 4), CANONICAL_VERSION_ROUND);
    assert_int_equal(geometry->primitive_count, count);
    for (uint32_t i = 0; i < count; i++)
        if (geometry->indices[i] != indices[i])
            fail_msg("index %u is 0x%x", i, geometry->indices[i]);
    assert_int_equal(geometry->vertex_count, vertex_count);
    for (uint32_t i = 0; i < vertex_count; i++)
        assert_memory_equal(geometry->positions + (size_t)4 * i, test->vertices[vertices[i]], 16);
    bed_finish(&canonical);
}

/* The first of a chain has both caps, the next ones only the second; chains end where an index is not the next one. */
static void successive_indices_make_chains(void **state)
{
    (void)state;
    struct test_input test;
    static const uint16_t indices[] = {1, 2, 3, 5, 5, 6, 1};
    static const uint32_t chained[] = {BOTH, 1 | SECOND, 2 | SECOND, 4 | BOTH, 4 | BOTH, 5 | SECOND, BOTH};
    static const uint32_t bare[] = {0, 1, 2, 4, 4, 5, 0};
    static const int vertices[] = {2, 3, 4, 5, 6, 7, 8};
    make_indexed(&test, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED, indices, 7);
    expect(&test, chained, 7, vertices, 7);
    make_indexed(&test, SWEPT_SUCCESSIVE, SWEPT_CAPS_NONE, indices, 7);
    expect(&test, bare, 7, vertices, 7);
}

/* Without indices primitive i is the vertices 2i and 2i + 1, and each has both caps. */
static void no_indices_make_pairs(void **state)
{
    (void)state;
    struct test_input test;
    static const int vertices[] = {1, 2, 3, 4, 5, 6};
    static const uint32_t both[] = {BOTH, 2 | BOTH, 4 | BOTH}, bare[] = {0, 2, 4};
    inputs_swept_spheres(&test);
    test.input.geometry_count = 1;
    test.geometries[0] = test.geometries[1];
    test.geometries[0].range.first_vertex = 1;
    expect(&test, bare, 3, vertices, 6);
    test.geometries[0].swept_spheres.end_caps_mode = SWEPT_CAPS_CHAINED;
    expect(&test, both, 3, vertices, 6);
}

/* Lists whose pairs are a vertex and the next one share vertices; all others are gathered. */
static void lists_are_gathered_if_they_must(void **state)
{
    (void)state;
    struct test_input test;
    static const uint16_t strip[] = {1, 2, 2, 3, 3, 4}, apart[] = {0, 1, 6, 7}, back[] = {2, 1, 1, 2},
                          mixed[] = {0, 1, 1, 3, 3, 4};
    static const uint32_t shared[] = {BOTH, 1 | BOTH, 2 | BOTH}, own[] = {BOTH, 2 | BOTH, 4 | BOTH};
    static const int of_strip[] = {2, 3, 4, 5}, of_apart[] = {1, 2, 7, 8}, of_back[] = {3, 2, 2, 3},
                     of_mixed[] = {1, 2, 2, 4, 4, 5};
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, strip, 6);
    expect(&test, shared, 3, of_strip, 4);
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, apart, 4);
    expect(&test, own, 2, of_apart, 4); /* the span from 0 to 7 has more vertices than the pairs */
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, back, 4);
    expect(&test, own, 2, of_back, 4);
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, mixed, 6);
    expect(&test, own, 3, of_mixed, 6);
}

/* Equal primitives in other forms become equal bytes: successive without caps, as a strip of pairs, as a list. */
static void forms_do_not_count(void **state)
{
    (void)state;
    struct test_input a, b;
    static const uint16_t starts[] = {1, 3, 5}, pairs[] = {1, 2, 3, 4, 5, 6};
    make_indexed(&a, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED, starts, 3);
    make_indexed(&b, SWEPT_LIST, SWEPT_CAPS_CHAINED, pairs, 6);
    bed_compare(&a, &b, true);
    b.geometries[0].swept_spheres.ends.index_type = INDEX_NONE;
    b.geometries[0].swept_spheres.ends.indices = (struct bytes){NULL, 0};
    b.geometries[0].range.first_vertex = 2;
    bed_compare(&a, &b, true);
    b.geometries[0].swept_spheres.end_caps_mode = SWEPT_CAPS_NONE;
    bed_compare(&a, &b, false);
    a.geometries[0].swept_spheres.end_caps_mode = SWEPT_CAPS_NONE;
    bed_compare(&a, &b, true);
    a.input.flags = b.input.flags = BUILD_ALLOW_UPDATE; /* which records the modes */
    bed_compare(&a, &b, false);
}

/* Strides of 0 leave two equal vertices. Chains still follow from the indices. */
static void strides_may_be_zero(void **state)
{
    (void)state;
    struct test_input test;
    static const uint16_t indices[] = {1, 2, 3, 3};
    static const uint32_t chained[] = {BOTH, SECOND, SECOND, BOTH}, lists[] = {BOTH, BOTH};
    static const int vertices[] = {0, 0};
    for (int form = 0; form < 3; form++) {
        make_indexed(&test, form == 0 ? SWEPT_SUCCESSIVE : SWEPT_LIST, SWEPT_CAPS_CHAINED, indices, 4);
        struct geometry_spheres *ends = &test.geometries[0].swept_spheres.ends;
        ends->vertex_stride = ends->radius_stride = 0;
        if (form == 2) {
            ends->index_type = INDEX_NONE;
            ends->indices = (struct bytes){NULL, 0};
        }
        expect(&test, form == 0 ? chained : lists, form == 0 ? 4 : 2, vertices, 2);
        struct canonical made = bed_make(&test), view;
        assert_int_equal(prepare_open((struct bytes){made.bytes, made.size}, &bed_memory, &view, NULL), BVHD_OK);
        prepare_finish(&view, &bed_memory);
        bed_finish(&made);
    }
}

static const struct form_geometry *row_of(const struct canonical *canonical)
{
    return (const void *)(canonical->bytes + sizeof(struct form_header));
}

/* Returns what an updatable structure records instead of the lowest index. */
static uint32_t recorded(const uint16_t *pairs)
{
    struct test_input test;
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, pairs, 6);
    test.input.flags = BUILD_ALLOW_UPDATE;
    struct canonical canonical = bed_make(&test);
    const struct form_geometry row = *row_of(&canonical);
    assert_int_equal(row.update, FORM_UPDATE_RECORDED);
    assert_int_equal(row.vertex_format, 106);
    assert_int_equal(row.radius_format, 100);
    assert_int_equal(row.index_type, INDEX_UINT16);
    assert_int_equal(row.swept_modes, FORM_SWEPT_CHAINED);
    bed_finish(&canonical);
    return row.lowest_index;
}

/* Memory and time of a list do not grow with vertices that no pair names. */
static void lists_leave_vertices_between_alone(void **state)
{
    (void)state;
    enum { VERTICES = 60000, ENOUGH = 64 * 1024 };
    struct test_input test;
    static float vertices[VERTICES][4];
    static const uint16_t far[] = {0, 1, VERTICES - 2, VERTICES - 3};
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, far, 4);
    for (int i = 0; i < VERTICES; i++)
        for (int k = 0; k < 4; k++)
            vertices[i][k] = (float)(4 * i + k);
    struct geometry_spheres *ends = &test.geometries[0].swept_spheres.ends;
    ends->vertices = (struct bytes){(const unsigned char *)vertices, sizeof vertices};
    ends->radii = (struct bytes){(const unsigned char *)vertices + 12, sizeof vertices - 12};
    ends->vertex_stride = ends->radius_stride = sizeof *vertices;
    test.geometries[0].range.first_vertex = 1;
    bed_memory.peak = 0;
    struct canonical canonical = bed_make(&test);
    const struct canonical_geometry *geometry = &canonical.geometries[0];
    assert_int_equal(geometry->vertex_count, 4);
    for (int i = 0; i < 4; i++)
        assert_memory_equal(geometry->positions + (size_t)4 * i, vertices[1 + far[i]], 16);
    assert_in_range(bed_memory.peak, 1, ENOUGH);
    assert_in_range(input_kind_of(GEOMETRY_SWEPT_SPHERES)->beside(&test.geometries[0]), 1, ENOUGH);
    bed_finish(&canonical);
}

/* The copy of a gathered list does not show the indices, so that a checksum tells whether they change. */
static void updates_know_gathered_indices(void **state)
{
    (void)state;
    static const uint16_t strip[] = {1, 2, 2, 3, 3, 4}, one[] = {0, 1, 1, 3, 3, 4}, two[] = {0, 1, 1, 3, 4, 3};
    assert_int_equal(recorded(strip), 1);
    assert_int_equal(recorded(one), recorded(one));
    assert_int_not_equal(recorded(one), recorded(two));
}

#define RULE(number) "VUID-vkBuildAccelerationStructuresKHR-pInfos-" #number
#define DATA(rule) "VUID-VkAccelerationStructureGeometryLinearSweptSpheresDataNV-" rule
#define PLACE(field) "infos[2].geometries[0].linearSweptSpheres" field

static void rules_are_kept(void **state)
{
    (void)state;
    static const uint16_t indices[] = {1, 2, 3, 7}, beyond[] = {1, 2, 8, 3};
    struct test_input test;
    struct geometry_swept_spheres *swept = &test.geometries[0].swept_spheres;
    make_indexed(&test, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED, indices, 4);
    bed_refuse(&test, BVHD_INVALID, RULE(11828), PLACE(".indices[3]")); /* the end after 7 is missing */
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, indices, 4);
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
    swept->ends.radii.size -= 20;
    bed_refuse(&test, BVHD_INVALID, RULE(11829), PLACE(".indices[3]"));
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, beyond, 4);
    bed_refuse(&test, BVHD_INVALID, RULE(11828), PLACE(".indices[2]"));
    make_indexed(&test, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED, indices, 3);
    swept->ends.vertex_stride = swept->ends.radius_stride = 0;
    test.geometries[0].range.first_vertex = UINT32_MAX - 3; /* the first end of the last is there, the second is not */
    bed_refuse(&test, BVHD_INVALID, RULE(11828), PLACE(".indices[2]"));

    make_indexed(&test, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED, indices, 3);
    swept->ends.indices.size--;
    bed_refuse(&test, BVHD_INVALID, RULE(11827), PLACE(".indexData"));
    swept->ends.indices.data = NULL;
    bed_refuse(&test, BVHD_INVALID, DATA("indexingMode-10427"), PLACE(".indexData"));
    swept->indexing_mode = SWEPT_LIST;
    bed_refuse(&test, BVHD_INVALID, RULE(11827), PLACE(".indexData"));
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, indices, 4);
    swept->ends.index_type = INDEX_NONE;
    bed_refuse(&test, BVHD_INVALID, RULE(11826), PLACE(".indexData"));
    swept->ends.indices.data = NULL;
    canonical = bed_make(&test);
    bed_finish(&canonical);
    swept->ends.vertices.size = 4 * 20 + 11; /* two primitives from vertex 1 on */
    bed_refuse(&test, BVHD_INVALID, RULE(11828), PLACE(".vertexData"));
    swept->ends.vertices.size = swept->ends.radii.size = 4 * 20 + 12;
    canonical = bed_make(&test);
    bed_finish(&canonical);
    swept->ends.radii.size = 4 * 20 + 3;
    bed_refuse(&test, BVHD_INVALID, RULE(11829), PLACE(".radiusData"));

    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, indices, 4);
    test.vertices[4][3] = -1;
    bed_refuse(&test, BVHD_INVALID, DATA("radiusData-10426"), PLACE("[1].radii[0]"));
    test.indices[2] = 2;
    test.vertices[8][3] = -1;
    bed_refuse(&test, BVHD_INVALID, DATA("radiusData-10426"), PLACE("[1].radii[1]"));
}

/* A NaN at an end makes a primitive inactive; those of which nothing can be hit are left out, or kept for updates. */
static void special_primitives_get_no_ref(void **state)
{
    (void)state;
    static float vertices[][2][4] = {
        {{0, 0, 0, 1}, {3, 0, 0, 1}},
        {{NAN, 0, 0, 1}, {3, 0, 0, 1}},
        {{0, 0, 0, 1}, {3, 0, 0, NAN}},
        {{0, 0, 0, 0}, {3, 0, 0, 0}},
        {{0, 0, 0, 0}, {3, 0, 0, 1}},
        {{0, 0, 0, 5}, {3, 0, 0, 1}},
        {{0, 0, INFINITY, 1}, {3, 0, 0, 1}},
        {{0, 0, 0, 1}, {3, 0, 0, INFINITY}},
        {{-3e38f, 0, 0, 3e38f}, {3e38f, 0, 0, 3e38f}},
    };
    enum { COUNT = sizeof vertices / sizeof *vertices };
    for (int caps = 0; caps < 2; caps++)
        for (int updatable = 0; updatable < 2; updatable++) {
            struct test_input test;
            inputs_swept_spheres(&test);
            test.input.geometry_count = 1;
            test.input.flags = updatable ? BUILD_ALLOW_UPDATE : 0;
            test.geometries[0] = test.geometries[1];
            struct geometry_swept_spheres *swept = &test.geometries[0].swept_spheres;
            swept->end_caps_mode = caps ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE;
            swept->ends.vertices = (struct bytes){(const unsigned char *)vertices, sizeof vertices};
            swept->ends.radii = (struct bytes){(const unsigned char *)&vertices[0][0][3], sizeof vertices - 12};
            swept->ends.vertex_stride = swept->ends.radius_stride = 16;
            test.geometries[0].range.primitive_count = COUNT;
            struct canonical canonical = bed_make(&test);
            struct primitive_refs refs;
            const uint32_t nothing = caps ? 1 : 2; /* the thread; and without caps the one whose end is swallowed */
            assert_int_equal(primitive_collect_blocks(&canonical, NULL, &bed_context, &refs, NULL), BVHD_OK);
            assert_int_equal(refs.inactive, 2);
            assert_int_equal(refs.degenerate, nothing);
            assert_int_equal(refs.skipped, updatable ? 0 : 2 + nothing);
            assert_int_equal(refs.count, COUNT - 2 - (updatable ? 0 : 2 + nothing));
            assert_true(fabsf(refs.refs[0].min[0] - (caps ? -1 : 0)) < 1e-6f && fabsf(refs.refs[0].max[1] - 1) < 1e-6f);
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
    static const uint16_t indices[] = {1, 2, 5, 3};
    struct test_input test;
    struct canonical canonical;
    struct bvhd_error error;
    int failures = 0;
    make_indexed(&test, SWEPT_LIST, SWEPT_CAPS_CHAINED, indices, 4);
    for (enum bvhd_status status = BVHD_NO_MEMORY; status != BVHD_OK; failures++) {
        atomic_store(&bed_memory.fail_after, failures);
        status = bed_try(&test, &canonical, &error);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && error.status == status && bed_memory.live == 0));
    }
    atomic_store(&bed_memory.fail_after, -1);
    assert_true(failures > 4);
    bed_finish(&canonical);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(successive_indices_make_chains),
        cmocka_unit_test(no_indices_make_pairs),
        cmocka_unit_test(lists_are_gathered_if_they_must),
        cmocka_unit_test(forms_do_not_count),
        cmocka_unit_test(strides_may_be_zero),
        cmocka_unit_test(lists_leave_vertices_between_alone),
        cmocka_unit_test(updates_know_gathered_indices),
        cmocka_unit_test(rules_are_kept),
        cmocka_unit_test(special_primitives_get_no_ref),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_rows_versions.c - tests rows that are longer or shorter than those with all fields, as other versions have. */
#include "tests/support/unit.h"

#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/proto/payloads.h"

/* Makes the same description with longer rows, as another version would write them. */
static struct payload stretch(const struct test_input *test, uint32_t geometry_more, uint32_t reference_more)
{
    struct payload from = payload_write(&test->input), to = from;
    uint64_t rows = (uint64_t)from.shape.geometry_count * ROWS_GEOMETRY_LEAST +
                    (uint64_t)from.shape.reference_count * ROWS_REFERENCE_SIZE;
    uint64_t more =
        (uint64_t)from.shape.geometry_count * geometry_more + (uint64_t)from.shape.reference_count * reference_more;
    to.size += more;
    to.shape.geometry_size += geometry_more;
    to.shape.reference_size += reference_more;
    to.bytes = calloc(1, to.size);
    unsigned char *at = to.bytes;
    for (uint32_t i = 0; i < from.shape.geometry_count; i++, at += to.shape.geometry_size) {
        struct geometry_row row;
        memcpy(&row, from.bytes + i * from.shape.geometry_size, ROWS_GEOMETRY_LEAST);
        row.data.offset += row.data.offset ? more : 0;
        row.indices.offset += row.indices.offset ? more : 0;
        row.transform.offset += row.transform.offset ? more : 0;
        memcpy(at, &row, ROWS_GEOMETRY_LEAST);
    }
    const unsigned char *references = from.bytes + (uint64_t)from.shape.geometry_count * ROWS_GEOMETRY_LEAST;
    for (uint32_t i = 0; i < from.shape.reference_count; i++, at += to.shape.reference_size)
        memcpy(at, references + (uint64_t)i * ROWS_REFERENCE_SIZE, ROWS_REFERENCE_SIZE);
    memcpy(at, from.bytes + rows, from.size - rows);
    free(from.bytes);
    return to;
}

static void longer_rows_are_read_while_the_rest_is_zero(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    static const uint32_t more[] = {0, 1, 16, 37, ROWS_MAX_SIZE - ROWS_GEOMETRY_SIZE};
    for (size_t i = 0; i < sizeof more / sizeof more[0]; i++) {
        struct payload payload = stretch(&test, ROWS_GEOMETRY_SIZE - ROWS_GEOMETRY_LEAST + more[i], more[i]);
        struct build_input input;
        assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
        payload_compare_geometries(&test.geometries[0], &input.geometries[0]);
        for (int k = 0; k < 3; k++)
            payload_compare_references(&test.references[k], &input.references[k]);
        rows_finish(&input, &payload_memory);
        if (more[i] > 0) {
            unsigned char *last = payload.bytes + payload.shape.geometry_size - 1,
                          *first = payload.bytes + ROWS_GEOMETRY_SIZE;
            *first = 1;
            payload_refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
            *first = 0;
            *last = 1;
            payload_refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
            *last = 0;
            last += 3 * payload.shape.reference_size;
            *last = 0x80;
            payload_refuse(&payload, BVHD_UNSUPPORTED, "infos[5].references[2]");
        }
        free(payload.bytes);
    }
}

/* Rows have 96 bytes, which every daemon understands, unless a geometry has fields that are behind them. */
static void rows_are_as_short_as_they_can_be(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    assert_int_equal(rows_geometry_size(&test.input), 96);
    test.geometries[1].type = GEOMETRY_SPHERES;
    assert_int_equal(rows_geometry_size(&test.input), 160);
    test.input.geometry_count = 1;
    assert_int_equal(rows_geometry_size(&test.input), 96);
    inputs_aabbs(&test);
    assert_int_equal(rows_geometry_size(&test.input), 96);
    inputs_instances(&test);
    assert_int_equal(rows_geometry_size(&test.input), 96);
    inputs_swept_spheres(&test);
    assert_int_equal(rows_geometry_size(&test.input), 160);
    inputs_motion_triangles(&test);
    assert_int_equal(rows_geometry_size(&test.input), 160);
    inputs_mixed_triangles(&test);
    assert_int_equal(rows_geometry_size(&test.input), 160);
    inputs_motion_instances(&test);
    assert_int_equal(rows_geometry_size(&test.input), 96);
    inputs_triangles_with_micromap(&test);
    assert_int_equal(rows_geometry_size(&test.input), 224);
    test.geometries[0].triangles.micromap.is_given = 0;
    assert_int_equal(rows_geometry_size(&test.input), 96);
    test.geometries[1].triangles.micromap.is_given = 1;
    assert_int_equal(rows_geometry_size(&test.input), 224);
    inputs_motion_triangles_with_micromap(&test);
    assert_int_equal(rows_geometry_size(&test.input), 224);
    inputs_micromap(&test);
    assert_int_equal(rows_geometry_size(&test.input), 240);
    inputs_baked_micromap(&test);
    assert_int_equal(rows_geometry_size(&test.input), 304);
    test.geometries[0].type = 4711;
    test.input.geometry_count = 1;
    assert_int_equal(rows_geometry_size(&test.input), 96);
    test.input.geometry_count = 0;
    assert_int_equal(rows_geometry_size(&test.input), 96);
}

/* Spheres in rows that end before the radii: the missing fields are 0, and validation refuses them. */
static void short_rows_of_spheres_lack_radii(void **state)
{
    (void)state;
    struct geometry_row row = {.type = GEOMETRY_SPHERES, .vertex_format = 106, .index_type = INDEX_NONE, .stride = 20};
    row.radius_format = 100;
    struct payload payload = {(unsigned char *)&row, ROWS_GEOMETRY_LEAST, {1, ROWS_GEOMETRY_LEAST, 0, 0, NULL}};
    struct build_input input = {0};
    assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
    const struct geometry_spheres *spheres = &input.geometries[0].spheres;
    assert_true(spheres->vertex_format == 106 && spheres->vertex_stride == 20 && spheres->index_type == INDEX_NONE);
    assert_true(spheres->radius_format == 0 && spheres->radii.data == NULL);
    rows_finish(&input, &payload_memory);
}

/* Motion triangles in rows that end before the positions at t = 1, which are then not given. */
static void short_rows_of_motion_triangles_lack_their_end(void **state)
{
    (void)state;
    struct test_input test;
    inputs_motion_triangles(&test);
    struct payload payload = payload_write(&test.input);
    for (uint32_t size = ROWS_GEOMETRY_LEAST; size <= offsetof(struct geometry_row, end_positions); size += 16) {
        const struct rows_shape shape = {1, size, 0, 0, NULL};
        const struct payload cut = {payload.bytes, payload.size, shape};
        struct build_input input = {0};
        assert_int_equal(payload_read(&cut, &input, NULL), BVHD_OK);
        struct geometry want = test.geometries[0];
        want.triangles.end_vertices = (struct bytes){NULL, 0};
        payload_compare_geometries(&want, &input.geometries[0]);
        rows_finish(&input, &payload_memory);
    }
    free(payload.bytes);
}

/*
 * Reference rows of the first version end before the slabs, which are then unknown; other rows may end anywhere after
 * that.
 */
static void shorter_rows_lack_their_end(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    for (int i = 0; i < SLABS_COUNT; i++)
        for (int k = 0; k < 3; k++)
            test.references[k].slabs.min[i] = -(test.references[k].slabs.max[i] = (float)(1 + i + 10 * k));
    for (uint32_t size = ROWS_REFERENCE_LEAST; size <= ROWS_REFERENCE_SIZE; size += 4) {
        struct payload payload = payload_write(&test.input);
        struct build_input input;
        for (uint32_t i = 0; i < 3; i++)
            memmove(payload.bytes + ROWS_GEOMETRY_LEAST + i * size,
                    payload.bytes + ROWS_GEOMETRY_LEAST + i * ROWS_REFERENCE_SIZE, size);
        payload.shape.reference_size = size;
        assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
        for (int k = 0; k < 3; k++) {
            struct reference want = test.references[k];
            memset((unsigned char *)&want.slabs + (size - ROWS_REFERENCE_LEAST), 0, ROWS_REFERENCE_SIZE - size);
            payload_compare_references(&want, &input.references[k]);
        }
        rows_finish(&input, &payload_memory);
        free(payload.bytes);
    }
}

/*
 * Rows that end before or within the fields of a micromap: triangles have one only if the row says so, and then what is
 * missing is 0.
 */
static void shorter_rows_lack_what_is_missing_of_a_micromap(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles_with_micromap(&test);
    test.input.geometry_count = 1;
    struct payload payload = payload_write(&test.input);
    for (uint32_t size = ROWS_GEOMETRY_LEAST; size <= ROWS_GEOMETRY_ATTACHED; size += 16) {
        const struct payload cut = {payload.bytes, payload.size, {1, size, 0, 0, NULL}};
        struct build_input input = {0};
        struct geometry want = test.geometries[0];
        struct triangle_micromap *micromap = &want.triangles.micromap;
        if (size <= offsetof(struct geometry_row, has_micromap))
            memset(micromap, 0, sizeof *micromap);
        if (size <= offsetof(struct geometry_row, micromap))
            micromap->micromap = micromap->stride = 0;
        if (size <= offsetof(struct geometry_row, usages))
            micromap->usages = (struct bytes){NULL, 0};
        if (size <= offsetof(struct geometry_row, micromap_indices))
            micromap->indices = (struct bytes){NULL, 0};
        assert_int_equal(payload_read(&cut, &input, NULL), BVHD_OK);
        payload_compare_geometries(&want, &input.geometries[0]);
        rows_finish(&input, &payload_memory);
    }
    free(payload.bytes);
}

/* Triangles without a micromap have nothing of one, whatever their rows say. */
static void micromaps_that_are_not_given_are_ignored(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles_with_micromap(&test);
    struct payload payload = payload_write(&test.input);
    struct geometry_row row;
    memcpy(&row, payload.bytes, ROWS_GEOMETRY_ATTACHED);
    row.has_micromap = 0;
    row.has_usages = 4711;
    row.usages = row.micromap_indices = (struct row_span){UINT64_MAX, UINT64_MAX};
    memcpy(payload.bytes, &row, ROWS_GEOMETRY_ATTACHED);
    test.geometries[0].triangles.micromap = (struct triangle_micromap){.is_given = 0};
    struct build_input input = {0};
    assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
    payload_compare_geometries(&test.geometries[0], &input.geometries[0]);
    rows_finish(&input, &payload_memory);
    row.has_micromap = 2;
    memcpy(payload.bytes, &row, ROWS_GEOMETRY_ATTACHED);
    payload_refuse(&payload, BVHD_CORRUPT, "infos[5].geometries[0]");
    row.has_micromap = 1;
    memcpy(payload.bytes, &row, ROWS_GEOMETRY_ATTACHED);
    payload_refuse(&payload, BVHD_CORRUPT, "infos[5].geometries[0]");
    free(payload.bytes);
}

static void reserved_fields_are_refused(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = payload_write(&test.input);
    unsigned char *reserved = payload.bytes + offsetof(struct geometry_row, reserved);
    bytes_put32(reserved, 1);
    payload_refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
    bytes_put32(reserved, 0);
    struct test_input spheres;
    inputs_spheres(&spheres);
    struct payload round = payload_write(&spheres.input);
    unsigned char *reserved_round = round.bytes + ROWS_GEOMETRY_ROUND + offsetof(struct geometry_row, reserved_round);
    *reserved_round = 1;
    payload_refuse(&round, BVHD_UNSUPPORTED, "infos[5].geometries[1]");
    *reserved_round = 0;
    free(round.bytes);
    unsigned char *reference = payload.bytes + ROWS_GEOMETRY_LEAST + ROWS_REFERENCE_SIZE;
    bytes_put32(reference + offsetof(struct reference_row, reserved), UINT32_C(1) << 31);
    payload_refuse(&payload, BVHD_UNSUPPORTED, "infos[5].references[1]");
    bytes_put32(reference + offsetof(struct reference_row, reserved), 0);
    bytes_put32(reference + offsetof(struct reference_row, moves), 2);
    payload_refuse(&payload, BVHD_CORRUPT, "infos[5].references[1]");
    bytes_put32(reference + offsetof(struct reference_row, moves), 0);
    bytes_put32(reference + offsetof(struct reference_row, has_key), 2);
    payload_refuse(&payload, BVHD_CORRUPT, "infos[5].references[1]");
    free(payload.bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(longer_rows_are_read_while_the_rest_is_zero),
        cmocka_unit_test(rows_are_as_short_as_they_can_be),
        cmocka_unit_test(short_rows_of_spheres_lack_radii),
        cmocka_unit_test(short_rows_of_motion_triangles_lack_their_end),
        cmocka_unit_test(shorter_rows_lack_their_end),
        cmocka_unit_test(shorter_rows_lack_what_is_missing_of_a_micromap),
        cmocka_unit_test(micromaps_that_are_not_given_are_ignored),
        cmocka_unit_test(reserved_fields_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

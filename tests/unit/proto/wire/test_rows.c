/* SPDX-License-Identifier: Apache-2.0 */
/* test_rows.c - tests that payloads are read as they were written, and that all others are refused. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/proto/payloads.h"
#include "proto/wire/row_kind.h"

static void round_trip(const struct build_input *input)
{
    struct payload payload = payload_write(input);
    struct build_input back = {.type = 7,
                               .flags = 8,
                               .mode = 9,
                               .destination = 10,
                               .source = 11,
                               .options = {.quality = QUALITY_HIGH, .target = 12, .layout_flags = 13}};
    assert_int_equal(payload_read(&payload, &back, NULL), BVHD_OK);
    assert_true(back.type == 7 && back.flags == 8 && back.mode == 9 && back.destination == 10 && back.source == 11);
    assert_true(back.options.quality == QUALITY_HIGH && back.options.target == 12 && back.options.layout_flags == 13);
    assert_int_equal(back.geometry_count, input->geometry_count);
    assert_int_equal(back.reference_count, input->reference_count);
    for (uint32_t i = 0; i < input->geometry_count; i++)
        payload_compare_geometries(&input->geometries[i], &back.geometries[i]);
    for (uint32_t i = 0; i < input->reference_count; i++)
        payload_compare_references(&input->references[i], &back.references[i]);
    rows_finish(&back, &payload_memory);
    rows_finish(&back, &payload_memory);
    assert_int_equal(payload_memory.live, 0);
    free(payload.bytes);
}

static void descriptions_come_back(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    round_trip(&test.input);
    test.geometries[1].type = GEOMETRY_AABBS;
    test.geometries[1].aabbs.stride = UINT64_MAX;
    test.geometries[1].aabbs.boxes = (struct bytes){(unsigned char *)test.boxes, 17};
    round_trip(&test.input);
    test.geometries[0].type = 4711; /* validation refuses an unknown type, not the reader */
    round_trip(&test.input);
    inputs_aabbs(&test);
    round_trip(&test.input);
    inputs_spheres(&test);
    round_trip(&test.input);
    test.geometries[0].spheres.index_stride = UINT64_MAX;
    test.geometries[0].spheres.vertex_stride = UINT64_MAX - 1;
    test.geometries[0].spheres.radius_stride = UINT64_MAX - 2;
    test.geometries[0].spheres.radius_format = UINT32_MAX;
    round_trip(&test.input);
    inputs_swept_spheres(&test);
    round_trip(&test.input);
    test.geometries[0].swept_spheres.indexing_mode = 4711;
    test.geometries[1].swept_spheres.end_caps_mode = 4712;
    round_trip(&test.input);
    inputs_motion_triangles(&test);
    round_trip(&test.input);
    inputs_mixed_triangles(&test);
    round_trip(&test.input);
    inputs_motion_instances(&test);
    round_trip(&test.input);
    inputs_micromap(&test);
    test.geometries[0].micromap.stride = UINT64_MAX;
    round_trip(&test.input);
    inputs_baked_micromap(&test);
    round_trip(&test.input);
    test.geometries[0].bake.level = BAKE_LEVEL_AUTO;
    test.geometries[0].bake.row_stride = UINT64_MAX;
    test.geometries[0].bake.coordinate_stride = UINT64_MAX - 1;
    round_trip(&test.input);
    inputs_triangles_with_micromap(&test);
    round_trip(&test.input);
    test.geometries[1].triangles.micromap = (struct triangle_micromap){.is_given = 1, .stride = UINT64_MAX};
    round_trip(&test.input);
    inputs_motion_triangles_with_micromap(&test);
    round_trip(&test.input);
    inputs_instances(&test);
    test.references[0].bounds.min[0] = -0.0f;
    /* Slabs may have any value. */
    for (int i = 0; i < SLABS_COUNT; i++)
        test.references[1].slabs.min[i] = test.references[1].slabs.max[i] = i ? (float)i : INFINITY;
    test.references[0].kind = (enum reference_kind)99;
    test.references[1].moves = true;
    round_trip(&test.input);
    test.input.geometry_count = 0;
    round_trip(&test.input);
    test.input.reference_count = 0;
    round_trip(&test.input);
    rows_finish(NULL, &payload_memory);
}

/* Memory that is not given differs from memory of no bytes: validation treats them differently. */
static void empty_is_not_absent(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    for (int given = 0; given < 8; given++) {
        struct geometry_triangles *triangles = &test.geometries[1].triangles;
        triangles->vertices = (struct bytes){given & 1 ? (unsigned char *)test.records : NULL, 0};
        triangles->indices = (struct bytes){given & 2 ? (unsigned char *)test.records : NULL, 0};
        triangles->transform = (struct bytes){given & 4 ? (unsigned char *)test.records : NULL, 0};
        round_trip(&test.input);
    }
    test.input.geometry_count = 1; /* an empty span at the end of the payload */
    test.geometries[0] = test.geometries[1];
    round_trip(&test.input);
}

static uint64_t span_offset(const struct payload *payload, uint32_t geometry, size_t member)
{
    return bytes_get64(payload->bytes + geometry * payload->shape.geometry_size + member);
}

static void spans_are_aligned_and_shared(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.geometries[0].triangles.vertices.size -= 3;
    test.geometries[1].triangles.vertices.size -= 3;
    struct payload payload = payload_write(&test.input);
    uint64_t first = span_offset(&payload, 0, offsetof(struct geometry_row, data));
    assert_int_equal(span_offset(&payload, 1, offsetof(struct geometry_row, data)), first);
    assert_int_equal(first % ROWS_ALIGNMENT, 0);
    assert_int_equal(span_offset(&payload, 0, offsetof(struct geometry_row, indices)) % ROWS_ALIGNMENT, 0);
    assert_int_equal(payload.size, 2 * 96 + 192 + 16 + 64);
    for (uint64_t at = first + test.geometries[0].triangles.vertices.size; at % ROWS_ALIGNMENT != 0; at++)
        assert_int_equal(payload.bytes[at], 0);
    free(payload.bytes);
    test.geometries[1].triangles.vertices.size++;
    payload = payload_write(&test.input);
    assert_int_not_equal(span_offset(&payload, 1, offsetof(struct geometry_row, data)), first);
    free(payload.bytes);
}

static void sizes_that_overflow_are_refused(void **state)
{
    (void)state;
    struct test_input test;
    uint64_t size = 4711;
    inputs_triangles(&test);
    for (uint64_t less = 0; less < 300; less++) {
        test.geometries[0].triangles.vertices.size = UINT64_MAX - less;
        assert_false(rows_payload_size(&test.input, &size));
    }
    test.geometries[0].triangles.vertices.size = UINT64_MAX / 2;
    test.geometries[1].triangles.vertices.size = UINT64_MAX / 2 + 1;
    assert_false(rows_payload_size(&test.input, &size));
    assert_int_equal(size, 4711);
}

static void (*const describe[])(struct test_input *test) = {inputs_triangles,
                                                            inputs_aabbs,
                                                            inputs_instances,
                                                            inputs_spheres,
                                                            inputs_swept_spheres,
                                                            inputs_motion_triangles,
                                                            inputs_motion_instances,
                                                            inputs_micromap,
                                                            inputs_baked_micromap,
                                                            inputs_triangles_with_micromap,
                                                            inputs_motion_triangles_with_micromap};

/* Returns the bytes of padding behind the last array of a payload. Second geometries share what the first ones have. */
static uint64_t padding_of(const struct build_input *input)
{
    const struct geometry *first = &input->geometries[0];
    const bool attached = row_kind_size(first) == ROWS_GEOMETRY_ATTACHED;
    uint64_t size = attached                                   ? first->triangles.micromap.indices.size
                    : first->type == GEOMETRY_AABBS            ? first->aabbs.boxes.size
                    : first->type == GEOMETRY_SPHERES          ? first->spheres.radii.size
                    : first->type == GEOMETRY_SWEPT_SPHERES    ? first->swept_spheres.ends.radii.size
                    : first->type == GEOMETRY_MOVING_TRIANGLES ? first->triangles.end_vertices.size
                    : first->type == GEOMETRY_MICROMAP         ? first->micromap.triangles.size
                    : first->type == GEOMETRY_BAKED_MICROMAP   ? first->bake.coordinates.size
                                                               : 0;
    return bytes_align(size, ROWS_ALIGNMENT) - size;
}

/*
 * In a payload that is shorter by any number of bytes, rows are missing or spans reach beyond its end. Only padding at
 * the end may be missing.
 */
static void every_truncation_is_refused(void **state)
{
    (void)state;
    for (size_t kind = 0; kind < sizeof describe / sizeof *describe; kind++) {
        struct test_input test;
        describe[kind](&test);
        struct payload payload = payload_write(&test.input);
        for (uint64_t size = payload.size - padding_of(&test.input); size-- > 0;) {
            struct payload cut = {payload.bytes, size, payload.shape};
            struct build_input input;
            unsigned char *exact = malloc(size ? size : 1);
            memcpy(exact, payload.bytes, size);
            cut.bytes = exact;
            assert_int_equal(payload_read(&cut, &input, NULL), BVHD_CORRUPT);
            assert_int_equal(payload_memory.live, 0);
            free(exact);
        }
        struct payload longer = {payload.bytes, payload.size + 1, payload.shape}; /* an additional byte is ignored */
        struct build_input input;
        assert_int_equal(payload_read(&longer, &input, NULL), BVHD_OK);
        rows_finish(&input, &payload_memory);
        free(payload.bytes);
    }
}

static void rows_outside_are_refused(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = payload_write(&test.input), other;
    other = payload;
    other.shape.geometry_count = UINT32_MAX;
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other.shape.geometry_count = (uint32_t)(payload.size / 96 + 1);
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other = payload;
    other.shape.reference_count = UINT32_MAX;
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = 0;
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = ROWS_REFERENCE_LEAST - 1;
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = ROWS_MAX_SIZE + 1;
    payload_refuse(&other, BVHD_TOO_LARGE, "infos[5].references");
    other = payload;
    other.shape.geometry_size = ROWS_GEOMETRY_LEAST - 1;
    payload_refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other.shape.geometry_size = UINT32_MAX;
    payload_refuse(&other, BVHD_TOO_LARGE, "infos[5].geometries");
    other.shape.geometry_count = 0; /* then its row size is ignored, and the references come first */
    memmove(payload.bytes, payload.bytes + ROWS_GEOMETRY_LEAST, 3 * ROWS_REFERENCE_SIZE);
    struct build_input input;
    assert_int_equal(payload_read(&other, &input, NULL), BVHD_OK);
    assert_int_equal(input.references[2].handle, 77);
    rows_finish(&input, &payload_memory);
    free(payload.bytes);
}

/* Replaces the span by wrong ones, each of which is refused. */
static void spoil_span(struct payload *payload, size_t member, const char *where)
{
    const struct row_span wrong[] = {{payload->size, 1},
                                     {payload->size + 1, 0},
                                     {payload->size - 8, 9},
                                     {UINT64_MAX, 1},
                                     {1, UINT64_MAX},
                                     {UINT64_MAX, UINT64_MAX},
                                     {0, 1},
                                     {0, UINT64_MAX},
                                     {UINT64_MAX - 15, 16 + 200}};
    for (size_t k = 0; k < sizeof wrong / sizeof wrong[0]; k++) {
        struct row_span good;
        memcpy(&good, payload->bytes + member, sizeof good);
        memcpy(payload->bytes + member, &wrong[k], sizeof good);
        payload_refuse(payload, BVHD_CORRUPT, where);
        memcpy(payload->bytes + member, &good, sizeof good);
    }
}

static void spans_outside_are_refused(void **state)
{
    (void)state;
    static const struct {
        void (*describe)(struct test_input *test);
        size_t member;
        const char *where;
    } spans[] = {
        {inputs_triangles, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_triangles, offsetof(struct geometry_row, indices), "infos[5].geometries[0].indices"},
        {inputs_triangles, offsetof(struct geometry_row, transform), "infos[5].geometries[0].transform"},
        {inputs_spheres, offsetof(struct geometry_row, radii), "infos[5].geometries[0].radii"},
        {inputs_motion_triangles, offsetof(struct geometry_row, end_positions), "infos[5].geometries[0].endPositions"},
        {inputs_motion_triangles, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_motion_instances, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_swept_spheres, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_swept_spheres, offsetof(struct geometry_row, indices), "infos[5].geometries[0].indices"},
        {inputs_swept_spheres, offsetof(struct geometry_row, radii), "infos[5].geometries[0].radii"},
        {inputs_triangles_with_micromap, offsetof(struct geometry_row, usages), "infos[5].geometries[0].usages"},
        {inputs_triangles_with_micromap, offsetof(struct geometry_row, micromap_indices),
         "infos[5].geometries[0].micromapIndices"},
        {inputs_motion_triangles_with_micromap, offsetof(struct geometry_row, micromap_indices),
         "infos[5].geometries[0].micromapIndices"},
        {inputs_micromap, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_micromap, offsetof(struct geometry_row, usages), "infos[5].geometries[0].usages"},
        {inputs_micromap, offsetof(struct geometry_row, micromap_triangles),
         "infos[5].geometries[0].micromapTriangles"},
        {inputs_baked_micromap, offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {inputs_baked_micromap, offsetof(struct geometry_row, indices), "infos[5].geometries[0].indices"},
        {inputs_baked_micromap, offsetof(struct geometry_row, coordinates), "infos[5].geometries[0].coordinates"},
    };
    for (size_t i = 0; i < sizeof spans / sizeof *spans; i++) {
        struct test_input test;
        spans[i].describe(&test);
        struct payload payload = payload_write(&test.input);
        spoil_span(&payload, spans[i].member, spans[i].where);
        free(payload.bytes);
    }
}

/* Fields that a type does not use are written as 0, and ignored. */
static void other_fields_are_ignored(void **state)
{
    (void)state;
    struct test_input test;
    inputs_aabbs(&test);
    struct payload payload = payload_write(&test.input);
    struct geometry_row row;
    memcpy(&row, payload.bytes, ROWS_GEOMETRY_LEAST);
    assert_true(row.vertex_format == 0 && row.max_vertex == 0 && row.index_type == 0);
    assert_true(row.indices.offset == 0 && row.indices.size == 0);
    assert_true(row.transform.offset == 0 && row.transform.size == 0);
    row.vertex_format = row.max_vertex = row.index_type = 4711;
    row.indices = row.transform = (struct row_span){UINT64_MAX, UINT64_MAX};
    memcpy(payload.bytes, &row, ROWS_GEOMETRY_LEAST);
    struct build_input input;
    assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
    payload_compare_geometries(&test.geometries[0], &input.geometries[0]);
    rows_finish(&input, &payload_memory);
    row.type = 4711; /* whose spans nobody knows */
    row.data = row.indices;
    memcpy(payload.bytes, &row, ROWS_GEOMETRY_LEAST);
    assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
    static const struct geometry_triangles none;
    assert_memory_equal(&input.geometries[0].triangles, &none, sizeof none);
    rows_finish(&input, &payload_memory);
    free(payload.bytes);
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = payload_write(&test.input);
    enum bvhd_status status = BVHD_NO_MEMORY;
    int failures = 0;
    for (; status == BVHD_NO_MEMORY; failures++) {
        struct build_input input = {0};
        atomic_store(&payload_memory.fail_after, failures);
        status = payload_read(&payload, &input, NULL);
        assert_int_equal(input.geometries != NULL, status == BVHD_OK);
        rows_finish(&input, &payload_memory);
        assert_int_equal(payload_memory.live, 0);
    }
    assert_int_equal(status, BVHD_OK);
    assert_int_equal(failures, 3);
    atomic_store(&payload_memory.fail_after, -1);
    free(payload.bytes);
}

struct pieces {
    unsigned char bytes[8192];
    uint64_t size;
    int left; /* pieces until the sink fails */
};

static enum bvhd_status take_piece(void *context, struct bytes piece)
{
    struct pieces *pieces = context;
    if (pieces->left-- == 0)
        return BVHD_IO;
    assert_true(piece.size > 0 && piece.size <= sizeof pieces->bytes - pieces->size);
    memcpy(pieces->bytes + pieces->size, piece.data, piece.size);
    pieces->size += piece.size;
    return BVHD_OK;
}

static void pieces_are_the_same_bytes(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof describe / sizeof *describe; i++) {
        struct test_input test;
        describe[i](&test);
        struct payload payload = payload_write(&test.input);
        enum bvhd_status status = BVHD_IO;
        for (int fails = 0; status == BVHD_IO; fails++) {
            struct pieces pieces = {.left = fails};
            status = rows_stream(&test.input, &payload_memory, take_piece, &pieces);
            assert_int_equal(payload_memory.live, 0);
            if (status == BVHD_OK) {
                assert_int_equal(pieces.size, payload.size);
                assert_memory_equal(pieces.bytes, payload.bytes, payload.size);
                assert_in_range(fails, 2, 20);
            }
        }
        assert_int_equal(status, BVHD_OK);
        struct pieces pieces = {.left = -1};
        payload_memory.fail_after = 0;
        assert_int_equal(rows_stream(&test.input, &payload_memory, take_piece, &pieces), BVHD_NO_MEMORY);
        payload_memory.fail_after = -1;
        test.input.geometry_count = test.input.reference_count = 0;
        assert_int_equal(rows_stream(&test.input, &payload_memory, take_piece, &pieces), BVHD_OK);
        assert_int_equal(pieces.size, 0);
        free(payload.bytes);
    }
}

/* A set flag ends the reading, whatever the rows contain. */
static void a_cancelled_reading_ends(void **state)
{
    (void)state;
    atomic_bool cancel = true;
    struct test_input test;
    inputs_triangles(&test);
    struct payload payload = payload_write(&test.input);
    payload.shape.cancel = &cancel;
    payload_refuse(&payload, BVHD_CANCELLED, "infos[5]");
    cancel = false;
    struct build_input input = {0};
    assert_int_equal(payload_read(&payload, &input, NULL), BVHD_OK);
    rows_finish(&input, &payload_memory);
    free(payload.bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(descriptions_come_back),       cmocka_unit_test(empty_is_not_absent),
        cmocka_unit_test(spans_are_aligned_and_shared), cmocka_unit_test(sizes_that_overflow_are_refused),
        cmocka_unit_test(every_truncation_is_refused),  cmocka_unit_test(rows_outside_are_refused),
        cmocka_unit_test(spans_outside_are_refused),    cmocka_unit_test(other_fields_are_ignored),
        cmocka_unit_test(pieces_are_the_same_bytes),    cmocka_unit_test(failing_allocations_hold_nothing),
        cmocka_unit_test(a_cancelled_reading_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

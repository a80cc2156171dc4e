/* SPDX-License-Identifier: Apache-2.0 */
/* test_rows.c - tests that payloads are read as they were written, and that all others are refused. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/inputs.h"
#include "proto/wire/rows.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

struct payload {
    unsigned char *bytes;
    uint64_t size;
    struct rows_shape shape;
};

static struct payload write_payload(const struct build_input *input)
{
    struct payload payload = {
        .shape = {input->geometry_count, ROWS_GEOMETRY_SIZE, input->reference_count, ROWS_REFERENCE_SIZE, NULL}};
    assert_true(rows_payload_size(input, &payload.size));
    payload.bytes = aligned_alloc(64, payload.size + 64 - payload.size % 64);
    assert_non_null(payload.bytes);
    memset(payload.bytes, 0xee, payload.size + 64 - payload.size % 64);
    rows_write(input, payload.bytes);
    assert_int_equal(payload.bytes[payload.size], 0xee);
    return payload;
}

static enum bvhd_status read_payload(const struct payload *payload, struct build_input *input, struct bvhd_error *error)
{
    return rows_read((struct bytes){payload->bytes, payload->size}, &payload->shape, 5, &memory, input, error);
}

/* Reads a copy of exactly the payload's size, so that a sanitizer detects a read past the end. */
static void refuse(const struct payload *payload, enum bvhd_status want, const char *where)
{
    struct payload exact = *payload;
    struct build_input input = {.type = 77, .geometry_count = 3, .reference_count = 4}, before = input;
    struct bvhd_error error;
    exact.bytes = malloc(payload->size + 1);
    memcpy(exact.bytes, payload->bytes, payload->size);
    exact.bytes = realloc(exact.bytes, payload->size ? payload->size : 1);
    assert_int_equal(read_payload(&exact, &input, &error), want);
    assert_string_equal(error.where, where);
    assert_memory_equal(&input, &before, sizeof input);
    assert_int_equal(memory.live, 0);
    free(exact.bytes);
}

static void compare_bytes(struct bytes a, struct bytes b)
{
    assert_int_equal(a.size, b.size);
    assert_int_equal(a.data == NULL, b.data == NULL);
    if (a.size > 0)
        assert_memory_equal(a.data, b.data, a.size);
}

static void compare_geometries(const struct geometry *a, const struct geometry *b)
{
    assert_int_equal(a->type, b->type);
    assert_int_equal(a->flags, b->flags);
    assert_memory_equal(&a->range, &b->range, sizeof a->range);
    if (a->type == GEOMETRY_TRIANGLES) {
        assert_int_equal(a->triangles.vertex_format, b->triangles.vertex_format);
        assert_int_equal(a->triangles.max_vertex, b->triangles.max_vertex);
        assert_int_equal(a->triangles.vertex_stride, b->triangles.vertex_stride);
        assert_int_equal(a->triangles.index_type, b->triangles.index_type);
        compare_bytes(a->triangles.vertices, b->triangles.vertices);
        compare_bytes(a->triangles.indices, b->triangles.indices);
        compare_bytes(a->triangles.transform, b->triangles.transform);
    } else if (a->type == GEOMETRY_AABBS) {
        assert_int_equal(a->aabbs.stride, b->aabbs.stride);
        compare_bytes(a->aabbs.boxes, b->aabbs.boxes);
    } else if (a->type == GEOMETRY_INSTANCES) {
        compare_bytes(a->instances.records, b->instances.records);
    }
}

static void compare_references(const struct reference *a, const struct reference *b)
{
    assert_int_equal(a->kind, b->kind);
    assert_int_equal(a->handle, b->handle);
    assert_int_equal(a->has_key, b->has_key);
    if (a->has_key)
        assert_memory_equal(&a->key, &b->key, sizeof a->key);
    assert_memory_equal(&a->bounds, &b->bounds, sizeof a->bounds);
    assert_memory_equal(&a->slabs, &b->slabs, sizeof a->slabs);
}

static void round_trip(const struct build_input *input)
{
    struct payload payload = write_payload(input);
    struct build_input back = {.type = 7,
                               .flags = 8,
                               .mode = 9,
                               .destination = 10,
                               .source = 11,
                               .options = {.quality = QUALITY_HIGH, .target = 12, .layout_flags = 13}};
    assert_int_equal(read_payload(&payload, &back, NULL), BVHD_OK);
    assert_true(back.type == 7 && back.flags == 8 && back.mode == 9 && back.destination == 10 && back.source == 11);
    assert_true(back.options.quality == QUALITY_HIGH && back.options.target == 12 && back.options.layout_flags == 13);
    assert_int_equal(back.geometry_count, input->geometry_count);
    assert_int_equal(back.reference_count, input->reference_count);
    for (uint32_t i = 0; i < input->geometry_count; i++)
        compare_geometries(&input->geometries[i], &back.geometries[i]);
    for (uint32_t i = 0; i < input->reference_count; i++)
        compare_references(&input->references[i], &back.references[i]);
    rows_finish(&back, &memory);
    rows_finish(&back, &memory);
    assert_int_equal(memory.live, 0);
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
    inputs_instances(&test);
    test.references[0].bounds.min[0] = -0.0f;
    /* Slabs may have any value. */
    for (int i = 0; i < SLABS_COUNT; i++)
        test.references[1].slabs.min[i] = test.references[1].slabs.max[i] = i ? (float)i : INFINITY;
    test.references[0].kind = (enum reference_kind)99;
    round_trip(&test.input);
    test.input.geometry_count = 0;
    round_trip(&test.input);
    test.input.reference_count = 0;
    round_trip(&test.input);
    rows_finish(NULL, &memory);
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
    return bytes_get64(payload->bytes + geometry * sizeof(struct geometry_row) + member);
}

static void spans_are_aligned_and_shared(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.geometries[0].triangles.vertices.size -= 3;
    test.geometries[1].triangles.vertices.size -= 3;
    struct payload payload = write_payload(&test.input);
    uint64_t first = span_offset(&payload, 0, offsetof(struct geometry_row, data));
    assert_int_equal(span_offset(&payload, 1, offsetof(struct geometry_row, data)), first);
    assert_int_equal(first % ROWS_ALIGNMENT, 0);
    assert_int_equal(span_offset(&payload, 0, offsetof(struct geometry_row, indices)) % ROWS_ALIGNMENT, 0);
    assert_int_equal(payload.size, 2 * 96 + 192 + 16 + 64);
    for (uint64_t at = first + test.geometries[0].triangles.vertices.size; at % ROWS_ALIGNMENT != 0; at++)
        assert_int_equal(payload.bytes[at], 0);
    free(payload.bytes);
    test.geometries[1].triangles.vertices.size++;
    payload = write_payload(&test.input);
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

/*
 * In a payload that is shorter by any number of bytes, rows are missing or spans reach beyond its end. Only padding at
 * the end may be missing.
 */
static void every_truncation_is_refused(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        struct test_input test;
        kind == 0 ? inputs_triangles(&test) : kind == 1 ? inputs_aabbs(&test) : inputs_instances(&test);
        struct payload payload = write_payload(&test.input);
        for (uint64_t size = payload.size - (kind == 1 ? 8 : 0); size-- > 0;) {
            struct payload cut = {payload.bytes, size, payload.shape};
            struct build_input input;
            unsigned char *exact = malloc(size ? size : 1);
            memcpy(exact, payload.bytes, size);
            cut.bytes = exact;
            assert_int_equal(read_payload(&cut, &input, NULL), BVHD_CORRUPT);
            assert_int_equal(memory.live, 0);
            free(exact);
        }
        struct payload longer = {payload.bytes, payload.size + 1, payload.shape}; /* an additional byte is ignored */
        struct build_input input;
        assert_int_equal(read_payload(&longer, &input, NULL), BVHD_OK);
        rows_finish(&input, &memory);
        free(payload.bytes);
    }
}

static void rows_outside_are_refused(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = write_payload(&test.input), other;
    other = payload;
    other.shape.geometry_count = UINT32_MAX;
    refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other.shape.geometry_count = (uint32_t)(payload.size / 96 + 1);
    refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other = payload;
    other.shape.reference_count = UINT32_MAX;
    refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = 0;
    refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = ROWS_REFERENCE_LEAST - 1;
    refuse(&other, BVHD_CORRUPT, "infos[5].references");
    other.shape.reference_size = ROWS_MAX_SIZE + 1;
    refuse(&other, BVHD_TOO_LARGE, "infos[5].references");
    other = payload;
    other.shape.geometry_size = ROWS_GEOMETRY_SIZE - 1;
    refuse(&other, BVHD_CORRUPT, "infos[5].geometries");
    other.shape.geometry_size = UINT32_MAX;
    refuse(&other, BVHD_TOO_LARGE, "infos[5].geometries");
    other.shape.geometry_count = 0; /* then its row size is ignored, and the references come first */
    memmove(payload.bytes, payload.bytes + ROWS_GEOMETRY_SIZE, 3 * ROWS_REFERENCE_SIZE);
    struct build_input input;
    assert_int_equal(read_payload(&other, &input, NULL), BVHD_OK);
    assert_int_equal(input.references[2].handle, 77);
    rows_finish(&input, &memory);
    free(payload.bytes);
}

static void spans_outside_are_refused(void **state)
{
    (void)state;
    static const struct {
        size_t member;
        const char *where;
    } members[] = {
        {offsetof(struct geometry_row, data), "infos[5].geometries[0].data"},
        {offsetof(struct geometry_row, indices), "infos[5].geometries[0].indices"},
        {offsetof(struct geometry_row, transform), "infos[5].geometries[0].transform"},
    };
    struct test_input test;
    inputs_triangles(&test);
    struct payload payload = write_payload(&test.input);
    for (int i = 0; i < 3; i++) {
        const struct row_span wrong[] = {{payload.size, 1},
                                         {payload.size + 1, 0},
                                         {payload.size - 8, 9},
                                         {UINT64_MAX, 1},
                                         {1, UINT64_MAX},
                                         {UINT64_MAX, UINT64_MAX},
                                         {0, 1},
                                         {0, UINT64_MAX},
                                         {UINT64_MAX - 15, 16 + 200}};
        for (size_t k = 0; k < sizeof wrong / sizeof wrong[0]; k++) {
            struct row_span good;
            memcpy(&good, payload.bytes + members[i].member, sizeof good);
            memcpy(payload.bytes + members[i].member, &wrong[k], sizeof good);
            refuse(&payload, BVHD_CORRUPT, members[i].where);
            memcpy(payload.bytes + members[i].member, &good, sizeof good);
        }
    }
    free(payload.bytes);
}

/* Fields that a type does not use are written as 0, and ignored. */
static void other_fields_are_ignored(void **state)
{
    (void)state;
    struct test_input test;
    inputs_aabbs(&test);
    struct payload payload = write_payload(&test.input);
    struct geometry_row row;
    memcpy(&row, payload.bytes, sizeof row);
    assert_true(row.vertex_format == 0 && row.max_vertex == 0 && row.index_type == 0);
    assert_true(row.indices.offset == 0 && row.indices.size == 0);
    assert_true(row.transform.offset == 0 && row.transform.size == 0);
    row.vertex_format = row.max_vertex = row.index_type = 4711;
    row.indices = row.transform = (struct row_span){UINT64_MAX, UINT64_MAX};
    memcpy(payload.bytes, &row, sizeof row);
    struct build_input input;
    assert_int_equal(read_payload(&payload, &input, NULL), BVHD_OK);
    compare_geometries(&test.geometries[0], &input.geometries[0]);
    rows_finish(&input, &memory);
    row.type = 4711; /* whose spans nobody knows */
    row.data = row.indices;
    memcpy(payload.bytes, &row, sizeof row);
    assert_int_equal(read_payload(&payload, &input, NULL), BVHD_OK);
    static const struct geometry_triangles none;
    assert_memory_equal(&input.geometries[0].triangles, &none, sizeof none);
    rows_finish(&input, &memory);
    free(payload.bytes);
}

/* Makes the same description with longer rows, as another version would write them. */
static struct payload stretch(const struct test_input *test, uint32_t geometry_more, uint32_t reference_more)
{
    struct payload from = write_payload(&test->input), to = from;
    uint64_t rows = (uint64_t)from.shape.geometry_count * ROWS_GEOMETRY_SIZE +
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
        memcpy(&row, from.bytes + i * sizeof row, sizeof row);
        row.data.offset += row.data.offset ? more : 0;
        row.indices.offset += row.indices.offset ? more : 0;
        row.transform.offset += row.transform.offset ? more : 0;
        memcpy(at, &row, sizeof row);
    }
    const unsigned char *references = from.bytes + (uint64_t)from.shape.geometry_count * ROWS_GEOMETRY_SIZE;
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
    static const uint32_t more[] = {0, 1, 16, 37, ROWS_MAX_SIZE - ROWS_REFERENCE_SIZE};
    for (size_t i = 0; i < sizeof more / sizeof more[0]; i++) {
        struct payload payload = stretch(&test, more[i], more[i]);
        struct build_input input;
        assert_int_equal(read_payload(&payload, &input, NULL), BVHD_OK);
        compare_geometries(&test.geometries[0], &input.geometries[0]);
        for (int k = 0; k < 3; k++)
            compare_references(&test.references[k], &input.references[k]);
        rows_finish(&input, &memory);
        if (more[i] > 0) {
            unsigned char *last = payload.bytes + payload.shape.geometry_size - 1,
                          *first = payload.bytes + ROWS_GEOMETRY_SIZE;
            *first = 1;
            refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
            *first = 0;
            *last = 1;
            refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
            *last = 0;
            last += 3 * payload.shape.reference_size;
            *last = 0x80;
            refuse(&payload, BVHD_UNSUPPORTED, "infos[5].references[2]");
        }
        free(payload.bytes);
    }
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
        struct payload payload = write_payload(&test.input);
        struct build_input input;
        for (uint32_t i = 0; i < 3; i++)
            memmove(payload.bytes + ROWS_GEOMETRY_SIZE + i * size,
                    payload.bytes + ROWS_GEOMETRY_SIZE + i * ROWS_REFERENCE_SIZE, size);
        payload.shape.reference_size = size;
        assert_int_equal(read_payload(&payload, &input, NULL), BVHD_OK);
        for (int k = 0; k < 3; k++) {
            struct reference want = test.references[k];
            memset((unsigned char *)&want.slabs + (size - ROWS_REFERENCE_LEAST), 0, ROWS_REFERENCE_SIZE - size);
            compare_references(&want, &input.references[k]);
        }
        rows_finish(&input, &memory);
        free(payload.bytes);
    }
}

static void reserved_fields_are_refused(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = write_payload(&test.input);
    unsigned char *reserved = payload.bytes + offsetof(struct geometry_row, reserved);
    bytes_put32(reserved, 1);
    refuse(&payload, BVHD_UNSUPPORTED, "infos[5].geometries[0]");
    bytes_put32(reserved, 0);
    unsigned char *reference = payload.bytes + ROWS_GEOMETRY_SIZE + ROWS_REFERENCE_SIZE;
    bytes_put64(reference + offsetof(struct reference_row, reserved), UINT64_C(1) << 63);
    refuse(&payload, BVHD_UNSUPPORTED, "infos[5].references[1]");
    bytes_put64(reference + offsetof(struct reference_row, reserved), 0);
    bytes_put32(reference + offsetof(struct reference_row, has_key), 2);
    refuse(&payload, BVHD_CORRUPT, "infos[5].references[1]");
    free(payload.bytes);
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct payload payload = write_payload(&test.input);
    enum bvhd_status status = BVHD_NO_MEMORY;
    int failures = 0;
    for (; status == BVHD_NO_MEMORY; failures++) {
        struct build_input input = {0};
        atomic_store(&memory.fail_after, failures);
        status = read_payload(&payload, &input, NULL);
        assert_int_equal(input.geometries != NULL, status == BVHD_OK);
        rows_finish(&input, &memory);
        assert_int_equal(memory.live, 0);
    }
    assert_int_equal(status, BVHD_OK);
    assert_int_equal(failures, 3);
    atomic_store(&memory.fail_after, -1);
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
    static void (*const describe[])(struct test_input * test) = {inputs_triangles, inputs_aabbs, inputs_instances};
    for (int i = 0; i < 3; i++) {
        struct test_input test;
        describe[i](&test);
        struct payload payload = write_payload(&test.input);
        enum bvhd_status status = BVHD_IO;
        for (int fails = 0; status == BVHD_IO; fails++) {
            struct pieces pieces = {.left = fails};
            status = rows_stream(&test.input, &memory, take_piece, &pieces);
            assert_int_equal(memory.live, 0);
            if (status == BVHD_OK) {
                assert_int_equal(pieces.size, payload.size);
                assert_memory_equal(pieces.bytes, payload.bytes, payload.size);
                assert_in_range(fails, 2, 20);
            }
        }
        assert_int_equal(status, BVHD_OK);
        struct pieces pieces = {.left = -1};
        memory.fail_after = 0;
        assert_int_equal(rows_stream(&test.input, &memory, take_piece, &pieces), BVHD_NO_MEMORY);
        memory.fail_after = -1;
        test.input.geometry_count = test.input.reference_count = 0;
        assert_int_equal(rows_stream(&test.input, &memory, take_piece, &pieces), BVHD_OK);
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
    struct payload payload = write_payload(&test.input);
    payload.shape.cancel = &cancel;
    refuse(&payload, BVHD_CANCELLED, "infos[5]");
    cancel = false;
    struct build_input input = {0};
    assert_int_equal(read_payload(&payload, &input, NULL), BVHD_OK);
    rows_finish(&input, &memory);
    free(payload.bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(descriptions_come_back),
        cmocka_unit_test(empty_is_not_absent),
        cmocka_unit_test(spans_are_aligned_and_shared),
        cmocka_unit_test(sizes_that_overflow_are_refused),
        cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(rows_outside_are_refused),
        cmocka_unit_test(spans_outside_are_refused),
        cmocka_unit_test(other_fields_are_ignored),
        cmocka_unit_test(longer_rows_are_read_while_the_rest_is_zero),
        cmocka_unit_test(shorter_rows_lack_their_end),
        cmocka_unit_test(reserved_fields_are_refused),
        cmocka_unit_test(pieces_are_the_same_bytes),
        cmocka_unit_test(failing_allocations_hold_nothing),
        cmocka_unit_test(a_cancelled_reading_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

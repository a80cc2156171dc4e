/* SPDX-License-Identifier: Apache-2.0 */
/* test_record.c - tests that records hold what updates are compared with, and that foreign bytes are checked. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "builder/update/record.h"
#include "builder/workers.h"
#include "tests/support/builder/update_bed.h"
#include "tests/support/random.h"

/* Copies a record, and completes the copy as a build does. */
static struct record_header *complete(const struct record *record)
{
    struct record_header *header = malloc(record->bytes.size);
    memcpy(header, record->bytes.data, record->bytes.size);
    header->quality = QUALITY_BALANCED;
    header->cost = 3.5;
    return header;
}

static struct record_header *complete_input(const struct test_input *input)
{
    struct record record = update_bed_record(input);
    struct record_header *header = complete(&record);
    record_finish(&record, &bed_memory);
    record_finish(&record, &bed_memory);
    assert_int_equal(bed_memory.live, 0);
    return header;
}

static void records_hold_what_is_compared(void **state)
{
    static struct test_input input;
    (void)state;
    inputs_triangles(&input);
    input.input.flags = BUILD_ALLOW_UPDATE | BUILD_PREFER_FAST_TRACE;
    input.input.options.layout_flags = PORTABLE_FAST_TRIANGLES;
    struct record_header *bytes = complete_input(&input);
    struct record record;
    assert_int_equal(record_open((struct bytes){(unsigned char *)bytes, bytes->size}, &record, NULL), BVHD_OK);
    assert_int_equal(record.header->version, 1);
    assert_int_equal(record.header->type, STRUCTURE_BOTTOM);
    assert_int_equal(record.header->flags, BUILD_ALLOW_UPDATE | BUILD_PREFER_FAST_TRACE);
    assert_int_equal(record.header->layout_flags, PORTABLE_FAST_TRIANGLES);
    assert_int_equal(record.header->primitive_count, 5);
    assert_int_equal(record.header->refits, 0);
    assert_int_equal(record.geometries[0].indexed, 1);
    assert_int_equal(record.geometries[0].has_transform, 1);
    assert_int_equal(record.geometries[0].index_type, INDEX_UINT16);
    assert_int_equal(record.geometries[1].has_transform, 0);
    assert_int_equal(record.geometries[1].index_type, INDEX_NONE);
    assert_int_equal(record.geometries[1].max_vertex, 8);
    assert_null(record.active);
    for (uint32_t i = 0; i < 5; i++)
        assert_true(record_is_active(&record, i));
    free(bytes);
}

static void records_hold_formats_and_modes(void **state)
{
    static struct test_input input;
    (void)state;
    for (int swept = 0; swept < 2; swept++) {
        if (swept)
            inputs_swept_spheres(&input);
        else
            inputs_spheres(&input);
        input.input.flags = BUILD_ALLOW_UPDATE;
        input.vertices[2][3] = NAN; /* the third sphere of the second geometry, and an end of its second swept one */
        struct record_header *bytes = complete_input(&input);
        struct record record;
        assert_int_equal(record_open((struct bytes){(unsigned char *)bytes, bytes->size}, &record, NULL), BVHD_OK);
        assert_int_equal(record.header->version, 2);
        for (int g = 0; g < 2; g++) {
            assert_int_equal(record.geometries[g].vertex_format, 106);
            assert_int_equal(record.geometries[g].radius_format, 100);
            assert_int_equal(record.geometries[g].index_type, g ? INDEX_NONE : INDEX_UINT16);
        }
        assert_int_equal(record.geometries[0].swept_modes, swept ? FORM_SWEPT_SUCCESSIVE | FORM_SWEPT_CHAINED : 0);
        assert_int_equal(record.geometries[1].swept_modes, 0);
        for (uint32_t i = 0; i < 3; i++)
            assert_int_equal(record_is_active(&record, 6 + i), i != (swept ? 1 : 2));
        free(bytes);
    }
}

/* Rows of what moves make the version newer, wherever they are. What stands still under the flag keeps the oldest. */
static void records_of_motion_hold_their_rows(void **state)
{
    static const uint32_t types[4][2] = {{GEOMETRY_MOVING_TRIANGLES, GEOMETRY_MOVING_TRIANGLES},
                                         {GEOMETRY_MOVING_TRIANGLES, GEOMETRY_TRIANGLES},
                                         {GEOMETRY_TRIANGLES, GEOMETRY_MOVING_TRIANGLES},
                                         {GEOMETRY_TRIANGLES, GEOMETRY_TRIANGLES}};
    static struct test_input input;
    (void)state;
    for (int i = 0; i < 4; i++) {
        inputs_motion_triangles(&input);
        input.geometries[0].type = types[i][0];
        input.geometries[1].type = types[i][1];
        input.input.flags |= BUILD_ALLOW_UPDATE;
        struct record_header *bytes = complete_input(&input);
        struct record record;
        assert_int_equal(record_open((struct bytes){(unsigned char *)bytes, bytes->size}, &record, NULL), BVHD_OK);
        assert_int_equal(record.header->version, i == 3 ? 1 : 3);
        assert_int_equal(record_type_of(&record), i == 3 ? GEOMETRY_TRIANGLES : GEOMETRY_MOVING_TRIANGLES);
        for (int g = 0; g < 2; g++) {
            assert_int_equal(record.geometries[g].type, input.geometries[g].type);
            assert_int_equal(record.geometries[g].has_transform, g == 0);
            assert_int_equal(record.geometries[g].max_vertex, 8);
            assert_int_equal(record.geometries[g].index_type, g ? INDEX_NONE : INDEX_UINT16);
        }
        free(bytes);
    }
}

/* A NaN at either end makes a primitive inactive, if its type uses that number. */
static void either_end_can_be_inactive(void **state)
{
    static struct test_input input;
    (void)state;
    for (int end = 0; end < 2; end++) {
        inputs_mixed_triangles(&input);
        input.input.flags |= BUILD_ALLOW_UPDATE;
        (end ? input.end_vertices : input.vertices)[4][1] = NAN; /* of geometry 1, which has no other end */
        (end ? input.end_vertices : input.vertices)[3][2] = NAN; /* a corner of geometry 0's second triangle, too */
        struct record record = update_bed_record(&input);
        for (uint32_t i = 0; i < 5; i++)
            assert_int_equal(record_is_active(&record, i), end ? i > 1 : i != 0 && i != 1 && i != 3);
        record_finish(&record, &bed_memory);
    }
    inputs_mixed_triangles(&input); /* the geometry that stands still comes first */
    const struct geometry first = input.geometries[0];
    input.geometries[0] = input.geometries[1];
    input.geometries[1] = first;
    input.input.flags |= BUILD_ALLOW_UPDATE;
    input.end_vertices[4][1] = NAN;
    struct record reversed = update_bed_record(&input);
    for (uint32_t i = 0; i < 5; i++)
        assert_int_equal(record_is_active(&reversed, i), i != 4);
    record_finish(&reversed, &bed_memory);
    inputs_motion_instances(&input);
    input.input.flags |= BUILD_ALLOW_UPDATE;
    inputs_set_motion_record(&input, 1, MOTION_STATIC, 55, 0);
    inputs_set_motion_record(&input, 4, MOTION_MATRIX, 55, 0);
    memcpy(&input.motion_records[0][20], &(float){NAN}, 4); /* behind what a static one has */
    memcpy(&input.motion_records[2][25], &(float){NAN}, 4); /* the last number of the matrix at t = 1 */
    memcpy(&input.motion_records[3][33], &(float){NAN}, 4); /* the last number of the SRT at t = 1 */
    struct record record = update_bed_record(&input);
    assert_int_equal(record.header->version, 3);
    for (uint32_t i = 0; i < INPUTS_MOTION_RECORDS; i++)
        assert_int_equal(record_is_active(&record, i), i != 2 && i != 3);
    record_finish(&record, &bed_memory);
}

static void inactive_primitives_have_a_bit(void **state)
{
    static struct test_input input;
    (void)state;
    inputs_instances(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    struct record record = update_bed_record(&input);
    assert_int_equal(record.header->inactive_count, 1);
    for (uint32_t i = 0; i < INPUTS_RECORDS; i++)
        assert_int_equal(record_is_active(&record, i), i != 1);
    record_finish(&record, &bed_memory);
}

/* NaNs of vertices between those in use make nothing inactive, and leave no bits. */
static void unused_vertices_do_not_count(void **state)
{
    static const float vertices[4][3] = {{0, 0, 0}, {NAN, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const uint16_t indices[3] = {0, 2, 3};
    static struct test_input input;
    (void)state;
    inputs_triangles(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    input.input.geometry_count = 1;
    input.geometries[0].range = (struct geometry_range){.primitive_count = 1};
    input.geometries[0].triangles.vertex_stride = 12;
    input.geometries[0].triangles.max_vertex = 3;
    input.geometries[0].triangles.vertices = (struct bytes){(const unsigned char *)vertices, sizeof vertices};
    input.geometries[0].triangles.indices = (struct bytes){(const unsigned char *)indices, sizeof indices};
    input.geometries[0].triangles.transform = (struct bytes){NULL, 0};
    struct record record = update_bed_record(&input);
    assert_int_equal(record.header->inactive_count, 0);
    assert_null(record.active);
    record_finish(&record, &bed_memory);
}

/* Makes one mesh of many triangles with some NaNs, in geometries of uneven sizes, some of them empty. */
struct large {
    float vertices[9000][3];
    uint32_t indices[3 * 50000];
    struct geometry geometries[7];
    struct build_input input;
};

static struct large *make_large(bool nans)
{
    static const uint32_t counts[7] = {0, 1, 20000, 0, 63, 29000, 936};
    struct large *large = calloc(1, sizeof *large);
    struct random random = {77};
    uint32_t first = 0;
    for (int i = 0; i < 9000; i++)
        for (int k = 0; k < 3; k++)
            large->vertices[i][k] = (float)random_between(&random, -1, 1);
    for (int i = 0; nans && i < 40; i++)
        large->vertices[(uint32_t)(random_next(&random) % 9000)][(uint32_t)(random_next(&random) % 3)] = NAN;
    for (int i = 0; i < 3 * 50000; i++)
        large->indices[i] = (uint32_t)(random_next(&random) % 9000);
    for (int g = 0; g < 7; g++) {
        large->geometries[g] = (struct geometry){
            .type = GEOMETRY_TRIANGLES,
            .triangles = {.vertex_format = 106,
                          .max_vertex = 8999,
                          .vertex_stride = 12,
                          .index_type = INDEX_UINT32,
                          .vertices = {(const unsigned char *)large->vertices, sizeof large->vertices},
                          .indices = {(const unsigned char *)(large->indices + 3 * first), 12 * (uint64_t)counts[g]}},
            .range = {.primitive_count = counts[g]},
        };
        first += counts[g];
    }
    large->input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                        .flags = BUILD_ALLOW_UPDATE,
                                        .geometry_count = 7,
                                        .geometries = large->geometries,
                                        .options.target = TARGET_PORTABLE};
    return large;
}

static struct canonical prepare_large(const struct large *large)
{
    struct limits limits = limits_default();
    struct canonical canonical;
    assert_int_equal(prepare(&large->input, 0, &limits, &bed_context, &canonical, NULL), BVHD_OK);
    return canonical;
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    for (int nans = 0; nans < 2; nans++) {
        struct large *large = make_large(nans);
        struct canonical canonical = prepare_large(large);
        struct record first, second;
        struct workers *workers;
        assert_int_equal(record_make(&canonical, &large->input.options, &bed_context, &first, NULL), BVHD_OK);
        assert_int_equal(workers_create(5, &workers, NULL), BVHD_OK);
        const struct build_context context = {.memory = &bed_memory, .parallel = workers_parallel(workers)};
        assert_int_equal(record_make(&canonical, &large->input.options, &context, &second, NULL), BVHD_OK);
        assert_int_equal(first.bytes.size, second.bytes.size);
        assert_memory_equal(first.bytes.data, second.bytes.data, first.bytes.size);
        assert_int_equal(first.active != NULL, nans);
        uint32_t inactive = 0;
        for (uint32_t i = 0; i < canonical.primitive_count; i++) {
            float sum = 0;
            for (int k = 0; k < 3; k++)
                for (int axis = 0; axis < 3; axis++)
                    sum += large->vertices[large->indices[3 * i + (uint32_t)k]][axis];
            assert_int_equal(record_is_active(&first, i), !isnan(sum));
            inactive += isnan(sum) != 0;
        }
        assert_int_equal(first.header->inactive_count, inactive);
        workers_destroy(workers);
        record_finish(&first, &bed_memory);
        record_finish(&second, &bed_memory);
        bed_finish(&canonical);
        free(large);
    }
}

static void failures_leave_nothing(void **state)
{
    struct large *large = make_large(true);
    struct canonical canonical = prepare_large(large);
    const uint64_t live = bed_memory.live;
    struct record record;
    struct bvhd_error error;
    atomic_bool cancel = true;
    const struct build_context cancelled = {.memory = &bed_memory, .parallel = &parallel_serial, .cancel = &cancel};
    (void)state;
    assert_int_equal(record_make(&canonical, &large->input.options, &cancelled, &record, &error), BVHD_CANCELLED);
    bed_memory.fail_after = 0;
    assert_int_equal(record_make(&canonical, &large->input.options, &bed_context, &record, &error), BVHD_NO_MEMORY);
    assert_int_equal(bed_memory.live, live);
    bed_finish(&canonical);
    free(large);
}

static enum bvhd_status open_bytes(const void *bytes, uint64_t size, struct bvhd_error *error)
{
    struct record record;
    *error = (struct bvhd_error){.where = "", .text = ""};
    return record_open((struct bytes){bytes, size}, &record, error);
}

/* A wrong value in a record, and what the reader says. */
struct damage {
    size_t offset;
    uint32_t value;
    enum bvhd_status status;
    const char *where;
};

#define HEADER(field) offsetof(struct record_header, field)
#define ROW(field) (sizeof(struct record_header) + offsetof(struct record_geometry, field))

static const struct damage damages[] = {
    {HEADER(magic), 0, BVHD_CORRUPT, "record.magic"},
    {HEADER(version), 0, BVHD_INCOMPATIBLE, "record.version"},
    {HEADER(version), RECORD_NEWEST + 1, BVHD_INCOMPATIBLE, "record.version"},
    {HEADER(version), 2, BVHD_CORRUPT, "record.geometries[0]"},
    {HEADER(size), 0, BVHD_CORRUPT, "record.size"},
    {HEADER(geometry_count), 3, BVHD_CORRUPT, "record.size"},
    {HEADER(geometry_count), UINT32_MAX, BVHD_CORRUPT, "record.size"},
    {HEADER(type), 2, BVHD_CORRUPT, "record.type"},
    {HEADER(type), STRUCTURE_TOP, BVHD_CORRUPT, "record.geometries[0]"},
    {HEADER(flags), 0, BVHD_CORRUPT, "record.flags"},
    {HEADER(primitive_count), 4, BVHD_CORRUPT, "record.primitiveCount"},
    {HEADER(inactive_count), 1, BVHD_CORRUPT, "record.size"},
    {HEADER(target), 9, BVHD_CORRUPT, "record.target"},
    {HEADER(layout_flags), 2, BVHD_CORRUPT, "record.layoutFlags"},
    {HEADER(device.variant), 1, BVHD_CORRUPT, "record.device"},
    {HEADER(device), 1, BVHD_CORRUPT, "record.device"},
    {HEADER(quality), QUALITY_UNSPECIFIED, BVHD_CORRUPT, "record.quality"},
    {HEADER(quality), QUALITY_AUTO, BVHD_CORRUPT, "record.quality"},
    {HEADER(cost) + 4, 0x7ff00000, BVHD_CORRUPT, "record.cost"},
    {HEADER(cost) + 4, 0xbff00000, BVHD_CORRUPT, "record.cost"},
    {HEADER(reserved), 1, BVHD_CORRUPT, "record.reserved"},
    {HEADER(reserved) + 8, 1, BVHD_CORRUPT, "record.reserved"},
    {ROW(type), GEOMETRY_INSTANCES, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(type), GEOMETRY_AABBS, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(primitive_count), 3, BVHD_CORRUPT, "record.primitiveCount"},
    {ROW(indexed), 2, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(indexed), 0, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(has_transform), 2, BVHD_CORRUPT, "record.geometries[0]"},
};

static void foreign_bytes_are_checked(void **state)
{
    static struct test_input input;
    struct bvhd_error error;
    (void)state;
    inputs_triangles(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    struct record_header *good = complete_input(&input);
    const uint64_t size = good->size;
    unsigned char *bytes = malloc(size + 1);
    memcpy(bytes, good, size);
    bytes[size] = 0;
    assert_int_equal(open_bytes(bytes, size, &error), BVHD_OK);
    assert_int_equal(open_bytes(bytes, size + 1, &error), BVHD_CORRUPT);
    for (uint64_t shorter = 0; shorter < size; shorter++) {
        void *cut = malloc(shorter ? shorter : 1);
        memcpy(cut, good, shorter);
        assert_int_equal(open_bytes(cut, shorter, &error), BVHD_CORRUPT);
        free(cut);
    }
    for (size_t i = 0; i < sizeof damages / sizeof *damages; i++) {
        memcpy(bytes, good, size);
        memcpy(bytes + damages[i].offset, &damages[i].value, sizeof damages[i].value);
        assert_int_equal(open_bytes(bytes, size, &error), damages[i].status);
        assert_string_equal(error.where, damages[i].where);
    }
    free(bytes);
    free(good);
}

static const struct damage swept_damages[] = {
    {HEADER(version), 1, BVHD_CORRUPT, "record.geometries[0]"},
    {HEADER(version), RECORD_NEWEST + 1, BVHD_INCOMPATIBLE, "record.version"},
    {HEADER(target), TARGET_LAVAPIPE, BVHD_CORRUPT, "record.device"},
    {ROW(type), GEOMETRY_SPHERES, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(type), GEOMETRY_TRIANGLES, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(indexed), 2, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(indexed), 0, BVHD_CORRUPT, "record.geometries[0]"},
    {ROW(swept_modes), 4, BVHD_CORRUPT, "record.geometries[0]"},
};

static void foreign_rows_of_new_kinds_are_checked(void **state)
{
    static struct test_input input;
    struct bvhd_error error;
    (void)state;
    inputs_swept_spheres(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    struct record_header *bytes = complete_input(&input), *copy = malloc(bytes->size);
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_OK);
    for (size_t i = 0; i < sizeof swept_damages / sizeof *swept_damages; i++) {
        memcpy(copy, bytes, bytes->size);
        memcpy((char *)copy + swept_damages[i].offset, &swept_damages[i].value, 4);
        assert_int_equal(open_bytes(copy, bytes->size, &error), swept_damages[i].status);
        assert_string_equal(error.where, swept_damages[i].where);
    }
    /* No native structure has such geometries. */
    memcpy(copy, bytes, bytes->size);
    copy->target = TARGET_LAVAPIPE;
    copy->device.variant = 1;
    assert_int_equal(open_bytes(copy, bytes->size, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.geometries[0]");
    /* Without rows nothing is new. */
    memcpy(copy, bytes, sizeof *bytes);
    copy->size = sizeof *bytes;
    copy->geometry_count = copy->primitive_count = copy->inactive_count = 0;
    assert_int_equal(open_bytes(copy, sizeof *bytes, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.version");
    copy->version = 1;
    assert_int_equal(open_bytes(copy, sizeof *bytes, &error), BVHD_OK);
    free(copy);
    free(bytes);
}

/* A wrong value in a record of motion, and the row that the reader names. */
struct motion_damage {
    size_t offset;
    uint32_t value;
    uint32_t row;
};

#define SECOND(field) (ROW(field) + sizeof(struct record_geometry))

static void check_motion_damages(const struct test_input *input, const struct motion_damage *wrong, size_t count)
{
    struct record_header *bytes = complete_input(input), *copy = malloc(bytes->size);
    struct bvhd_error error;
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_OK);
    for (size_t i = 0; i < count; i++) {
        memcpy(copy, bytes, bytes->size);
        memcpy((char *)copy + wrong[i].offset, &wrong[i].value, 4);
        assert_int_equal(open_bytes(copy, bytes->size, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, wrong[i].row ? "record.geometries[1]" : "record.geometries[0]");
    }
    free(copy);
    free(bytes);
}

static void foreign_rows_of_motion_are_checked(void **state)
{
    static const uint32_t motion = BUILD_ALLOW_UPDATE | BUILD_MOTION;
    static const struct motion_damage mixed[] = {
        {HEADER(version), 1, 0},
        {HEADER(version), 2, 0},
        {HEADER(flags), BUILD_ALLOW_UPDATE, 0},
        {HEADER(type), STRUCTURE_TOP, 0},
        {ROW(type), GEOMETRY_TRIANGLES, 0}, /* the version has rows of what moves, and there are none */
        {ROW(type), GEOMETRY_MOVING_INSTANCES, 0},
        {SECOND(type), GEOMETRY_INSTANCES, 1},
        {SECOND(type), GEOMETRY_MOVING_INSTANCES, 1},
        {SECOND(type), GEOMETRY_SPHERES, 1}, /* sound by itself, but not beside triangles */
        {ROW(indexed), 2, 0},
        {SECOND(has_transform), 2, 1},
    };
    static const struct motion_damage top[] = {
        {HEADER(version), 1, 0},
        {HEADER(flags), BUILD_ALLOW_UPDATE, 0},
        {HEADER(type), STRUCTURE_BOTTOM, 0},
        {ROW(type), GEOMETRY_INSTANCES, 0},
        {ROW(type), GEOMETRY_MOVING_TRIANGLES, 0},
        {ROW(max_vertex), 1, 0},
    };
    static const struct motion_damage still[] = {{HEADER(flags), motion, 0}};
    static struct test_input input;
    (void)state;
    inputs_mixed_triangles(&input);
    input.input.flags = motion;
    check_motion_damages(&input, mixed, sizeof mixed / sizeof *mixed);
    inputs_motion_instances(&input);
    input.input.flags = motion;
    check_motion_damages(&input, top, sizeof top / sizeof *top);
    inputs_instances(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    check_motion_damages(&input, still, 1);
}

static void foreign_bits_are_checked(void **state)
{
    static struct test_input input;
    struct bvhd_error error;
    (void)state;
    inputs_aabbs(&input);
    input.input.flags = BUILD_ALLOW_UPDATE;
    struct record_header *bytes = complete_input(&input);
    uint64_t *bits = (void *)((unsigned char *)bytes + bytes->size - 8);
    assert_int_equal(*bits, 3);
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_OK);
    *bits = 7;
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.active");
    *bits = 9;
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_CORRUPT);
    *bits = 5;
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_OK);
    bytes->inactive_count = 4;
    assert_int_equal(open_bytes(bytes, bytes->size, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.inactiveCount");
    free(bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_hold_what_is_compared),
        cmocka_unit_test(records_of_motion_hold_their_rows),
        cmocka_unit_test(either_end_can_be_inactive),
        cmocka_unit_test(inactive_primitives_have_a_bit),
        cmocka_unit_test(unused_vertices_do_not_count),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failures_leave_nothing),
        cmocka_unit_test(foreign_bytes_are_checked),
        cmocka_unit_test(foreign_bits_are_checked),
        cmocka_unit_test(records_hold_formats_and_modes),
        cmocka_unit_test(foreign_rows_of_new_kinds_are_checked),
        cmocka_unit_test(foreign_rows_of_motion_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

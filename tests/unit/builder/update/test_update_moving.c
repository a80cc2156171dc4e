/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_update_moving.c - tests what the refit does with the records of a node that move, and which primitives are
 * active. test_update_rules.c has the rules, and test_refit.c whole updates.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/input/primitive.h"
#include "builder/update/update_kind.h"
#include "tests/support/builder/update_bed.h"

enum { VERTICES = 6, RECORDS = 3, PRIMITIVES = 9 };

/* The records of a source of motion triangles, and room for the new ones. */
struct bed {
    struct portable_header header;
    struct portable_indexed_triangle source[RECORDS], written[RECORDS];
    struct portable_moving_vertex vertices[VERTICES];
    struct portable_view view;
    struct refit_records records;
};

static void init(struct bed *bed)
{
    static const struct portable_indexed_triangle records[RECORDS] = {
        {{0, 1, 2}, 8 | PORTABLE_ID_OPAQUE}, {{5, 4, 3}, 0}, {{2, 2, 5}, 5}};
    *bed = (struct bed){
        .header = {.content = PORTABLE_MOVING_TRIANGLES, .vertex_count = VERTICES, .primitive_count = PRIMITIVES}};
    memcpy(bed->source, records, sizeof records);
    for (int i = 0; i < VERTICES; i++)
        bed->vertices[i] =
            (struct portable_moving_vertex){{(float)i, (float)(i * i), 1}, {(float)-i, (float)(i % 3), (float)(2 * i)}};
    bed->view = (struct portable_view){.header = &bed->header, .records = bed->source};
    bed->records = (struct refit_records){
        .source = &bed->view,
        .written = {.kind = &record_moving_triangles, .records = (unsigned char *)bed->written},
        .vertices = bed->vertices[0].start,
    };
}

static bool write_triangles(const struct bed *bed)
{
    return update_moving_triangles.write(&bed->records, 0, RECORDS);
}

/* A record names three vertices and a primitive, which must be there. */
static void records_of_triangles_are_copied_or_refused(void **state)
{
    static struct bed bed;
    (void)state;
    init(&bed);
    assert_true(update_moving_triangles.write(&bed.records, 1, 2));
    assert_int_equal(bed.written[0].id, 0);
    assert_memory_equal(&bed.written[1], &bed.source[1], 2 * sizeof *bed.source);
    for (int k = 0; k < 3; k++) {
        init(&bed);
        bed.source[2].vertices[k] = VERTICES - 1;
        assert_true(write_triangles(&bed));
        bed.source[2].vertices[k] = VERTICES;
        assert_false(write_triangles(&bed));
    }
    init(&bed);
    bed.source[0].id = PRIMITIVES | PORTABLE_ID_OPAQUE;
    assert_false(write_triangles(&bed));
    assert_true(update_moving_triangles.write(&bed.records, 1, 2));
}

/* Leaves of one record and of two get the boxes of their corners at both ends, cut to the range of floats. */
static void boxes_are_those_of_both_ends(void **state)
{
    static const uint8_t counts[8] = {0, 1, 0, 0, 2, 0, 0, 0};
    static struct bed bed;
    struct refit_node leaves[2][8];
    (void)state;
    init(&bed);
    bed.vertices[1].end[1] = INFINITY;
    bed.vertices[3].start[2] = -INFINITY;
    assert_true(write_triangles(&bed));
    update_moving_triangles.key_boxes(&bed.records, 0, counts, leaves);
    const struct box first[2] = {{{0, 0, 1}, {2, 4, 1}}, {{-2, 0, 0}, {0, FLT_MAX, 4}}},
                     others[2] = {{{2, 4, -FLT_MAX}, {5, 25, 1}}, {{-5, 0, 4}, {-2, 2, 10}}};
    for (int key = 0; key < 2; key++) {
        assert_memory_equal(&leaves[key][1].box, &first[key], sizeof first[key]);
        assert_memory_equal(&leaves[key][4].box, &others[key], sizeof others[key]);
    }
}

/* A NaN in any of the six numbers of a vertex makes the triangles inactive that name it, unless they stand still. */
static void every_number_of_a_vertex_counts(void **state)
{
    static const uint32_t indices[2][3] = {{4, 3, 5}, {0, 1, 2}};
    (void)state;
    for (int k = 0; k < 6 * VERTICES; k++) {
        float positions[2][VERTICES][3] = {{{0}}};
        const int end = k / (3 * VERTICES), vertex = k / 3 % VERTICES;
        struct canonical_geometry geometry = {.type = GEOMETRY_MOVING_TRIANGLES,
                                              .primitive_count = 2,
                                              .vertex_count = VERTICES,
                                              .positions = positions[0][0],
                                              .end_positions = positions[1][0],
                                              .indices = indices[0]};
        positions[end][vertex][k % 3] = NAN;
        const uint64_t inactive = vertex >= 3 ? 1 : 2;
        assert_int_equal(update_moving_triangles.active(&geometry, 0, 2), 3 ^ inactive);
        assert_int_equal(update_moving_triangles.active(&geometry, 1, 1), (3 ^ inactive) >> 1);
        assert_true(update_moving_triangles.has_nan(&geometry, (size_t)vertex, 1));
        assert_int_equal(update_moving_triangles.has_nan(&geometry, 2, 4), vertex >= 2);
        geometry.end_positions = NULL;
        assert_int_equal(update_triangles.active(&geometry, 0, 2), 3 ^ (end ? 0 : inactive));
    }
}

/* Makes the canonical copy of the instances of inputs.h, and their record. */
static struct canonical make_instances(struct test_input *input, struct record *ret_record)
{
    inputs_motion_instances(input);
    input->input.flags |= BUILD_ALLOW_UPDATE;
    *ret_record = update_bed_record(input);
    return bed_make(input);
}

/* The records are written anew; only numbers of active instances lead to one. */
static void records_of_instances_are_written_or_refused(void **state)
{
    static struct test_input input;
    struct portable_moving_instance source[RECORDS] = {{.instance = 3}, {.instance = 0}, {.instance = 2}},
                                    written[RECORDS];
    struct record record;
    struct canonical canonical = make_instances(&input, &record);
    const struct portable_header header = {.content = PORTABLE_MOVING_INSTANCES,
                                           .primitive_count = INPUTS_MOTION_RECORDS};
    const struct portable_view view = {.header = &header, .records = source};
    const struct refit_records records = {
        .source = &view,
        .record = &record,
        .written = {.kind = &record_moving_instances, .canonical = &canonical, .records = (unsigned char *)written}};
    (void)state;
    assert_true(update_moving_instances.write(&records, 0, RECORDS));
    for (int i = 0; i < RECORDS; i++) {
        const struct canonical_motion motion = canonical_motion(canonical.geometries, source[i].instance);
        assert_int_equal(written[i].instance, source[i].instance);
        assert_int_equal(written[i].motion, motion.type);
        assert_memory_equal(written[i].start, motion.start, sizeof motion.start);
        assert_memory_equal(written[i].end, motion.end, sizeof motion.end);
    }
    static const uint8_t counts[8] = {1, 0, 0, 2};
    struct refit_node leaves[2][8];
    struct box boxes[RECORDS][2];
    for (int i = 0; i < RECORDS; i++)
        primitive_key_boxes(&canonical, canonical.geometries, source[i].instance, boxes[i]);
    update_moving_instances.key_boxes(&records, 0, counts, leaves);
    for (int key = 0; key < 2; key++) {
        box_grow(&boxes[1][key], &boxes[2][key]);
        assert_memory_equal(&leaves[key][0].box, &boxes[0][key], sizeof boxes[0][key]);
        assert_memory_equal(&leaves[key][3].box, &boxes[1][key], sizeof boxes[1][key]);
    }
    static const uint32_t wrong[] = {1, 4, INPUTS_MOTION_RECORDS, UINT32_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        source[1].instance = wrong[i];
        assert_false(update_moving_instances.write(&records, 0, RECORDS));
        assert_true(update_moving_instances.write(&records, 2, 1));
    }
    record_finish(&record, &bed_memory);
    bed_finish(&canonical);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_of_triangles_are_copied_or_refused),
        cmocka_unit_test(boxes_are_those_of_both_ends),
        cmocka_unit_test(every_number_of_a_vertex_counts),
        cmocka_unit_test(records_of_instances_are_written_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_update_round.c - tests what the refit does with the records of a node, and which primitives are active.
 * test_update_rules.c has the rules, and test_refit.c whole updates.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/swept_shape.h"
#include "builder/update/update_kind.h"

enum { VERTICES = 6, RECORDS = 3, PRIMITIVES = 9 };

/* The records of a source, and room for the new ones. */
struct bed {
    struct portable_header header;
    struct portable_round source[RECORDS], written[RECORDS];
    float vertices[VERTICES][4];
    struct portable_view view;
    struct refit_records records;
};

static void init(struct bed *bed, enum portable_content content)
{
    static const struct portable_round records[RECORDS] = {
        {0, 8 | PORTABLE_ID_OPAQUE}, {4, 0}, {2, 5 | PORTABLE_ID_CAP_FIRST}};
    *bed = (struct bed){.header = {.content = content, .vertex_count = VERTICES, .primitive_count = PRIMITIVES}};
    memcpy(bed->source, records, sizeof records);
    for (int i = 0; i < VERTICES; i++)
        memcpy(bed->vertices[i], (float[4]){(float)i, (float)(i * i), 1, 0.25f * (float)(i + 1)}, 16);
    bed->view = (struct portable_view){.header = &bed->header, .records = bed->source};
    bed->records = (struct refit_records){
        .source = &bed->view,
        .written = {.kind = record_kind_of(content), .records = (unsigned char *)bed->written},
        .vertices = bed->vertices[0],
    };
}

static const struct update_kind *kind_of(const struct bed *bed)
{
    return update_kind_of(bed->records.written.kind->type);
}

/* A record names one vertex, or this one and the next, which must be there, and a primitive. */
static void records_are_copied_or_refused(void **state)
{
    (void)state;
    for (uint32_t ends = 1; ends <= 2; ends++) {
        static struct bed bed;
        init(&bed, ends == 1 ? PORTABLE_SPHERES : PORTABLE_SWEPT_SPHERES);
        const struct update_kind *kind = kind_of(&bed);
        assert_true(kind->write(&bed.records, 1, 2));
        assert_int_equal(bed.written[0].id, 0);
        assert_memory_equal(&bed.written[1], &bed.source[1], 2 * sizeof *bed.source);
        bed.source[2].vertex = VERTICES - ends;
        assert_true(kind->write(&bed.records, 0, 3));
        bed.source[2].vertex = VERTICES - ends + 1;
        assert_false(kind->write(&bed.records, 0, 3));
        assert_true(kind->write(&bed.records, 0, 2));
        bed.source[2].vertex = UINT32_MAX;
        assert_false(kind->write(&bed.records, 0, 3));
        bed.source[2].vertex = 0;
        bed.source[2].id = PRIMITIVES;
        assert_false(kind->write(&bed.records, 0, 3));
        bed.source[2].id = PRIMITIVES - 1;
        assert_true(kind->write(&bed.records, 0, 3));
        bed.header.vertex_count = ends - 1;
        assert_false(kind->write(&bed.records, 0, 1));
    }
}

/* Leaves of one record and of two get the boxes of the shapes, with their caps. */
static void boxes_are_those_of_the_shapes(void **state)
{
    static const uint8_t counts[8] = {0, 1, 0, 0, 2, 0, 0, 0};
    (void)state;
    for (int swept = 0; swept < 2; swept++) {
        static struct bed bed;
        struct refit_node leaves[8];
        struct box boxes[RECORDS];
        init(&bed, swept ? PORTABLE_SWEPT_SPHERES : PORTABLE_SPHERES);
        assert_true(kind_of(&bed)->write(&bed.records, 0, RECORDS));
        kind_of(&bed)->boxes(&bed.records, 0, counts, leaves);
        for (int i = 0; i < RECORDS; i++) {
            const float *ends = bed.vertices[bed.source[i].vertex];
            boxes[i] =
                swept ? swept_shape_box(ends, ends + 4, i == 2 ? SWEPT_SHAPE_CAP_FIRST : 0) : swept_shape_sphere(ends);
        }
        box_grow(&boxes[1], &boxes[2]);
        assert_memory_equal(&leaves[1].box, &boxes[0], sizeof boxes[0]);
        assert_memory_equal(&leaves[4].box, &boxes[1], sizeof boxes[1]);
    }
}

/* A NaN in any of the eight numbers of two ends makes a linear swept sphere inactive. */
static void every_number_counts(void **state)
{
    static const uint32_t indices[3] = {4 | CANONICAL_CAP_FIRST, 0, 2 | CANONICAL_CAP_SECOND};
    (void)state;
    for (int k = 0; k < 4 * VERTICES; k++) {
        float vertices[VERTICES][4] = {{0}};
        const uint32_t vertex = (uint32_t)k / 4;
        struct canonical_geometry geometry = {.type = GEOMETRY_SWEPT_SPHERES,
                                              .primitive_count = 3,
                                              .vertex_count = VERTICES,
                                              .positions = vertices[0],
                                              .indices = indices};
        vertices[vertex][k % 4] = NAN;
        const uint64_t inactive = vertex >= 4 ? 1 : vertex < 2 ? 2 : 4;
        assert_int_equal(update_swept_spheres.active(&geometry, 0, 3), 7 ^ inactive);
        assert_int_equal(update_swept_spheres.active(&geometry, 1, 2), (7 ^ inactive) >> 1);
        assert_true(update_swept_spheres.has_nan(&geometry, vertex, 1));
        assert_int_equal(update_swept_spheres.has_nan(&geometry, 2, 4), vertex >= 2);
        geometry.type = GEOMETRY_SPHERES;
        geometry.indices = NULL;
        assert_int_equal(update_spheres.active(&geometry, 0, VERTICES), 63 ^ UINT64_C(1) << vertex);
        geometry.indices = (const uint32_t[]){5, 1, 3};
        assert_int_equal(update_spheres.active(&geometry, 0, 3), 7 & ~(vertex == 5   ? 1u
                                                                       : vertex == 1 ? 2u
                                                                       : vertex == 3 ? 4u
                                                                                     : 0u));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_copied_or_refused),
        cmocka_unit_test(boxes_are_those_of_the_shapes),
        cmocka_unit_test(every_number_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

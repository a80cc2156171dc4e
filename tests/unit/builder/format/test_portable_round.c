/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_round.c - tests the records of spheres and of linear swept spheres: what the writer makes of a request
 * bit for bit, that chains share their vertices, and that the reader refuses what no writer has made.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/portable_records.h"
#include "tests/support/builder/portable_bed.h"

static const struct test_shape shapes[] = {
    {.type = GEOMETRY_SPHERES, .geometries = 1, .primitives = 1, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_SPHERES, .geometries = 1, .primitives = 701, .size = 10, .detail = 0.05},
    {.type = GEOMETRY_SPHERES, .geometries = 3, .primitives = 100, .size = 10, .detail = 0.05, .soup = true},
    {.type = GEOMETRY_SPHERES, .geometries = 5, .primitives = 90, .size = 1e30, .detail = 0.05, .inactive = 4},
    {.type = GEOMETRY_SWEPT_SPHERES, .geometries = 1, .primitives = 1, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_SWEPT_SPHERES, .geometries = 1, .primitives = 701, .size = 10, .detail = 0.05},
    {.type = GEOMETRY_SWEPT_SPHERES,
     .geometries = 7,
     .primitives = 231,
     .size = 1e-3,
     .detail = 0.05,
     .centre = 100,
     .inactive = 2},
};

enum { SHAPES = sizeof shapes / sizeof *shapes };

static bool is_swept(const struct portable_view *view)
{
    return view->header->content == PORTABLE_SWEPT_SPHERES;
}

/* Checks that a record equals the request bit for bit. */
static void check_record(const struct test_model *model, const struct portable_view *view,
                         const struct portable_round *record)
{
    const uint32_t primitive = record->id & PORTABLE_ID_MASK, g = canonical_geometry_of(&model->canonical, primitive);
    const struct canonical_geometry *geometry = &model->canonical.geometries[g];
    const uint32_t index = primitive - geometry->first_primitive,
                   word = geometry->indices ? geometry->indices[index] : index;
    const size_t vertex = is_swept(view) ? word & CANONICAL_END_MASK : word;
    assert_memory_equal(view->vertices + (size_t)4 * record->vertex, geometry->positions + 4 * vertex,
                        is_swept(view) ? 32 : 16);
    uint32_t flags = geometry->flags & GEOMETRY_OPAQUE ? PORTABLE_ID_OPAQUE : 0;
    if (is_swept(view) && word & CANONICAL_CAP_FIRST)
        flags |= PORTABLE_ID_CAP_FIRST;
    if (is_swept(view) && word & CANONICAL_CAP_SECOND)
        flags |= PORTABLE_ID_CAP_SECOND;
    assert_int_equal(record->id & ~(uint32_t)PORTABLE_ID_MASK, flags);
    assert_int_equal(portable_geometry_of(view, primitive), g);
}

/* Counts the vertices that primitives in the tree name. */
static uint32_t count_used(const struct test_model *model)
{
    const struct canonical *canonical = &model->canonical;
    uint8_t *used = calloc(canonical->vertex_count, 1);
    uint32_t count = 0;
    assert_non_null(used);
    for (uint32_t i = 0; i < canonical->primitive_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, i)];
        const uint32_t index = i - geometry->first_primitive,
                       word = geometry->indices ? geometry->indices[index] : index;
        if (box_is_empty(&model->boxes[i]))
            continue;
        used[geometry->first_vertex + (word & CANONICAL_END_MASK)] = 1;
        if (geometry->type == GEOMETRY_SWEPT_SPHERES)
            used[geometry->first_vertex + (word & CANONICAL_END_MASK) + 1] = 1;
    }
    for (uint32_t i = 0; i < canonical->vertex_count; i++)
        count += used[i];
    free(used);
    return count;
}

static void records_equal_the_request(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct test_model model;
        struct memory memory;
        struct layout_sizes sizes;
        unsigned char *blob;
        memory_init(&memory, UINT64_MAX);
        test_model_make(&shapes[i], 5, &model);
        test_blob_dirty_heap(model.canonical.primitive_count * UINT64_C(60));
        assert_int_equal(test_blob_write(&model, 0, &memory, &parallel_serial, &blob, &sizes, NULL), BVHD_OK);
        const struct portable_view view = portable_bed_view((struct bytes){blob, sizes.total});
        const struct portable_header *header = view.header;
        const struct portable_round *records = view.records;
        uint8_t *seen = calloc(model.canonical.primitive_count, 1);
        assert_non_null(seen);
        assert_int_equal(header->version, 2);
        assert_int_equal(portable_version_of(blob + 16), 2);
        assert_int_equal(header->vertex_offset % 16, 0);
        assert_int_equal(header->vertex_count, count_used(&model));
        for (uint32_t k = 0; k < header->record_count; k++) {
            assert_int_equal(seen[records[k].id & PORTABLE_ID_MASK]++, 0);
            check_record(&model, &view, &records[k]);
        }
        for (uint32_t k = 0; k < model.canonical.primitive_count; k++)
            assert_int_equal(seen[k], !box_is_empty(&model.boxes[k]));
        const unsigned char *body = (const unsigned char *)header;
        for (uint64_t at = header->record_offset + UINT64_C(8) * header->record_count; at < header->vertex_offset; at++)
            assert_int_equal(body[at], 0); /* padding */
        free(seen);
        memory_free(&memory, blob);
        test_model_finish(&model);
        assert_int_equal(memory.live, 0);
    }
}

/* The vertices of hair are stored once, although each point but the last is the end of two primitives. */
static void chains_share_vertices(void **state)
{
    enum { STRANDS = 40, POINTS = 32, SWEPT = STRANDS * (POINTS - 1) };
    static float points[STRANDS * POINTS][4];
    static uint32_t indices[SWEPT];
    static struct box boxes[SWEPT];
    (void)state;
    for (uint32_t i = 0; i < STRANDS * POINTS; i++) {
        const float strand = (float)(i / POINTS), along = (float)(i % POINTS);
        memcpy(points[i], (float[4]){strand, along / 4, sinf(along), 0.01f}, sizeof points[i]);
    }
    for (uint32_t i = 0; i < SWEPT; i++) {
        indices[i] = (i + i / (POINTS - 1)) | CANONICAL_CAP_SECOND;
        boxes[i] = box_empty();
        box_add_point(&boxes[i], points[i + i / (POINTS - 1)]);
        box_add_point(&boxes[i], points[i + i / (POINTS - 1) + 1]);
    }
    struct canonical_geometry geometry = {.type = GEOMETRY_SWEPT_SPHERES,
                                          .primitive_count = SWEPT,
                                          .vertex_count = STRANDS * POINTS,
                                          .positions = points[0],
                                          .indices = indices};
    const struct test_model model = {.canonical = {.type = STRUCTURE_BOTTOM,
                                                   .geometry_count = 1,
                                                   .primitive_count = SWEPT,
                                                   .vertex_count = STRANDS * POINTS,
                                                   .geometries = &geometry},
                                     .boxes = boxes};
    struct memory memory;
    struct layout_sizes sizes;
    unsigned char *blob;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(test_blob_write(&model, 0, &memory, &parallel_serial, &blob, &sizes, NULL), BVHD_OK);
    const struct portable_view view = portable_bed_view((struct bytes){blob, sizes.total});
    assert_int_equal(sizes.vertices, STRANDS * POINTS * 16);
    assert_int_equal(sizes.records, SWEPT * 8);
    assert_memory_equal(view.vertices, points, sizeof points);
    memory_free(&memory, blob);
}

static void ranges_mark_what_names_do(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct test_model model;
        test_model_make(&shapes[i], 3, &model);
        const struct canonical *canonical = &model.canonical;
        const struct record_kind *kind = record_kind_of(record_content_of(canonical, 0));
        const uint32_t count = canonical->primitive_count;
        uint8_t *named = calloc(canonical->vertex_count, 1), *ranged = calloc(canonical->vertex_count, 1);
        assert_true(named && ranged);
        for (uint32_t id = count; id-- > 0;)
            kind->mark(canonical, &id, 1, named);
        for (uint32_t first = 0, length = 1; first < count; first += length, length = length * 3 + 1) {
            length = length < count - first ? length : count - first;
            portable_records_mark_range(kind, canonical, first, length, ranged);
        }
        assert_memory_equal(named, ranged, canonical->vertex_count);
        free(named);
        free(ranged);
        test_model_finish(&model);
    }
}

static void bounds_of_vertices_hold(void **state)
{
    const struct geometry spheres = {.type = GEOMETRY_SPHERES, .range = {.primitive_count = 7}};
    const struct geometry swept = {.type = GEOMETRY_SWEPT_SPHERES, .range = {.primitive_count = 1u << 31}};
    (void)state;
    assert_int_equal(record_spheres.vertices_most(&spheres), 7);
    assert_true(record_swept_spheres.vertices_most(&swept) == UINT64_C(1) << 32);
}

/* ---- hostile bytes ---- */

static void touch(const struct portable_view *view)
{
    const struct portable_round *records = view->records;
    double sum = 0;
    for (uint32_t i = 0; i < view->header->record_count; i++)
        for (uint32_t k = 0; k < (is_swept(view) ? 8u : 4u); k++)
            sum += fabs((double)view->vertices[(size_t)4 * records[i].vertex + k]);
    assert_false(isnan(sum));
}

static void records_are_checked(void **state)
{
    (void)state;
    for (int shape = 1; shape < SHAPES; shape += 4) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        struct portable_round *records = s.records;
        const bool swept = shapes[shape].type == GEOMETRY_SWEPT_SPHERES;
        const uint32_t vertices = s.header->vertex_count;
        portable_subject_expect(&s, BVHD_OK, "");
        PORTABLE_SPOIL(&s, records[7].vertex, vertices, BVHD_CORRUPT, "records[7]");
        PORTABLE_SPOIL(&s, records[7].vertex, UINT32_MAX, BVHD_CORRUPT, "records[7]");
        PORTABLE_SPOIL(&s, records[7].vertex, vertices - 1, swept ? BVHD_CORRUPT : BVHD_OK, swept ? "records[7]" : "");
        PORTABLE_SPOIL(&s, records[7].vertex, vertices - 2, BVHD_OK, "");
        PORTABLE_SPOIL(&s, records[700].id, s.header->primitive_count, BVHD_CORRUPT, "records[700]");
        PORTABLE_SPOIL(&s, records[0].id, records[0].id ^ PORTABLE_ID_OPAQUE, BVHD_OK, "");
        PORTABLE_SPOIL(&s, records[0].id, records[0].id ^ PORTABLE_ID_CAP_FIRST, swept ? BVHD_OK : BVHD_CORRUPT,
                       swept ? "" : "records[0]");
        PORTABLE_SPOIL(&s, records[0].id, records[0].id ^ PORTABLE_ID_CAP_SECOND, swept ? BVHD_OK : BVHD_CORRUPT,
                       swept ? "" : "records[0]");
        free(s.blob);
    }
}

static void vertices_are_checked(void **state)
{
    (void)state;
    for (int shape = 1; shape < SHAPES; shape += 4) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        float(*vertices)[4] = s.vertices;
        char last[32];
        snprintf(last, sizeof last, "vertices[%u]", s.header->vertex_count - 1);
        for (uint32_t updatable = 0; updatable < 2; updatable++) {
            const enum bvhd_status infinite = updatable ? BVHD_OK : BVHD_CORRUPT;
            s.header->build_flags = updatable ? BUILD_ALLOW_UPDATE : 0;
            for (int k = 0; k < 4; k++) {
                PORTABLE_SPOIL(&s, vertices[9][k], NAN, BVHD_CORRUPT, "vertices[9]");
                PORTABLE_SPOIL(&s, vertices[9][k], INFINITY, infinite, updatable ? "" : "vertices[9]");
                PORTABLE_SPOIL(&s, vertices[9][k], FLT_MAX, BVHD_OK, "");
                if (k < 3)
                    PORTABLE_SPOIL(&s, vertices[9][k], -INFINITY, infinite, updatable ? "" : "vertices[9]");
            }
            PORTABLE_SPOIL(&s, vertices[s.header->vertex_count - 1][3], -1e-45f, BVHD_CORRUPT, last);
            PORTABLE_SPOIL(&s, vertices[0][3], -INFINITY, BVHD_CORRUPT, "vertices[0]");
            PORTABLE_SPOIL(&s, vertices[0][3], -0.0f, BVHD_OK, "");
        }
        free(s.blob);
    }
}

/* Contents and versions belong together, and records of one content are not taken for those of another one. */
static void versions_are_checked(void **state)
{
    (void)state;
    for (int shape = 1; shape < SHAPES; shape += 4) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        for (uint32_t content = PORTABLE_INDEXED_TRIANGLES; content <= PORTABLE_INSTANCES; content++)
            PORTABLE_SPOIL(&s, s.header->content, content, BVHD_CORRUPT, "body.content");
        PORTABLE_SPOIL(&s, s.header->content, PORTABLE_CONTENTS, BVHD_CORRUPT, "body.content");
        PORTABLE_SPOIL(&s, s.header->version, 1, BVHD_CORRUPT, "body.version");
        PORTABLE_SPOIL(&s, s.header->version, PORTABLE_NEWEST + 1, BVHD_INCOMPATIBLE, "body.version");
        PORTABLE_SPOIL(&s, s.blob[31], 1, BVHD_CORRUPT, "body.version");
        s.header->version = 1;
        PORTABLE_SPOIL(&s, s.blob[31], 1, BVHD_CORRUPT, "body.content");
        s.header->version = 2;
        PORTABLE_SPOIL(&s, s.header->vertex_offset, s.header->vertex_offset + 8, BVHD_CORRUPT, "body.vertexOffset");
        PORTABLE_SPOIL(&s, s.header->vertex_count, s.header->vertex_count + 1, BVHD_CORRUPT, "body.geometryOffset");
        portable_subject_expect(&s, BVHD_OK, "");
        free(s.blob);
    }
}

static void every_truncation_is_refused(void **state)
{
    (void)state;
    for (int shape = 0; shape < SHAPES; shape++) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        portable_subject_truncate(&s);
        free(s.blob);
    }
}

static void every_byte_may_be_wrong(void **state)
{
    (void)state;
    for (int shape = 0; shape < SHAPES; shape += 2) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        portable_subject_flip(&s);
        free(s.blob);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_equal_the_request), cmocka_unit_test(chains_share_vertices),
        cmocka_unit_test(ranges_mark_what_names_do), cmocka_unit_test(bounds_of_vertices_hold),
        cmocka_unit_test(records_are_checked),       cmocka_unit_test(vertices_are_checked),
        cmocka_unit_test(versions_are_checked),      cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(every_byte_may_be_wrong),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

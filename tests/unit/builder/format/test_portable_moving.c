/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_moving.c - tests portable structures that move: that nodes bound what lies below them at every time,
 * that vertices and records are those of the request bit for bit, and that the reader refuses what no writer has made.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/portable_records.h"
#include "builder/workers.h"
#include "tests/support/builder/portable_bed.h"

/* With three geometries or more, one of motion triangles stands still. */
static const struct test_shape shapes[] = {
    {.type = GEOMETRY_MOVING_TRIANGLES, .geometries = 1, .primitives = 1, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_MOVING_TRIANGLES, .geometries = 1, .primitives = 700, .size = 10, .detail = 0.05},
    {.type = GEOMETRY_MOVING_TRIANGLES,
     .geometries = 7,
     .primitives = 230,
     .size = 1e-3,
     .detail = 0.05,
     .centre = 100,
     .inactive = 5},
    {.type = GEOMETRY_MOVING_TRIANGLES,
     .geometries = 3,
     .primitives = 100,
     .size = 1e30,
     .detail = 0.05,
     .soup = true,
     .inactive = 9},
    {.type = GEOMETRY_MOVING_INSTANCES, .geometries = 1, .primitives = 3, .size = 1000, .detail = 0.02},
    {.type = GEOMETRY_MOVING_INSTANCES,
     .geometries = 1,
     .primitives = 300,
     .size = 1000,
     .detail = 0.02,
     .inactive = 7},
};

enum { SHAPES = sizeof shapes / sizeof *shapes, TRIANGLE_SHAPES = 4 };

static const struct portable_indexed_triangle *triangle_at(const struct portable_view *view, uint32_t record)
{
    return (const struct portable_indexed_triangle *)view->records + record;
}

static const struct portable_moving_instance *instance_at(const struct portable_view *view, uint32_t record)
{
    return (const struct portable_moving_instance *)view->records + record;
}

static bool is_top(const struct portable_view *view)
{
    return view->header->content == PORTABLE_MOVING_INSTANCES;
}

static uint32_t primitive_of(const struct portable_view *view, uint32_t record)
{
    return is_top(view) ? instance_at(view, record)->instance : triangle_at(view, record)->id & PORTABLE_ID_MASK;
}

/* ---- nodes ---- */

struct walk {
    const struct test_model *model;
    struct portable_view view;
    uint8_t *seen; /* for each primitive: how many records name it */
};

/* Returns one side of a child's box in double, in which it is exact for the coordinates of these tests. */
static double side_of(const struct portable_node *node, int axis, uint8_t byte)
{
    return node->origin[axis] + (node->exponent[axis] ? ldexp(byte, node->exponent[axis] - 127) : 0);
}

/*
 * Checks that a child's box, at t = 0 or t = 1 or between them, contains the box of a primitive, which moves in lines
 * between these: in real numbers, with a step / 64 to spare at the ends.
 */
static void check_child(const struct portable_moving_node *node, int slot, const struct box *start,
                        const struct box *end)
{
    for (int axis = 0; axis < 3; axis++) {
        const struct portable_node *first = &node->start;
        const double low[2] = {side_of(first, axis, first->lo[axis][slot]),
                               side_of(first, axis, node->end_lo[axis][slot])},
                     high[2] = {side_of(first, axis, first->hi[axis][slot]),
                                side_of(first, axis, node->end_hi[axis][slot])},
                     spare = first->exponent[axis] ? ldexp(1, first->exponent[axis] - 127 - 6) : 0;
        for (int step = 0; step <= 8; step++) {
            const double t = step / 8.0, ulp = 1e-15 * fmax(fabs(low[0]), fabs(high[0]));
            assert_true((1 - t) * low[0] + t * low[1] + spare <= (1 - t) * start->min[axis] + t * end->min[axis] + ulp);
            assert_true((1 - t) * high[0] + t * high[1] - spare >=
                        (1 - t) * start->max[axis] + t * end->max[axis] - ulp);
        }
    }
}

/* Checks the children of a node; returns the bounds of everything below it at both keys. */
static void walk_node(struct walk *walk, uint32_t index, struct box ret_bounds[2])
{
    const struct portable_moving_node *node =
        (const struct portable_moving_node *)(const void *)portable_node_at(&walk->view, index);
    uint32_t inner = 0;
    ret_bounds[0] = ret_bounds[1] = box_empty();
    for (int slot = 0; slot < 8; slot++) {
        const unsigned meta = node->start.meta[slot];
        struct box below[2] = {box_empty(), box_empty()};
        if (meta == 0)
            continue;
        if (node->start.inner_mask >> slot & 1)
            walk_node(walk, node->start.first_child + inner++, below);
        for (int k = 0; k < __builtin_popcount(meta >> 5) && !(node->start.inner_mask >> slot & 1); k++) {
            const uint32_t primitive = primitive_of(&walk->view, node->start.first_record + (meta & 31) + (uint32_t)k);
            walk->seen[primitive]++;
            for (int key = 0; key < 2; key++)
                box_grow(&below[key], &walk->model->keys[key][primitive]);
        }
        check_child(node, slot, &below[0], &below[1]);
        for (int key = 0; key < 2; key++)
            box_grow(&ret_bounds[key], &below[key]);
    }
}

static void check_tree(const struct test_model *model, const struct portable_view *view)
{
    struct walk walk = {model, *view, calloc(model->canonical.primitive_count, 1)};
    struct box bounds[2];
    assert_non_null(walk.seen);
    walk_node(&walk, 0, bounds);
    box_grow(&bounds[0], &bounds[1]);
    assert_memory_equal(&bounds[0], view->header->bounds, sizeof bounds[0]);
    for (uint32_t i = 0; i < model->canonical.primitive_count; i++)
        assert_int_equal(walk.seen[i], !box_is_empty(&model->boxes[i]));
    free(walk.seen);
}

/* ---- records ---- */

static void check_triangle(const struct test_model *model, const struct portable_view *view, uint32_t record)
{
    const struct portable_indexed_triangle *triangle = triangle_at(view, record);
    const uint32_t primitive = primitive_of(view, record), g = canonical_geometry_of(&model->canonical, primitive);
    const struct canonical_geometry *geometry = &model->canonical.geometries[g];
    const float *end = geometry->end_positions ? geometry->end_positions : geometry->positions;
    assert_int_equal(portable_geometry_of(view, primitive), g);
    assert_int_equal(triangle->id & ~(uint32_t)PORTABLE_ID_MASK,
                     geometry->flags & GEOMETRY_OPAQUE ? PORTABLE_ID_OPAQUE : 0);
    for (uint32_t k = 0; k < 3; k++) {
        const uint32_t corner = 3 * (primitive - geometry->first_primitive) + k;
        const size_t vertex = geometry->indices ? geometry->indices[corner] : corner;
        const float *found = view->vertices + (size_t)6 * triangle->vertices[k];
        assert_memory_equal(found, geometry->positions + 3 * vertex, 12);
        assert_memory_equal(found + 3, end + 3 * vertex, 12);
    }
}

static void check_instance(const struct test_model *model, const struct portable_view *view, uint32_t record)
{
    static const float zeros[PORTABLE_SRT];
    const struct portable_moving_instance *instance = instance_at(view, record);
    const unsigned char *source =
        model->canonical.geometries[0].instances + (size_t)MOTION_RECORD_STRIDE * instance->instance;
    const size_t numbers = instance->motion == MOTION_SRT ? 16 : 12, size = 4 * numbers,
                 end = instance->motion == MOTION_STATIC ? 8 : 8 + size;
    assert_int_equal(instance->motion, instance->instance % MOTION_TYPES);
    assert_memory_equal(instance->start, source + 8, size);
    assert_memory_equal(instance->end, source + end, size);
    assert_memory_equal(instance->start + numbers, zeros, sizeof zeros - size);
    assert_memory_equal(instance->end + numbers, zeros, sizeof zeros - size);
    assert_memory_equal(&instance->custom_and_mask, source + end + size, 8);
    assert_int_equal(instance->handle + 1, bytes_get64(source + end + size + 8));
    assert_memory_equal(instance->reserved, zeros, sizeof instance->reserved);
}

static void structures_hold_what_was_asked(void **state)
{
    (void)state;
    for (int i = 0; i < 2 * SHAPES; i++) {
        struct test_model model;
        struct memory memory;
        struct layout_sizes sizes;
        unsigned char *blob;
        memory_init(&memory, UINT64_MAX);
        test_model_make(&shapes[i / 2], 5, &model);
        test_blob_dirty_heap(model.canonical.primitive_count * UINT64_C(160));
        /* the flag has no effect */
        const uint32_t flags = i % 2 ? PORTABLE_FAST_TRIANGLES : 0;
        assert_int_equal(test_blob_write(&model, flags, &memory, &parallel_serial, &blob, &sizes, NULL), BVHD_OK);
        const struct portable_view view = portable_bed_view((struct bytes){blob, sizes.total});
        const struct portable_header *header = view.header;
        assert_int_equal(header->version, 2);
        assert_int_equal(portable_version_of(blob + 16), 2);
        assert_int_equal(header->content,
                         i / 2 < TRIANGLE_SHAPES ? PORTABLE_MOVING_TRIANGLES : PORTABLE_MOVING_INSTANCES);
        assert_int_equal(view.node_size, 128);
        assert_int_equal(sizes.nodes, 128 * header->node_count);
        assert_int_equal(sizes.vertices, bytes_align(24 * (uint64_t)header->vertex_count, 16));
        check_tree(&model, &view);
        for (uint32_t record = 0; record < header->record_count; record++)
            (is_top(&view) ? check_instance : check_triangle)(&model, &view, record);
        const unsigned char *body = (const unsigned char *)header;
        for (uint64_t at = header->vertex_offset + UINT64_C(24) * header->vertex_count; at < header->geometry_offset;
             at++)
            assert_int_equal(body[at], 0); /* padding */
        memory_free(&memory, blob);
        test_model_finish(&model);
        assert_int_equal(memory.live, 0);
    }
}

/* A tree with boxes at one key alone, over what stands still, gives boxes that stand still. */
static void one_key_stands_still(void **state)
{
    struct test_model model;
    struct memory memory;
    struct layout_sizes sizes;
    unsigned char *blob;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shapes[1], 5, &model);
    free(model.keys[0]);
    model.keys[0] = NULL;
    assert_int_equal(test_blob_write(&model, 0, &memory, &parallel_serial, &blob, &sizes, NULL), BVHD_OK);
    const struct portable_view view = portable_bed_view((struct bytes){blob, sizes.total});
    for (uint32_t i = 0; i < view.header->node_count; i++) {
        const struct portable_moving_node *node =
            (const struct portable_moving_node *)(const void *)portable_node_at(&view, i);
        assert_memory_equal(node->end_lo, node->start.lo, sizeof node->end_lo);
        assert_memory_equal(node->end_hi, node->start.hi, sizeof node->end_hi);
    }
    memory_free(&memory, blob);
    test_model_finish(&model);
}

static void threads_do_not_matter(void **state)
{
    static const unsigned threads[] = {1, 2, 8};
    const struct test_shape shape = {.type = GEOMETRY_MOVING_TRIANGLES,
                                     .geometries = 3,
                                     .primitives = 20000,
                                     .size = 10,
                                     .detail = 0.01,
                                     .inactive = 11};
    struct test_model model;
    struct memory memory;
    unsigned char *blobs[3];
    struct layout_sizes sizes[3];
    (void)state;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 4, &model);
    for (int i = 0; i < 3; i++) {
        struct workers *workers;
        assert_int_equal(workers_create(threads[i], &workers, NULL), BVHD_OK);
        assert_int_equal(test_blob_write(&model, 0, &memory, workers_parallel(workers), &blobs[i], &sizes[i], NULL),
                         BVHD_OK);
        workers_destroy(workers);
        assert_int_equal(sizes[i].total, sizes[0].total);
        assert_memory_equal(blobs[i], blobs[0], sizes[0].total);
    }
    for (int i = 0; i < 3; i++)
        memory_free(&memory, blobs[i]);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

/* ---- hostile bytes ---- */

static void touch(const struct portable_view *view)
{
    unsigned sum = 0;
    if (view->node_size != sizeof(struct portable_moving_node))
        return;
    for (uint32_t i = 0; i < view->header->node_count; i++) {
        const unsigned char *node = (const unsigned char *)portable_node_at(view, i);
        for (size_t k = 0; k < sizeof(struct portable_moving_node); k++)
            sum += node[k];
    }
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        if (is_top(view)) {
            sum += view->handles[8 * instance_at(view, i)->handle] + instance_at(view, i)->motion;
            continue;
        }
        for (int k = 0; k < 3; k++) {
            struct portable_moving_vertex vertex;
            memcpy(&vertex, view->vertices + (size_t)6 * triangle_at(view, i)->vertices[k], sizeof vertex);
            sum += vertex.end[2] > 0;
        }
    }
    assert_int_not_equal(sum, 0);
}

static void nodes_are_checked(void **state)
{
    (void)state;
    for (int shape = 0; shape < SHAPES; shape++) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        struct portable_moving_node *nodes = s.nodes, *node = &nodes[s.header->node_count - 1];
        char where[40];
        snprintf(where, sizeof where, "nodes[%u].boxes", s.header->node_count - 1);
        portable_subject_expect(&s, BVHD_OK, "");
        for (int slot = 0; slot < 8; slot++)
            for (int axis = 0; axis < 3; axis++) {
                const uint8_t lo = node->end_lo[axis][slot], hi = node->end_hi[axis][slot];
                if (node->start.meta[slot] == 0) {
                    PORTABLE_SPOIL(&s, node->end_lo[axis][slot], 254, BVHD_CORRUPT, where);
                    PORTABLE_SPOIL(&s, node->end_hi[axis][slot], 1, BVHD_CORRUPT, where);
                    continue;
                }
                PORTABLE_SPOIL(&s, node->end_hi[axis][slot], lo, BVHD_OK, "");
                PORTABLE_SPOIL(&s, node->end_lo[axis][slot], hi, BVHD_OK, "");
                if (lo > 0)
                    PORTABLE_SPOIL(&s, node->end_hi[axis][slot], (uint8_t)(lo - 1), BVHD_CORRUPT, where);
                if (hi < 255)
                    PORTABLE_SPOIL(&s, node->end_lo[axis][slot], (uint8_t)(hi + 1), BVHD_CORRUPT, where);
            }
        snprintf(where, sizeof where, "nodes[%u].firstRecord", s.header->node_count - 1);
        PORTABLE_SPOIL(&s, node->start.first_record, node->start.first_record + 1, BVHD_CORRUPT, where);
        free(s.blob);
    }
}

static void triangles_are_checked(void **state)
{
    struct portable_subject s = portable_subject_make(&shapes[1], touch);
    struct portable_indexed_triangle *records = s.records;
    (void)state;
    for (int k = 0; k < 3; k++) {
        PORTABLE_SPOIL(&s, records[7].vertices[k], s.header->vertex_count, BVHD_CORRUPT, "records[7]");
        PORTABLE_SPOIL(&s, records[7].vertices[k], s.header->vertex_count - 1, BVHD_OK, "");
    }
    PORTABLE_SPOIL(&s, records[5].id, s.header->primitive_count, BVHD_CORRUPT, "records[5]");
    PORTABLE_SPOIL(&s, records[5].id, records[5].id ^ PORTABLE_ID_OPAQUE, BVHD_OK, "");
    PORTABLE_SPOIL(&s, records[5].id, records[5].id | PORTABLE_ID_CAP_FIRST, BVHD_CORRUPT, "records[5]");
    PORTABLE_SPOIL(&s, s.header->vertex_count, s.header->vertex_count + 1, BVHD_CORRUPT, "body.vertexOffset");
    PORTABLE_SPOIL(&s, s.header->vertex_offset, s.header->vertex_offset + 8, BVHD_CORRUPT, "body.vertexOffset");
    free(s.blob);
}

static void instances_are_checked(void **state)
{
    struct portable_subject s = portable_subject_make(&shapes[4], touch);
    struct portable_moving_instance *records = s.records;
    (void)state;
    for (uint32_t i = 0; i < s.header->record_count; i++) {
        struct portable_moving_instance *instance = &records[i];
        char where[40];
        snprintf(where, sizeof where, "records[%u]", i);
        PORTABLE_SPOIL(&s, instance->motion, MOTION_TYPES, BVHD_CORRUPT, where);
        PORTABLE_SPOIL(&s, instance->motion, UINT32_MAX, BVHD_CORRUPT, where);
        PORTABLE_SPOIL(&s, instance->instance, s.header->primitive_count, BVHD_CORRUPT, where);
        PORTABLE_SPOIL(&s, instance->handle, 3, BVHD_CORRUPT, where);
        for (int k = 0; k < 3; k++)
            PORTABLE_SPOIL(&s, instance->reserved[k], 1, BVHD_CORRUPT, where);
        /* Numbers have any values, but what a type has none of is 0, and what stands still ends where it starts. */
        const bool is_srt = instance->motion == MOTION_SRT, is_static = instance->motion == MOTION_STATIC;
        PORTABLE_SPOIL(&s, instance->start[15], -0.0f, is_srt ? BVHD_OK : BVHD_CORRUPT, is_srt ? "" : where);
        PORTABLE_SPOIL(&s, instance->end[12], 1, is_srt ? BVHD_OK : BVHD_CORRUPT, is_srt ? "" : where);
        PORTABLE_SPOIL(&s, instance->end[11], NAN, is_static ? BVHD_CORRUPT : BVHD_OK, is_static ? where : "");
        PORTABLE_SPOIL(&s, instance->custom_and_mask, 77, BVHD_OK, "");
        PORTABLE_SPOIL(&s, instance->sbt_and_flags, 77, BVHD_OK, "");
        if (is_srt)
            PORTABLE_SPOIL(&s, instance->motion, MOTION_MATRIX, BVHD_CORRUPT, where);
    }
    free(s.blob);
}

/* Contents and versions belong together, and what moves is not taken for what stands still. */
static void versions_are_checked(void **state)
{
    (void)state;
    for (int shape = 1; shape < SHAPES; shape += 4) {
        struct portable_subject s = portable_subject_make(&shapes[shape], touch);
        struct bvhd_error error;
        for (uint32_t content = 0; content <= PORTABLE_CONTENTS; content++) {
            const uint32_t old = s.header->content;
            s.header->content = content;
            assert_int_equal(portable_subject_open(&s, &error), content == old ? BVHD_OK : BVHD_CORRUPT);
            s.header->content = old;
        }
        PORTABLE_SPOIL(&s, s.header->version, 1, BVHD_CORRUPT, "body.version");
        s.header->version = 1;
        PORTABLE_SPOIL(&s, s.blob[31], 1, BVHD_CORRUPT, "body.content");
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

static void every_allocation_may_fail(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct test_model model;
        struct memory memory;
        enum bvhd_status status = BVHD_NO_MEMORY;
        memory_init(&memory, UINT64_MAX);
        test_model_make(&shapes[i], 6, &model);
        for (int n = 0; status != BVHD_OK; n++) {
            unsigned char *blob = NULL;
            struct layout_sizes sizes;
            memory.fail_after = n;
            status = test_blob_write(&model, 0, &memory, &parallel_serial, &blob, &sizes, NULL);
            memory.fail_after = -1;
            assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && !blob));
            memory_free(&memory, blob);
            assert_int_equal(memory.live, 0);
        }
        test_model_finish(&model);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_hold_what_was_asked), cmocka_unit_test(one_key_stands_still),
        cmocka_unit_test(threads_do_not_matter),          cmocka_unit_test(nodes_are_checked),
        cmocka_unit_test(triangles_are_checked),          cmocka_unit_test(instances_are_checked),
        cmocka_unit_test(versions_are_checked),           cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(every_byte_may_be_wrong),        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

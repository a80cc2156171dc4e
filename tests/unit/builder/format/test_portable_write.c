/* SPDX-License-Identifier: Apache-2.0 */
/* test_portable_write.c - tests that portable structures hold exactly what was requested. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/portable.h"
#include "builder/format/portable_records.h"
#include "builder/format/serialized.h"
#include "tests/support/builder/test_blob.h"
#include "builder/workers.h"

struct walk {
    const struct test_model *model;
    struct portable_view view;
    uint8_t *seen; /* for each primitive: whether a record names it */
    uint32_t nodes, records;
};

static void write_model(const struct test_model *model, uint32_t flags, struct memory *memory, unsigned char **ret_blob,
                        struct layout_sizes *ret_sizes, struct portable_view *ret_view)
{
    struct bvhd_error error;
    test_blob_dirty_heap(model->canonical.primitive_count * UINT64_C(60));
    assert_int_equal(test_blob_write(model, flags, memory, &parallel_serial, ret_blob, ret_sizes, &error), BVHD_OK);
    assert_int_equal((uintptr_t)*ret_blob % 64, 0);
    struct bytes bytes = {*ret_blob, ret_sizes->total};
    if (portable_open(bytes, memory, ret_view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

static uint32_t record_primitive(const struct portable_view *view, uint32_t record)
{
    switch ((enum portable_content)view->header->content) {
    case PORTABLE_INDEXED_TRIANGLES:
    case PORTABLE_MOVING_TRIANGLES:
        return ((const struct portable_indexed_triangle *)view->records)[record].id & PORTABLE_ID_MASK;
    case PORTABLE_TRIANGLES:
        return ((const struct portable_triangle *)view->records)[record].id & PORTABLE_ID_MASK;
    case PORTABLE_AABBS:
        return ((const struct portable_aabb *)view->records)[record].id & PORTABLE_ID_MASK;
    case PORTABLE_SPHERES:
    case PORTABLE_SWEPT_SPHERES:
        return ((const struct portable_round *)view->records)[record].id & PORTABLE_ID_MASK;
    case PORTABLE_MOVING_INSTANCES:
        return ((const struct portable_moving_instance *)view->records)[record].instance;
    case PORTABLE_INSTANCES:
        break;
    }
    return ((const struct portable_instance *)view->records)[record].instance;
}

static struct box child_box(const struct portable_node *node, int slot)
{
    struct box box;
    for (int axis = 0; axis < 3; axis++) {
        double step = node->exponent[axis] ? ldexp(1, node->exponent[axis] - 127) : 0;
        box.min[axis] = (float)(node->origin[axis] + node->lo[axis][slot] * step);
        box.max[axis] = (float)(node->origin[axis] + node->hi[axis][slot] * step);
    }
    return box;
}

/* Checks that everything below a child lies in its box; returns the bounds of everything below the node. */
static struct box walk_node(struct walk *walk, uint32_t index)
{
    const struct portable_node *node = &walk->view.nodes[index];
    struct box bounds = box_empty();
    walk->nodes++;
    uint32_t inner = 0;
    for (int slot = 0; slot < 8; slot++) {
        unsigned meta = node->meta[slot];
        struct box below = box_empty(), outer;
        if (meta == 0)
            continue;
        if (node->inner_mask >> slot & 1) {
            below = walk_node(walk, node->first_child + inner++);
        } else {
            for (int k = 0; k < __builtin_popcount(meta >> 5); k++) {
                uint32_t primitive = record_primitive(&walk->view, node->first_record + (meta & 31) + (uint32_t)k);
                assert_int_equal(walk->seen[primitive]++, 0);
                box_grow(&below, &walk->model->boxes[primitive]);
                walk->records++;
            }
        }
        outer = child_box(node, slot);
        assert_true(box_contains(&outer, &below));
        box_grow(&bounds, &below);
    }
    return bounds;
}

static void check_tree(const struct test_model *model, const struct portable_view *view)
{
    struct walk walk = {model, *view, calloc(model->canonical.primitive_count + 1, 1), 0, 0};
    assert_non_null(walk.seen);
    struct box bounds = walk_node(&walk, 0);
    assert_memory_equal(&bounds, view->header->bounds, sizeof bounds);
    assert_int_equal(walk.nodes, view->header->node_count);
    assert_int_equal(walk.records, view->header->record_count);
    for (uint32_t i = 0; i < model->canonical.primitive_count; i++)
        assert_int_equal(walk.seen[i], !box_is_empty(&model->boxes[i]));
    free(walk.seen);
}

static void check_id(const struct test_model *model, const struct portable_view *view, uint32_t id)
{
    uint32_t geometry = portable_geometry_of(view, id & PORTABLE_ID_MASK);
    assert_int_equal(geometry, canonical_geometry_of(&model->canonical, id & PORTABLE_ID_MASK));
    assert_int_equal((id & PORTABLE_ID_OPAQUE) != 0,
                     (model->canonical.geometries[geometry].flags & GEOMETRY_OPAQUE) != 0);
    assert_int_equal(id & 0x60000000, 0);
}

/* Checks that a record equals the request bit for bit. */
static void check_record(const struct test_model *model, const struct portable_view *view, uint32_t record)
{
    uint32_t primitive = record_primitive(view, record);
    const struct canonical_geometry *geometry =
        &model->canonical.geometries[canonical_geometry_of(&model->canonical, primitive)];
    uint32_t index = primitive - geometry->first_primitive;
    float corners[3][3];
    if (view->header->content == PORTABLE_INDEXED_TRIANGLES) {
        const struct portable_indexed_triangle *triangle =
            (const struct portable_indexed_triangle *)view->records + record;
        canonical_triangle(geometry, index, corners);
        for (int k = 0; k < 3; k++)
            assert_memory_equal(view->vertices + 3 * (size_t)triangle->vertices[k], corners[k], 12);
        check_id(model, view, triangle->id);
    } else if (view->header->content == PORTABLE_TRIANGLES) {
        const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + record;
        canonical_triangle(geometry, index, corners);
        assert_memory_equal(triangle->v0, corners[0], 12);
        assert_memory_equal(triangle->v1, corners[1], 12);
        assert_memory_equal(triangle->v2, corners[2], 12);
        check_id(model, view, triangle->id);
    } else if (view->header->content == PORTABLE_AABBS) {
        const struct portable_aabb *aabb = (const struct portable_aabb *)view->records + record;
        assert_memory_equal(aabb->min, geometry->boxes + 6 * (size_t)index, 12);
        assert_memory_equal(aabb->max, geometry->boxes + 6 * (size_t)index + 3, 12);
        check_id(model, view, aabb->id);
    } else {
        const struct portable_instance *instance = (const struct portable_instance *)view->records + record;
        const unsigned char *source = geometry->instances + (size_t)64 * index;
        assert_memory_equal(instance->object_to_world, source, 48);
        assert_memory_equal(&instance->custom_and_mask, source + 48, 8);
        assert_int_equal(instance->handle + 1, bytes_get64(source + 56));
    }
}

static void check_header(const struct test_model *model, const unsigned char *blob, const struct layout_sizes *sizes,
                         const struct portable_view *view)
{
    const struct portable_header *h = view->header;
    struct serialized_header serialized;
    struct bytes bytes = {blob, sizes->total};
    assert_int_equal(serialized_read(bytes, &serialized, NULL), BVHD_OK);
    assert_memory_equal(serialized.driver_uuid, portable_driver_uuid, 16);
    assert_int_equal(portable_version_of(serialized.compatibility_uuid), h->version);
    assert_int_equal(serialized.deserialized_size, h->body_size);
    assert_int_equal(serialized.handle_count, model->canonical.reference_count);
    for (uint64_t i = 0; i < serialized.handle_count; i++)
        assert_int_equal(bytes_get64(view->handles + 8 * i), i + 1);
    assert_int_equal(sizes->header + sizes->nodes + sizes->records + sizes->vertices + sizes->geometries, sizes->total);
    assert_int_equal(sizes->nodes, h->node_count * UINT64_C(80));
    assert_int_equal(h->primitive_count, model->canonical.primitive_count);
    assert_int_equal(h->build_flags, model->canonical.flags);
    for (uint32_t g = 0; g < h->geometry_count; g++)
        assert_int_equal(view->geometries[g].flags, model->canonical.geometries[g].flags);
    const unsigned char *body = (const unsigned char *)h;
    for (const unsigned char *at = blob + 56 + 8 * serialized.handle_count; at < body; at++)
        assert_int_equal(*at, 0);
    for (const unsigned char *at = body + h->vertex_offset + 12 * (uint64_t)h->vertex_count;
         at < body + h->geometry_offset; at++)
        assert_int_equal(*at, 0);
}

static void structures_hold_what_was_asked(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < TEST_BLOB_SHAPES; i++)
        for (uint32_t flags = 0; flags <= PORTABLE_FAST_TRIANGLES; flags++) {
            struct test_model model;
            struct layout_sizes sizes;
            struct portable_view view;
            unsigned char *blob;
            test_model_make(&test_blob_shapes[i], 100 + (uint64_t)i, &model);
            model.canonical.flags = BUILD_PREFER_FAST_TRACE;
            write_model(&model, flags, &memory, &blob, &sizes, &view);
            check_header(&model, blob, &sizes, &view);
            check_tree(&model, &view);
            for (uint32_t record = 0; record < view.header->record_count; record++)
                check_record(&model, &view, record);
            memory_free(&memory, blob);
            test_model_finish(&model);
        }
    assert_int_equal(memory.live, 0);
}

/* The kept vertices are those that records use, in the order of the request. */
static void vertices_keep_their_order(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct test_model model;
    struct layout_sizes sizes;
    struct portable_view view;
    unsigned char *blob;
    test_model_make(&test_blob_shapes[3], 8, &model);
    write_model(&model, 0, &memory, &blob, &sizes, &view);
    const struct canonical *canonical = &model.canonical;
    uint8_t *used = calloc(canonical->vertex_count, 1);
    assert_non_null(used);
    for (uint32_t i = 0; i < canonical->primitive_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, i)];
        for (uint32_t k = 0; k < 3 && !box_is_empty(&model.boxes[i]); k++)
            used[geometry->first_vertex + geometry->indices[3 * (i - geometry->first_primitive) + k]] = 1;
    }
    uint32_t next = 0;
    for (uint32_t v = 0; v < canonical->vertex_count; v++)
        if (used[v])
            assert_memory_equal(view.vertices + 3 * (size_t)next++, canonical->geometries[0].positions + 3 * (size_t)v,
                                12);
    assert_int_equal(next, view.header->vertex_count);
    assert_true(next < canonical->vertex_count);
    free(used);
    memory_free(&memory, blob);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

static void nothing_in_nothing_out(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    static const uint32_t types[] = {GEOMETRY_TRIANGLES, GEOMETRY_AABBS, GEOMETRY_INSTANCES};
    for (int i = 0; i < 6; i++) {
        struct test_shape shape = {
            .type = types[i / 2], .geometries = 1, .primitives = i % 2 ? 10 : 0, .size = 1, .detail = 1};
        struct test_model model;
        struct layout_sizes sizes;
        struct portable_view view;
        unsigned char *blob;
        shape.inactive = 1;
        test_model_make(&shape, 1, &model);
        write_model(&model, 0, &memory, &blob, &sizes, &view);
        assert_int_equal(
            view.header->node_count | view.header->record_count | view.header->vertex_count | view.header->depth, 0);
        assert_true(view.header->bounds[0] > view.header->bounds[3]);
        check_header(&model, blob, &sizes, &view);
        memory_free(&memory, blob);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    static const unsigned threads[] = {1, 2, 8};
    struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 3, .primitives = 40000, .size = 10, .detail = 0.01, .inactive = 11};
    struct test_model model;
    unsigned char *blobs[3];
    struct layout_sizes sizes[3];
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

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < TEST_BLOB_SHAPES; i++) {
        struct test_model model;
        enum bvhd_status status = BVHD_NO_MEMORY;
        test_model_make(&test_blob_shapes[i], 6, &model);
        for (int n = 0; status != BVHD_OK; n++) {
            unsigned char *blob = NULL;
            struct layout_sizes sizes;
            struct bvhd_error error = {.status = BVHD_OK};
            memory.fail_after = n;
            status = test_blob_write(&model, 0, &memory, &parallel_serial, &blob, &sizes, &error);
            memory.fail_after = -1;
            if (status != BVHD_OK) {
                assert_int_equal(status, BVHD_NO_MEMORY);
                assert_int_equal(error.status, BVHD_NO_MEMORY);
                assert_null(blob);
            }
            memory_free(&memory, blob);
            assert_int_equal(memory.live, 0);
        }
        test_model_finish(&model);
    }
}

static void ranges_mark_what_names_do(void **state)
{
    (void)state;
    for (int i = 0; i < TEST_BLOB_SHAPES; i++) {
        struct test_model model;
        if (test_blob_shapes[i].type != GEOMETRY_TRIANGLES)
            continue;
        test_model_make(&test_blob_shapes[i], 3, &model);
        const struct canonical *canonical = &model.canonical;
        uint32_t count = canonical->primitive_count, vertices = canonical->vertex_count;
        uint8_t *named = calloc(vertices + 1, 1), *ranged = calloc(vertices + 1, 1);
        assert_true(named && ranged);
        for (uint32_t id = count; id-- > 0;)
            record_indexed_triangles.mark(canonical, &id, 1, named);
        for (uint32_t first = 0, length = 1; first < count; first += length, length = length * 3 + 1) {
            length = length < count - first ? length : count - first;
            portable_records_mark_range(&record_indexed_triangles, canonical, first, length, ranged);
        }
        assert_memory_equal(named, ranged, vertices);
        free(named);
        free(ranged);
        test_model_finish(&model);
    }
}

static void what_ids_cannot_hold_is_too_large(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct canonical canonical = {.type = STRUCTURE_BOTTOM, .primitive_count = UINT32_C(1) << 29};
    struct ir ir = {.key_count = 1};
    struct wide wide = {0};
    const struct layout_input input = {
        .canonical = &canonical, .ir = &ir, .wide = &wide, .memory = &memory, .parallel = &parallel_serial};
    struct layout_sizes sizes;
    struct bvhd_error error;
    unsigned char *blob;
    assert_int_equal(layout_portable.write(&input, &blob, &sizes, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "primitives");
    canonical.primitive_count--;
    wide.depth = PORTABLE_MAX_DEPTH + 1;
    assert_int_equal(layout_portable.write(&input, &blob, &sizes, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "depth");
    assert_int_equal(memory.live, 0);
}

static void inverses_invert(void **state)
{
    (void)state;
    struct random random = {5};
    for (int round = 0; round < 3000; round++) {
        float matrix[12], inverse[12];
        double scale = ldexp(1, (int)(random_next(&random) % 160) - 80);
        for (int i = 0; i < 12; i++)
            matrix[i] = (float)(random_between(&random, -1, 1) * (i % 4 == 3 ? 3 : scale));
        portable_invert(matrix, inverse);
        double worst = 0, size = 0;
        for (int row = 0; row < 3; row++)
            for (int column = 0; column < 3; column++) {
                double sum = 0;
                for (int k = 0; k < 3; k++) {
                    sum += (double)matrix[4 * row + k] * inverse[4 * k + column];
                    size = fmax(size, fabs((double)matrix[4 * row + k] * inverse[4 * k + column]));
                }
                worst = fmax(worst, fabs(sum - (row == column)));
            }
        assert_true(worst <= 4 * 0x1p-24 * fmax(size, 1));
        for (int row = 0; row < 3; row++) {
            double sum = inverse[4 * row + 3], bulk = fabs(sum);
            for (int k = 0; k < 3; k++) {
                sum += (double)inverse[4 * row + k] * matrix[4 * k + 3];
                bulk = fmax(bulk, fabs((double)inverse[4 * row + k] * matrix[4 * k + 3]));
            }
            assert_true(fabs(sum) <= 4 * 0x1p-24 * bulk);
        }
    }
    static const float flat[12] = {1, 0, 0, 5, 0, 0, 0, 5, 0, 0, 1, 5},
                       tiny[12] = {1e-44f, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1},
                       far[12] = {1e-30f, 0, 0, 3e38f, 0, 1e-30f, 0, 0, 0, 0, 1e-30f, 0};
    static const float zero[12] = {0};
    float inverse[12];
    portable_invert(flat, inverse);
    assert_memory_equal(inverse, zero, sizeof zero);
    portable_invert(tiny, inverse);
    assert_memory_equal(inverse, zero, sizeof zero);
    portable_invert(far, inverse);
    assert_memory_equal(inverse, zero, sizeof zero);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_hold_what_was_asked),
        cmocka_unit_test(vertices_keep_their_order),
        cmocka_unit_test(nothing_in_nothing_out),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(ranges_mark_what_names_do),
        cmocka_unit_test(what_ids_cannot_hold_is_too_large),
        cmocka_unit_test(inverses_invert),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

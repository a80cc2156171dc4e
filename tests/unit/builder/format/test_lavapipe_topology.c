/* SPDX-License-Identifier: Apache-2.0 */
/* test_lavapipe_topology.c - tests that a structure's tree can be read and written again, byte for byte. */
#include "tests/support/unit.h"

#include "builder/format/lavapipe_topology.h"
#include "builder/format/lavapipe_write.h"
#include "tests/support/builder/test_blob.h"

static const struct test_shape shapes[] = {
    {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 0, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 1, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_TRIANGLES, .geometries = 3, .primitives = 200, .size = 10, .detail = 0.05, .inactive = 7},
    {.type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 20, .size = 1, .detail = 0.05, .inactive = 1},
    {.type = GEOMETRY_AABBS, .geometries = 2, .primitives = 100, .size = 10, .detail = 0.02},
};

enum { SHAPE_COUNT = sizeof shapes / sizeof shapes[0] };

/* A structure and the request that it was made from. */
struct subject {
    struct memory memory;
    struct test_model model;
    unsigned char *blob;
    struct layout_sizes sizes;
    struct lavapipe_view view;
};

static void subject_open(struct subject *s, enum lavapipe_variant variant)
{
    struct bvhd_error error;
    struct bytes bytes = {s->blob, s->sizes.total};
    if (lavapipe_open(bytes, variant, &s->memory, &s->view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

static void subject_init(struct subject *s, const struct test_shape *shape, enum lavapipe_variant variant)
{
    memory_init(&s->memory, UINT64_MAX);
    test_model_make(shape, 5, &s->model);
    assert_int_equal(
        test_blob_write_native(&s->model, variant, &s->memory, &parallel_serial, &s->blob, &s->sizes, NULL), BVHD_OK);
    subject_open(s, variant);
}

static void subject_finish(struct subject *s)
{
    memory_free(&s->memory, s->blob);
    test_model_finish(&s->model);
    assert_int_equal(s->memory.live, 0);
}

static void structures_are_written_again(void **state)
{
    (void)state;
    for (int i = 0; i < 2 * SHAPE_COUNT; i++) {
        struct subject s;
        struct lavapipe_topology topology;
        struct layout_sizes sizes;
        unsigned char *again;
        subject_init(&s, &shapes[i / 2], i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN);
        assert_int_equal(lavapipe_topology_read(&s.view, &s.model.canonical, &s.memory, &topology, NULL), BVHD_OK);
        assert_int_equal(
            ir_check(&topology.ir, s.model.canonical.primitive_count, s.model.boxes, false, &s.memory, NULL), BVHD_OK);
        const struct layout_input input = {.canonical = &s.model.canonical,
                                           .ir = &topology.ir,
                                           .device = &s.view.device,
                                           .memory = &s.memory,
                                           .parallel = &parallel_serial};
        assert_int_equal(lavapipe_write_at(&input, topology.places, &again, &sizes, NULL), BVHD_OK);
        assert_int_equal(sizes.total, s.sizes.total);
        assert_memory_equal(again, s.blob, sizes.total);
        memory_free(&s.memory, again);
        lavapipe_topology_finish(&topology);
        lavapipe_topology_finish(&topology);
        subject_finish(&s);
    }
    lavapipe_topology_finish(NULL);
}

/*
 * The boxes of instances are the driver's, so that only the tree and its order can be compared; null instances keep
 * their numbers.
 */
static void instances_are_named_by_their_numbers(void **state)
{
    (void)state;
    static const struct test_shape shape = {
        .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 50, .size = 10, .detail = 0.1, .inactive = 4};
    struct subject s;
    struct lavapipe_topology topology;
    memory_init(&s.memory, UINT64_MAX);
    test_model_make(&shape, 5, &s.model);
    for (size_t i = 0; i < 50; i += 4)
        memset((unsigned char *)(uintptr_t)s.model.canonical.geometries[0].instances + 64 * i + 56, 0, 8);
    for (uint32_t r = 0; r < 3; r++)
        s.model.canonical.references[r].bounds = (struct box){{0, 0, 0}, {1, 1, 1}};
    assert_int_equal(
        test_blob_write_native(&s.model, LAVAPIPE_PLAIN, &s.memory, &parallel_serial, &s.blob, &s.sizes, NULL),
        BVHD_OK);
    subject_open(&s, LAVAPIPE_PLAIN);
    assert_int_equal(lavapipe_topology_read(&s.view, &s.model.canonical, &s.memory, &topology, NULL), BVHD_OK);
    uint8_t seen[50] = {0};
    for (uint32_t i = 0; i < topology.ir.ref_count; i++)
        seen[topology.ir.refs[i]]++;
    for (uint32_t i = 0; i < 50; i++)
        assert_int_equal(seen[i], i % 4 != 0);
    lavapipe_topology_finish(&topology);
    /* A leaf whose number is that of a null instance, or too large, does not belong to the request. */
    unsigned char *number = s.blob + (s.view.body - s.blob) + s.view.leaf_offset + 68;
    uint32_t old = bytes_get32(number);
    for (uint32_t wrong = 0; wrong <= 50; wrong += 50) {
        struct bvhd_error error;
        bytes_put32(number, wrong);
        assert_int_equal(lavapipe_topology_read(&s.view, &s.model.canonical, &s.memory, &topology, &error),
                         BVHD_UNSUPPORTED);
        assert_string_equal(error.where, "leaf[0]");
    }
    bytes_put32(number, old);
    subject_finish(&s);
}

static void expect_unsupported(struct subject *s, const struct canonical *canonical, const char *where)
{
    struct lavapipe_topology topology;
    struct bvhd_error error;
    uint64_t live = s->memory.live;
    assert_int_equal(lavapipe_topology_read(&s->view, canonical, &s->memory, &topology, &error), BVHD_UNSUPPORTED);
    assert_int_equal(s->memory.live, live);
    if (where)
        assert_string_equal(error.where, where);
}

static void other_requests_do_not_fit(void **state)
{
    (void)state;
    struct subject s, boxes;
    subject_init(&s, &shapes[2], LAVAPIPE_PLAIN);
    subject_init(&boxes, &shapes[4], LAVAPIPE_PLAIN);
    expect_unsupported(&s, &boxes.model.canonical, NULL); /* another kind, and fewer primitives */
    expect_unsupported(&boxes, &s.model.canonical, NULL);
    struct canonical fewer = s.model.canonical;
    fewer.primitive_count = 400;
    fewer.geometry_count = 2;
    expect_unsupported(&s, &fewer, NULL);
    fewer.primitive_count = fewer.geometry_count = 0;
    expect_unsupported(&s, &fewer, NULL);
    subject_finish(&boxes);
    subject_finish(&s);
}

static void odd_trees_are_refused(void **state)
{
    (void)state;
    struct subject s;
    subject_init(&s, &shapes[4], LAVAPIPE_PLAIN);
    unsigned char *boxes = s.blob + (s.view.body - s.blob) + LAVAPIPE_HEADER;
    uint32_t old = bytes_get32(boxes + 48);
    bytes_put32(boxes + 48, LAVAPIPE_NONE); /* child 0 of the root, which has a child 1 */
    subject_open(&s, LAVAPIPE_PLAIN);
    expect_unsupported(&s, &s.model.canonical, "node[0]");
    bytes_put32(boxes + 48, old);
    uint32_t beside = bytes_get32(boxes + 52);
    bytes_put32(boxes + 52, LAVAPIPE_NONE); /* the root's only child is a box */
    assert_int_equal(old & 3, LAVAPIPE_BOX);
    subject_open(&s, LAVAPIPE_PLAIN);
    expect_unsupported(&s, &s.model.canonical, "node[0]");
    bytes_put32(boxes + 52, beside);
    uint32_t below = (old & ~3u) - LAVAPIPE_HEADER;
    old = bytes_get32(boxes + below + 52);
    bytes_put32(boxes + below + 52, LAVAPIPE_NONE);
    subject_open(&s, LAVAPIPE_PLAIN);
    expect_unsupported(&s, &s.model.canonical, "node[1]");
    bytes_put32(boxes + below + 52, old);
    subject_open(&s, LAVAPIPE_PLAIN);
    subject_finish(&s);
}

/* Boxes beyond the room of the request are refused, so that nothing is written there. */
static void boxes_beyond_the_room_are_refused(void **state)
{
    (void)state;
    static const struct test_shape many = {
        .type = GEOMETRY_AABBS, .geometries = 1, .primitives = 60, .size = 10, .detail = 0.02};
    struct subject s;
    subject_init(&s, &many, LAVAPIPE_PLAIN);
    unsigned char *boxes = s.blob + (s.view.body - s.blob) + LAVAPIPE_HEADER;
    /*
     * The root has box 58 and a leaf below it, box 58 has two leaves. The request has three primitives, so there is
     * room for at most three boxes.
     */
    bytes_put32(boxes + 48, (LAVAPIPE_HEADER + 56 * 58) | LAVAPIPE_BOX);
    bytes_put32(boxes + 52, s.view.leaf_offset | LAVAPIPE_AABB);
    for (uint32_t child = 0; child < 2; child++)
        bytes_put32(boxes + (size_t)56 * 58 + 48 + 4 * (size_t)child,
                    (s.view.leaf_offset + 32 * (1 + child)) | LAVAPIPE_AABB);
    subject_open(&s, LAVAPIPE_PLAIN);
    struct canonical_geometry geometry = s.model.canonical.geometries[0];
    struct canonical three = s.model.canonical;
    geometry.primitive_count = three.primitive_count = 3;
    three.geometries = &geometry;
    expect_unsupported(&s, &three, "node[58]");
    subject_finish(&s);
}

static void failing_allocations_are_reported(void **state)
{
    (void)state;
    struct subject s;
    struct lavapipe_topology topology;
    int failures = 0;
    subject_init(&s, &shapes[2], LAVAPIPE_PLAIN);
    uint64_t live = s.memory.live;
    for (;; failures++) {
        s.memory.fail_after = failures;
        enum bvhd_status status = lavapipe_topology_read(&s.view, &s.model.canonical, &s.memory, &topology, NULL);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(s.memory.live, live);
    }
    s.memory.fail_after = -1;
    assert_int_equal(failures, 4);
    lavapipe_topology_finish(&topology);
    subject_finish(&s);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_are_written_again),      cmocka_unit_test(instances_are_named_by_their_numbers),
        cmocka_unit_test(other_requests_do_not_fit),         cmocka_unit_test(odd_trees_are_refused),
        cmocka_unit_test(boxes_beyond_the_room_are_refused), cmocka_unit_test(failing_allocations_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

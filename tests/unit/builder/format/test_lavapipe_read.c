/* SPDX-License-Identifier: Apache-2.0 */
/* test_lavapipe_read.c - tests that structures of the lavapipe layout are opened, and that damaged ones are refused. */
#include "tests/support/unit.h"

#include "builder/format/lavapipe.h"
#include "tests/support/builder/test_blob.h"

static const struct test_shape triangles = {
    .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 30, .size = 10, .detail = 0.05};
static const struct test_shape aabbs = {
    .type = GEOMETRY_AABBS, .geometries = 2, .primitives = 20, .size = 10, .detail = 0.05};
static const struct test_shape instances = {
    .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 20, .size = 10, .detail = 0.05};
static const struct test_shape one = {
    .type = GEOMETRY_AABBS, .geometries = 1, .primitives = 1, .size = 10, .detail = 0.05};
static const struct test_shape nothing = {
    .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 0, .size = 1, .detail = 1};
static const struct test_shape *const shapes[] = {&triangles, &aabbs, &instances, &one, &nothing};

enum { SHAPE_COUNT = sizeof shapes / sizeof shapes[0], BODY = 56, ROOT = BODY + LAVAPIPE_HEADER };

/* A blob for a test to change. */
struct subject {
    unsigned char *blob;
    uint64_t size;
    enum lavapipe_variant variant;
};

static struct subject subject_make(const struct test_shape *shape, enum lavapipe_variant variant)
{
    struct bytes bytes = test_blob_make_native(shape, 11, variant);
    struct subject s = {.blob = malloc(bytes.size), .size = bytes.size, .variant = variant};
    assert_non_null(s.blob);
    memcpy(s.blob, bytes.data, bytes.size);
    test_blob_free(bytes);
    return s;
}

static enum bvhd_status open_bytes(const unsigned char *data, uint64_t size, enum lavapipe_variant variant,
                                   struct bvhd_error *ret_error, struct lavapipe_view *ret_view)
{
    struct memory memory;
    struct bytes bytes = {data, size};
    memory_init(&memory, UINT64_MAX);
    *ret_error = (struct bvhd_error){.status = BVHD_OK};
    enum bvhd_status status = lavapipe_open(bytes, variant, &memory, ret_view, ret_error);
    assert_int_equal(memory.live, 0);
    assert_int_equal(status, ret_error->status);
    return status;
}

static void expect(const struct subject *s, enum bvhd_status status, const char *where)
{
    struct bvhd_error error;
    struct lavapipe_view view;
    assert_int_equal(open_bytes(s->blob, s->size, s->variant, &error, &view), status);
    assert_string_equal(error.where, where);
    assert_true(status == BVHD_OK || error.text[0] != 0);
}

/* Writes a 32-bit value at a byte of the blob, expects an error, and restores the old value. */
static void spoil(struct subject *s, uint64_t at, uint32_t value, const char *where)
{
    uint32_t old = bytes_get32(s->blob + at);
    bytes_put32(s->blob + at, value);
    expect(s, BVHD_CORRUPT, where);
    bytes_put32(s->blob + at, old);
}

static void headers_are_checked(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, LAVAPIPE_PLAIN);
    expect(&s, BVHD_OK, "");
    spoil(&s, 32, (uint32_t)s.size + 8, "header.serializedSize");
    spoil(&s, 40, (uint32_t)s.size, "header.deserializedSize");
    spoil(&s, 48, 1, "header.deserializedSize");
    spoil(&s, BODY + 24, (uint32_t)s.size - 56, "body.serializationSize");
    spoil(&s, BODY + 28, 1, "body.instanceCount");
    spoil(&s, BODY + 36, 1, "body.padding");
    spoil(&s, BODY + 32, 40, "body.leafNodesOffset");
    spoil(&s, BODY + 32, 41 + 56, "body.leafNodesOffset");
    spoil(&s, BODY + 32, 40 + 56 * 1000, "body.leafNodesOffset");
    spoil(&s, BODY + 32, 0xffffffff, "body.leafNodesOffset");
    free(s.blob);
    s = subject_make(&triangles, LAVAPIPE_COMPACTED);
    expect(&s, BVHD_OK, "");
    spoil(&s, BODY + 24, (uint32_t)s.size, "body.compactedSize");
    spoil(&s, BODY + 28, 1, "body.serializationSize");
    spoil(&s, BODY + 32, 1, "body.instanceCount");
    spoil(&s, BODY + 36, 0, "body.leafNodesOffset");
    free(s.blob);
}

static void references_are_checked(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, LAVAPIPE_PLAIN);
    uint32_t leaves = bytes_get32(s.blob + BODY + 32);
    const uint64_t child = ROOT + 48;
    spoil(&s, child, 40 | LAVAPIPE_BOX, "node[0].children[0]"); /* the root again */
    spoil(&s, child, (96 + 4) | LAVAPIPE_BOX, "node[0].children[0]"); /* inside a box */
    spoil(&s, child, leaves | LAVAPIPE_BOX, "node[0].children[0]");
    spoil(&s, child, LAVAPIPE_BOX, "node[0].children[0]");
    spoil(&s, child, 0xfffffff0 | LAVAPIPE_BOX, "node[0].children[0]");
    spoil(&s, child, 96, "node[0].children[0]"); /* a box is not a triangle */
    spoil(&s, child, leaves + 4, "node[0].children[0]");
    spoil(&s, child, leaves + 48 * 60, "node[0].children[0]"); /* behind the last leaf */
    spoil(&s, child, 0xfffffffc, "node[0].children[0]");
    spoil(&s, child, leaves | LAVAPIPE_INSTANCE, "node[0].children[0]");
    /* Both children lead to the same box. The order of the walk is undefined, so either child may be reported. */
    uint32_t other = bytes_get32(s.blob + child + 4);
    bytes_put32(s.blob + child, other);
    struct bvhd_error error;
    struct lavapipe_view view;
    assert_int_equal(open_bytes(s.blob, s.size, LAVAPIPE_PLAIN, &error, &view), BVHD_CORRUPT);
    free(s.blob);
}

static void kinds_do_not_mix(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, LAVAPIPE_PLAIN);
    uint32_t leaves = bytes_get32(s.blob + BODY + 32);
    struct bvhd_error error;
    struct lavapipe_view view;
    bytes_put32(s.blob + ROOT + 48, leaves);
    bytes_put32(s.blob + ROOT + 52, leaves | LAVAPIPE_AABB);
    expect(&s, BVHD_CORRUPT, "node[0].children[1]");
    bytes_put32(s.blob + ROOT + 52, leaves + 48);
    assert_int_equal(open_bytes(s.blob, s.size, LAVAPIPE_PLAIN, &error, &view), BVHD_OK);
    assert_int_equal(view.levels, 1);
    bytes_put32(s.blob + ROOT + 52, leaves); /* two parts of one primitive */
    assert_int_equal(open_bytes(s.blob, s.size, LAVAPIPE_PLAIN, &error, &view), BVHD_OK);
    free(s.blob);
    s = subject_make(&instances, LAVAPIPE_PLAIN);
    /* a triangle among instances */
    spoil(&s, ROOT + 8 * 20 + 48, bytes_get32(s.blob + BODY + 8 * 20 + 32), "node[0].children[0]");
    free(s.blob);
}

/* Makes a chain of boxes, each with a leaf and the next box. */
static struct subject chain_of(uint32_t levels)
{
    struct test_shape shape = {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 40, .size = 1, .detail = 0.1};
    struct subject s = subject_make(&shape, LAVAPIPE_PLAIN);
    uint32_t leaves = bytes_get32(s.blob + BODY + 32);
    for (uint32_t i = 0; i < levels; i++) {
        bytes_put32(s.blob + ROOT + 56 * i + 48, leaves + 48 * i);
        bytes_put32(s.blob + ROOT + 56 * i + 52, i + 1 < levels ? (40 + 56 * (i + 1)) | LAVAPIPE_BOX : LAVAPIPE_NONE);
    }
    return s;
}

static void levels_are_counted_and_limited(void **state)
{
    (void)state;
    for (uint32_t levels = 1; levels <= 26; levels++) {
        struct subject s = chain_of(levels);
        struct bvhd_error error;
        struct lavapipe_view view;
        enum bvhd_status status = open_bytes(s.blob, s.size, s.variant, &error, &view);
        assert_int_equal(status, levels <= LAVAPIPE_MAX_LEVELS ? BVHD_OK : BVHD_INCOMPATIBLE);
        if (status == BVHD_OK)
            assert_int_equal(view.levels, levels);
        free(s.blob);
    }
}

/* The bytes are in a block of exactly their size, so that a sanitizer detects a read past the end. */
static void every_truncation_and_an_extra_byte(void **state)
{
    (void)state;
    for (int i = 0; i < 2 * SHAPE_COUNT; i++) {
        struct subject s = subject_make(shapes[i / 2], i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN);
        struct bvhd_error error;
        struct lavapipe_view view;
        for (uint64_t size = 0; size < s.size; size += size < 300 || s.size - size < 300 ? 1 : 61) {
            unsigned char *cut = malloc(size + !size);
            assert_non_null(cut);
            memcpy(cut, s.blob, size);
            assert_int_equal(open_bytes(cut, size, s.variant, &error, &view), BVHD_CORRUPT);
            if (size >= 56) { /* also with a header that states the shorter size */
                bytes_put64(cut + 32, size);
                bytes_put64(cut + 40, size - 56);
                assert_true(open_bytes(cut, size, s.variant, &error, &view) != BVHD_OK);
            }
            free(cut);
        }
        unsigned char *longer = calloc(1, s.size + 1);
        assert_non_null(longer);
        memcpy(longer, s.blob, s.size);
        assert_int_equal(open_bytes(longer, s.size + 1, s.variant, &error, &view), BVHD_CORRUPT);
        free(longer);
        free(s.blob);
    }
}

/* Reads everything in an opened view: all boxes and leaves that are referenced. */
static uint64_t visit(const struct lavapipe_view *view, uint32_t offset)
{
    struct lavapipe_box box = lavapipe_box_at(view, offset);
    uint64_t sum = 0;
    for (int child = 0; child < 2; child++) {
        uint32_t reference = box.children[child];
        if (reference == LAVAPIPE_NONE)
            continue;
        if ((reference & 3) == LAVAPIPE_BOX) {
            sum += visit(view, reference & ~3u);
            continue;
        }
        uint32_t leaf = lavapipe_leaf_index(view, reference);
        assert_true(leaf < view->leaf_count && (reference & 3) == view->kind);
        sum += 1;
        sum += view->kind == LAVAPIPE_TRIANGLE ? lavapipe_triangle_at(view, leaf).primitive
               : view->kind == LAVAPIPE_AABB
                   ? lavapipe_aabb_at(view, leaf).primitive
                   : lavapipe_instance_at(view, leaf).instance + bytes_get64(view->handles + 8 * leaf);
    }
    return sum;
}

static void every_flipped_bit_is_survived(void **state)
{
    (void)state;
    for (int i = 0; i < 2 * SHAPE_COUNT; i++) {
        struct subject s = subject_make(shapes[i / 2], i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN);
        uint64_t refused = 0;
        for (uint64_t bit = 0; bit < 8 * s.size; bit++) {
            struct bvhd_error error;
            struct lavapipe_view view;
            s.blob[bit / 8] ^= (unsigned char)(1u << bit % 8);
            if (open_bytes(s.blob, s.size, s.variant, &error, &view) == BVHD_OK)
                visit(&view, LAVAPIPE_HEADER);
            else
                refused++;
            s.blob[bit / 8] ^= (unsigned char)(1u << bit % 8);
        }
        assert_true(refused > 300); /* at least those in sizes and references */
        free(s.blob);
    }
}

/* Blobs come from files and sockets, at any address. */
static void alignment_does_not_matter(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPE_COUNT; i++) {
        struct subject s = subject_make(shapes[i], LAVAPIPE_PLAIN);
        unsigned char *shifted = malloc(s.size + 1);
        struct bvhd_error error;
        struct lavapipe_view first, second;
        assert_non_null(shifted);
        memcpy(shifted + 1, s.blob, s.size);
        assert_int_equal(open_bytes(s.blob, s.size, s.variant, &error, &first), BVHD_OK);
        assert_int_equal(open_bytes(shifted + 1, s.size, s.variant, &error, &second), BVHD_OK);
        assert_int_equal(visit(&first, LAVAPIPE_HEADER), visit(&second, LAVAPIPE_HEADER));
        free(shifted);
        free(s.blob);
    }
}

static void views_say_what_was_written(void **state)
{
    (void)state;
    static const uint32_t kinds[SHAPE_COUNT] = {LAVAPIPE_TRIANGLE, LAVAPIPE_AABB, LAVAPIPE_INSTANCE, LAVAPIPE_AABB,
                                                LAVAPIPE_TRIANGLE};
    for (int i = 0; i < 2 * SHAPE_COUNT; i++) {
        const struct test_shape *shape = shapes[i / 2];
        struct subject s = subject_make(shape, i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN);
        uint32_t primitives = shape->geometries * shape->primitives, boxes = primitives < 2 ? 1 : primitives - 1;
        struct bvhd_error error;
        struct lavapipe_view view;
        assert_int_equal(open_bytes(s.blob, s.size, s.variant, &error, &view), BVHD_OK);
        assert_int_equal(view.leaf_count, primitives);
        assert_int_equal(view.leaf_offset, 40 + 56 * boxes);
        assert_int_equal(view.handle_count, shape->type == GEOMETRY_INSTANCES ? primitives : 0);
        assert_int_equal(view.device.variant, s.variant);
        assert_memory_equal(view.device.driver_uuid, s.blob, 16);
        assert_memory_equal(view.device.compatibility_uuid, s.blob + 16, 16);
        if (primitives > 0)
            assert_int_equal(view.kind, kinds[i / 2]);
        free(s.blob);
    }
}

/* A structure opens under its own variant only. */
static void variants_tell_themselves(void **state)
{
    (void)state;
    for (int i = 0; i < 2 * SHAPE_COUNT; i++) {
        enum lavapipe_variant own = i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN,
                              other = i % 2 ? LAVAPIPE_PLAIN : LAVAPIPE_COMPACTED;
        struct subject s = subject_make(shapes[i / 2], own);
        struct memory memory;
        struct bvhd_error error;
        struct lavapipe_view view;
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(open_bytes(s.blob, s.size, other, &error, &view), BVHD_CORRUPT);
        assert_int_equal(lavapipe_open_any((struct bytes){s.blob, s.size}, &memory, &view, &error), BVHD_OK);
        assert_int_equal(view.device.variant, own);
        for (uint64_t size = 0; size < 120 && size < s.size; size++)
            assert_int_equal(lavapipe_open_any((struct bytes){s.blob, size}, &memory, &view, &error), BVHD_CORRUPT);
        free(s.blob);
    }
}

static void failing_allocations_are_reported(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, LAVAPIPE_PLAIN);
    struct memory memory;
    struct lavapipe_view view;
    memory_init(&memory, UINT64_MAX);
    memory.fail_after = 0;
    assert_int_equal(lavapipe_open((struct bytes){s.blob, s.size}, s.variant, &memory, &view, NULL), BVHD_NO_MEMORY);
    assert_int_equal(memory.live, 0);
    memory.fail_after = 1;
    assert_int_equal(lavapipe_open((struct bytes){s.blob, s.size}, s.variant, &memory, &view, NULL), BVHD_OK);
    assert_int_equal(memory.live, 0);
    free(s.blob);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(headers_are_checked),
        cmocka_unit_test(references_are_checked),
        cmocka_unit_test(kinds_do_not_mix),
        cmocka_unit_test(levels_are_counted_and_limited),
        cmocka_unit_test(every_truncation_and_an_extra_byte),
        cmocka_unit_test(every_flipped_bit_is_survived),
        cmocka_unit_test(alignment_does_not_matter),
        cmocka_unit_test(views_say_what_was_written),
        cmocka_unit_test(variants_tell_themselves),
        cmocka_unit_test(failing_allocations_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

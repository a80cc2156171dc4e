/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_read.c - tests that portable structures are opened, and that damaged ones are refused with the right
 * place.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/portable.h"
#include "tests/support/builder/test_blob.h"

static const struct test_shape triangles = {
    .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 200, .size = 10, .detail = 0.05};
static const struct test_shape aabbs = {
    .type = GEOMETRY_AABBS, .geometries = 2, .primitives = 100, .size = 10, .detail = 0.05};
static const struct test_shape instances = {
    .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 100, .size = 10, .detail = 0.05};
static const struct test_shape nothing = {
    .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 0, .size = 1, .detail = 1};

/* A blob for a test to change, and its parts. */
struct subject {
    unsigned char *blob;
    uint64_t size;
    struct portable_header *header;
    struct portable_node *nodes;
    unsigned char *records;
    struct portable_geometry *geometries;
};

static struct subject subject_make(const struct test_shape *shape, uint32_t flags)
{
    struct bytes bytes = test_blob_make(shape, 11, flags);
    struct subject s = {.size = bytes.size};
    void *copy = NULL;
    assert_int_equal(posix_memalign(&copy, 64, bytes.size), 0);
    memcpy(copy, bytes.data, bytes.size);
    s.blob = copy;
    unsigned char *body = s.blob + bytes_align(56 + 8 * bytes_get64(s.blob + 48), 64);
    s.header = (struct portable_header *)(void *)body;
    s.nodes = (struct portable_node *)(void *)(body + s.header->node_offset);
    s.records = body + s.header->record_offset;
    s.geometries = (struct portable_geometry *)(void *)(body + s.header->geometry_offset);
    test_blob_free(bytes);
    return s;
}

static enum bvhd_status open_bytes(const unsigned char *data, uint64_t size, struct bvhd_error *ret_error)
{
    struct memory memory;
    struct portable_view view;
    struct bytes bytes = {data, size};
    memory_init(&memory, UINT64_MAX);
    *ret_error = (struct bvhd_error){.status = BVHD_OK};
    enum bvhd_status status = portable_open(bytes, &memory, &view, ret_error);
    assert_int_equal(memory.live, 0);
    assert_int_equal(status, ret_error->status);
    return status;
}

static void expect(const struct subject *s, enum bvhd_status status, const char *where)
{
    struct bvhd_error error;
    assert_int_equal(open_bytes(s->blob, s->size, &error), status);
    assert_string_equal(error.where, where);
    assert_true(status == BVHD_OK || error.text[0] != 0);
}

/* Replaces the value of a field, expects an error, and restores the old value. */
#define SPOIL(s, field, value, where)                                                                                  \
    do {                                                                                                               \
        __typeof__(field) old_ = (field);                                                                              \
        (field) = (value);                                                                                             \
        expect((s), BVHD_CORRUPT, (where));                                                                            \
        (field) = old_;                                                                                                \
    } while (0)

static void headers_are_checked(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    struct portable_header *h = s.header;
    expect(&s, BVHD_OK, "");
    s.blob[3] ^= 1;
    expect(&s, BVHD_INCOMPATIBLE, "header.driverUUID");
    s.blob[3] ^= 1;
    static const uint8_t versions[] = {0, PORTABLE_NEWEST + 1, 0x81, 255};
    for (size_t i = 0; i < sizeof versions; i++) {
        s.blob[31] = versions[i];
        expect(&s, BVHD_INCOMPATIBLE, "header.compatibilityUUID");
    }
    s.blob[31] = 2; /* known, but not that of this body */
    expect(&s, BVHD_CORRUPT, "body.version");
    h->version = 2;
    expect(&s, BVHD_CORRUPT, "body.content");
    h->version = s.blob[31] = 1;
    s.blob[40] ^= 1;
    expect(&s, BVHD_CORRUPT, "header.deserializedSize");
    s.blob[40] ^= 1;
    SPOIL(&s, h->magic, 1, "body.magic");
    h->version = 0;
    expect(&s, BVHD_INCOMPATIBLE, "body.version");
    h->version = PORTABLE_NEWEST + 1;
    expect(&s, BVHD_INCOMPATIBLE, "body.version");
    h->version = 1;
    SPOIL(&s, h->content, PORTABLE_SPHERES, "body.content");
    SPOIL(&s, h->content, PORTABLE_CONTENTS, "body.content");
    SPOIL(&s, h->content, PORTABLE_TRIANGLES, "body.vertexCount");
    SPOIL(&s, h->primitive_count, 1 << 29, "body.primitiveCount");
    SPOIL(&s, h->primitive_count, h->primitive_count + 1, "body.primitiveCount");
    SPOIL(&s, h->depth, 0, "body.depth");
    SPOIL(&s, h->depth, 33, "body.depth");
    SPOIL(&s, h->depth, h->depth + 1, "body.depth");
    SPOIL(&s, h->record_count, 0, "body.recordCount");
    SPOIL(&s, h->reserved[1], 1, "body.reserved");
    SPOIL(&s, h->micromap_count, 1, "body.micromapCount");
    SPOIL(&s, h->micromap_offset, 1, "body.micromapOffset");
    SPOIL(&s, h->micromap_index_count, 1, "body.micromapOffset");
    SPOIL(&s, h->bounds[0], NAN, "body.bounds");
    SPOIL(&s, h->bounds[4], INFINITY, "body.bounds");
    SPOIL(&s, h->bounds[2], h->bounds[5] * 2 + 1, "body.bounds");
    SPOIL(&s, h->body_size, h->body_size - 16, "body.bodySize");
    SPOIL(&s, h->node_offset, h->node_offset + 16, "body.nodeOffset");
    SPOIL(&s, h->node_offset, 64, "body.nodeOffset");
    SPOIL(&s, h->node_count, 0xffffffff, "body.nodeCount");
    SPOIL(&s, h->node_count, 0x20000000, "body.nodeOffset");
    SPOIL(&s, h->record_offset, h->record_offset - 16, "body.recordOffset");
    SPOIL(&s, h->record_count, 0xffffffff, "body.nodeCount");
    SPOIL(&s, h->record_count, 0x20000000, "body.recordOffset");
    SPOIL(&s, h->vertex_offset, h->vertex_offset + 8, "body.vertexOffset");
    SPOIL(&s, h->vertex_offset, UINT64_MAX - 15, "body.vertexOffset");
    SPOIL(&s, h->vertex_count, h->vertex_count + 2, "body.geometryOffset");
    SPOIL(&s, h->geometry_count, h->geometry_count + 1, "body.geometryOffset");
    SPOIL(&s, h->geometry_count, h->geometry_count - 1, "body.primitiveCount");
    SPOIL(&s, s.geometries[1].first_primitive, 199, "geometries[1].firstPrimitive");
    SPOIL(&s, s.geometries[1].primitive_count, 201, "geometries[1].primitiveCount");
    SPOIL(&s, s.geometries[0].micromap, 1, "geometries[0].micromap");
    expect(&s, BVHD_OK, "");
    free(s.blob);
}

/* A refit would have to fill vertices that no triangle names, and has nothing to fill them with. */
static void vertices_need_triangles(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    struct portable_header *h = s.header;
    h->depth = h->node_count = h->record_count = 0;
    expect(&s, BVHD_CORRUPT, "body.vertexCount");
    h->vertex_count = 0;
    h->bounds[0] = h->bounds[3] + 1;
    expect(&s, BVHD_OK, "");
    free(s.blob);
}

static void nodes_are_checked(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    struct portable_node *n = s.nodes;
    unsigned inner = (unsigned)__builtin_ctz(n[0].inner_mask);
    unsigned leaf_node = 0;
    while (n[leaf_node].inner_mask != 0)
        leaf_node++;
    char where[64];
    expect(&s, BVHD_OK, "");
    SPOIL(&s, n[0].first_child, 0, "nodes[0].firstChild"); /* a cycle */
    SPOIL(&s, n[0].first_child, s.header->node_count, "nodes[0].firstChild");
    SPOIL(&s, n[0].first_child, 0xffffffff, "nodes[0].firstChild");
    SPOIL(&s, n[0].first_child, 2, "nodes[1]"); /* then node 1 has no parent */
    SPOIL(&s, n[0].inner_mask, 0, "nodes[0].innerMask");
    SPOIL(&s, n[0].meta[inner], 0x21, "nodes[0].meta");
    SPOIL(&s, n[0].meta[inner], 0x40, "nodes[0].meta");
    SPOIL(&s, n[0].meta[inner], 0xff, "nodes[0].meta");
    SPOIL(&s, n[0].meta[inner], (uint8_t)(0x20 | (24 + (inner ^ 1))), "nodes[0].meta");
    SPOIL(&s, n[0].first_record, 1, "nodes[0].firstRecord");
    SPOIL(&s, n[0].exponent[1], 255, "nodes[0].boxes");
    SPOIL(&s, n[0].origin[2], NAN, "nodes[0].boxes");
    SPOIL(&s, n[0].origin[0], -INFINITY, "nodes[0].boxes");
    SPOIL(&s, n[0].lo[2][inner], 255, "nodes[0].boxes");
    snprintf(where, sizeof where, "nodes[%u].firstChild", leaf_node);
    SPOIL(&s, n[leaf_node].first_child, 1, where);
    free(s.blob);
}

/* Nodes with two parents, and children before their parent, are found where counts alone would be right. */
static void children_have_one_parent(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    uint32_t first = 0, second = 0;
    for (uint32_t i = 1; i < s.header->node_count; i++)
        if (s.nodes[i].inner_mask) {
            second = first ? i : second;
            first = first ? first : i;
            if (second)
                break;
        }
    assert_true(first && second);
    struct bvhd_error error;
    s.nodes[second].first_child = s.nodes[first].first_child;
    assert_int_equal(open_bytes(s.blob, s.size, &error), BVHD_CORRUPT);
    assert_non_null(strstr(error.where, "nodes["));
    free(s.blob);
}

static void records_are_checked(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    struct portable_indexed_triangle *indexed = (struct portable_indexed_triangle *)(void *)s.records;
    SPOIL(&s, indexed[7].vertices[2], s.header->vertex_count, "records[7]");
    SPOIL(&s, indexed[0].id, 400, "records[0]");
    SPOIL(&s, indexed[0].id, 0x40000000, "records[0]");
    free(s.blob);

    s = subject_make(&triangles, PORTABLE_FAST_TRIANGLES);
    struct portable_triangle *fast = (struct portable_triangle *)(void *)s.records;
    expect(&s, BVHD_OK, "");
    SPOIL(&s, fast[399].id, 400, "records[399]");
    SPOIL(&s, fast[2].reserved2, 1, "records[2]");
    free(s.blob);

    s = subject_make(&aabbs, 0);
    struct portable_aabb *aabb = (struct portable_aabb *)(void *)s.records;
    expect(&s, BVHD_OK, "");
    SPOIL(&s, aabb[1].id, 200, "records[1]");
    SPOIL(&s, aabb[1].min[0], NAN, "records[1]");
    SPOIL(&s, aabb[1].max[2], aabb[1].min[2] - 1, "records[1]");
    SPOIL(&s, aabb[1].reserved, 1, "records[1]");
    free(s.blob);

    s = subject_make(&instances, 0);
    struct portable_instance *instance = (struct portable_instance *)(void *)s.records;
    expect(&s, BVHD_OK, "");
    SPOIL(&s, instance[5].handle, 3, "records[5]");
    SPOIL(&s, instance[5].instance, 100, "records[5]");
    SPOIL(&s, instance[5].reserved[3], 1, "records[5]");
    SPOIL(&s, s.header->content, PORTABLE_AABBS, "header.handleCount");
    SPOIL(&s, s.header->geometry_count, 1, "body.geometryCount");
    free(s.blob);
}

static void every_truncation_is_refused(void **state)
{
    (void)state;
    static const struct test_shape *const shapes[] = {&triangles, &aabbs, &instances, &nothing};
    for (int i = 0; i < 4; i++) {
        struct subject s = subject_make(shapes[i], 0);
        struct bvhd_error error;
        expect(&s, BVHD_OK, "");
        for (uint64_t size = 0; size < s.size; size++) {
            bytes_put64(s.blob + 32, size); /* the header states the shorter size */
            assert_int_not_equal(open_bytes(s.blob, size, &error), BVHD_OK);
        }
        free(s.blob);
    }
}

static void more_bytes_are_refused(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    unsigned char *longer;
    void *block = NULL;
    struct bvhd_error error;
    assert_int_equal(posix_memalign(&block, 64, s.size + 16), 0);
    longer = block;
    memcpy(longer, s.blob, s.size);
    memset(longer + s.size, 0, 16);
    assert_int_equal(open_bytes(longer, s.size + 16, &error), BVHD_CORRUPT);
    bytes_put64(longer + 32, s.size + 16);
    assert_int_equal(open_bytes(longer, s.size + 16, &error), BVHD_CORRUPT);
    assert_int_equal(open_bytes(longer, s.size + 16, &error), BVHD_CORRUPT);
    free(longer);
    free(s.blob);
}

static void no_memory_is_said(void **state)
{
    (void)state;
    struct subject s = subject_make(&triangles, 0);
    struct memory memory;
    struct portable_view view;
    struct bvhd_error error;
    struct bytes bytes = {s.blob, s.size};
    memory_init(&memory, UINT64_MAX);
    memory.fail_after = 0;
    assert_int_equal(portable_open(bytes, &memory, &view, &error), BVHD_NO_MEMORY);
    assert_int_equal(portable_open(bytes, &memory, &view, &error), BVHD_OK);
    assert_int_equal(memory.live, 0);
    free(s.blob);
}

static void geometries_are_found(void **state)
{
    (void)state;
    static const struct portable_geometry rows[] = {
        {0, 0, 0, 0}, {0, 0, 3, 0}, {0, 3, 0, 0}, {0, 3, 1, 0}, {0, 4, 2, 0}};
    struct portable_header header = {.geometry_count = 5};
    struct portable_view view = {.header = &header, .geometries = rows};
    static const uint32_t expected[] = {1, 1, 1, 3, 4, 4};
    for (uint32_t id = 0; id < 6; id++)
        assert_int_equal(portable_geometry_of(&view, id), expected[id]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(headers_are_checked),    cmocka_unit_test(vertices_need_triangles),
        cmocka_unit_test(nodes_are_checked),      cmocka_unit_test(children_have_one_parent),
        cmocka_unit_test(records_are_checked),    cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(more_bytes_are_refused), cmocka_unit_test(no_memory_is_said),
        cmocka_unit_test(geometries_are_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

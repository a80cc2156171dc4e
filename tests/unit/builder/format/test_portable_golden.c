/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_portable_golden.c - tests that the bytes of versions 1 and 2 of the portable layout stay the same.
 *
 * Fixed small trees must give the golden bytes in tests/golden/portable-v*.hex, which only change with the version.
 * With BVHD_WRITE_GOLDEN=1 in the environment the files are written instead of compared.
 */
#include "tests/support/unit.h"

#include "builder/format/layout.h"
#include "builder/format/portable.h"
#include "builder/format/swept_shape.h"
#include "proto/base/kind.h"

enum { VERTICES = 11, TRIANGLES = 9, NODES = 7 };

/* Two rows of five, and vertex 4, which no triangle uses. */
static const float positions[VERTICES][3] = {{0, 0, 0},        {1, 0, 0.125f},   {2, 0, 0.25f},       {3, 0, 0.375f},
                                             {9, 9, 9},        {4, 0, 0.5f},     {0, 1, -0.3333333f}, {1, 1.1f, 0.75f},
                                             {2, 1.2f, 1e-3f}, {3, 1.3f, -0.0f}, {4, 1.4f, 1000.5f}};
static const uint32_t indices[TRIANGLES][3] = {{0, 1, 6}, {1, 7, 6}, {1, 2, 7},  {2, 8, 7}, {2, 3, 8}, /* geometry 1: */
                                               {3, 9, 8}, {3, 5, 9}, {5, 10, 9}, {10, 9, 6}};
static const float radii[VERTICES] = {0.5f, 0.375f, 0.25f, 0.125f, 9, 1, 0.0625f, 2, 0.75f, 0, 0.5f};
static const uint32_t sphere_indices[5] = {0, 1, 2, 10, 5};
#define C1 CANONICAL_CAP_FIRST
#define C2 CANONICAL_CAP_SECOND
/* A chain with caps, then a cap at one end, and none. Geometry 1: a cap at the other end, and a chain with caps. */
static const uint32_t swept_indices[TRIANGLES] = {0 | C1 | C2, 1 | C2,      2 | C2, 6 | C1, 7,
                                                  9 | C2,      5 | C1 | C2, 6 | C2, 7 | C2};
static const uint32_t refs[TRIANGLES] = {2, 0, 1, 8, 4, 3, 5, 6, 7};

struct fixture {
    struct canonical canonical;
    struct canonical_geometry geometries[2];
    struct canonical_reference references[2];
    float aabbs[TRIANGLES][6];
    unsigned char instances[TRIANGLES][64];
    float round[VERTICES][4], ends[VERTICES][3];
    unsigned char moving_instances[TRIANGLES][MOTION_RECORD_STRIDE];
    struct box boxes[NODES], primitives[TRIANGLES], end_boxes[NODES], end_primitives[TRIANGLES];
    uint32_t refs[TRIANGLES];
    struct ir ir;
    struct wide_node nodes[2];
    struct wide wide;
};

static void fill_geometries(struct fixture *f, uint32_t type)
{
    f->canonical.type = STRUCTURE_BOTTOM;
    f->canonical.geometry_count = 2;
    for (uint32_t g = 0; g < 2; g++) {
        uint32_t first = g ? 5 : 0;
        f->geometries[g] = (struct canonical_geometry){
            .type = type,
            .flags = g ? GEOMETRY_NO_DUPLICATE_ANY_HIT : GEOMETRY_OPAQUE,
            .primitive_count = g ? 4 : 5,
            .first_primitive = first,
            .vertex_count = type == GEOMETRY_AABBS ? 0 : VERTICES,
            .first_vertex = type == GEOMETRY_AABBS ? 0 : g * VERTICES,
            .positions = positions[0],
            .indices = indices[first],
            .boxes = f->aabbs[first],
        };
    }
    f->canonical.vertex_count = type == GEOMETRY_AABBS ? 0 : 2 * VERTICES;
}

/* Geometry 1 stands still, in a structure that moves. */
static void fill_moving_triangles(struct fixture *f)
{
    for (uint32_t i = 0; i < VERTICES; i++)
        for (uint32_t axis = 0; axis < 3; axis++)
            f->ends[i][axis] = positions[i][axis] * 0.75f + 0.1f * (float)(i * axis);
    for (int i = 0; i < TRIANGLES; i++) {
        f->end_primitives[i] = box_empty();
        for (int k = 0; k < 3; k++)
            box_add_point(&f->end_primitives[i], i < 5 ? f->ends[indices[i][k]] : positions[indices[i][k]]);
    }
    f->geometries[0].end_positions = f->ends[0];
    f->geometries[1].type = GEOMETRY_TRIANGLES;
}

/* The spheres of geometry 1 have no indices: they are the first vertices. */
static void fill_round(struct fixture *f, bool is_swept)
{
    for (uint32_t i = 0; i < VERTICES; i++) {
        memcpy(f->round[i], positions[i], sizeof positions[i]);
        f->round[i][3] = radii[i];
    }
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        const uint32_t vertex = is_swept ? swept_indices[i] & CANONICAL_END_MASK : i < 5 ? sphere_indices[i] : i - 5;
        f->primitives[i] = swept_shape_sphere(f->round[vertex]);
        const struct box other = swept_shape_sphere(f->round[vertex + is_swept]);
        box_grow(&f->primitives[i], &other);
    }
    for (uint32_t g = 0; g < 2; g++) {
        f->geometries[g].vertex_count = VERTICES;
        f->geometries[g].first_vertex = g * VERTICES;
        f->geometries[g].positions = f->round[0];
        f->geometries[g].indices = is_swept ? swept_indices + 5 * g : g ? NULL : sphere_indices;
    }
    f->geometries[1].vertex_count = is_swept ? VERTICES : 4;
    f->canonical.vertex_count = VERTICES + f->geometries[1].vertex_count;
}

static void fill_instances(struct fixture *f)
{
    f->canonical.type = STRUCTURE_TOP;
    f->canonical.geometry_count = 1;
    f->canonical.reference_count = 2;
    f->canonical.references = f->references;
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        float matrix[12] = {2, 0, 0, (float)i, 0, 0.5f, 0, -1, 0.25f, 0, -4, 0.1f * (float)i};
        memcpy(f->instances[i], matrix, sizeof matrix);
        bytes_put32(f->instances[i] + 48, i | UINT32_C(0xff000000));
        bytes_put32(f->instances[i] + 52, (i * 7) | INSTANCE_FLIP_FACING << 24);
        bytes_put64(f->instances[i] + 56, 1 + i % 2);
    }
    f->geometries[0] = (struct canonical_geometry){.type = GEOMETRY_INSTANCES, .primitive_count = TRIANGLES};
    f->geometries[0].instances = f->instances[0];
}

/* Instances of each type in turn; those that turn have the same box at both keys. */
static void fill_moving_instances(struct fixture *f)
{
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        unsigned char *record = f->moving_instances[i], *at = record + MOTION_RECORD_DATA;
        const float srt[PORTABLE_SRT] = {2, 0, 0.5f, 0, 1, 0, 0, 3, -1, 0, 0.6f, 0, 0.8f, (float)i, -1, 2};
        bytes_put32(record, i % MOTION_TYPES);
        for (uint32_t key = 0; key < (i % MOTION_TYPES == MOTION_STATIC ? 1u : 2u); key++) {
            float numbers[PORTABLE_SRT];
            memcpy(numbers, i % MOTION_TYPES == MOTION_SRT ? (const void *)srt : f->instances[i], 48);
            memcpy(numbers + 12, srt + 12, 16);
            numbers[11] += 0.25f * (float)key;
            const size_t size = i % MOTION_TYPES == MOTION_SRT ? 64 : 48;
            memcpy(at, numbers, size);
            at += size;
        }
        memcpy(at, f->instances[i] + 48, 16);
        f->end_primitives[i] = f->primitives[i];
        if (i % MOTION_TYPES == MOTION_MATRIX)
            f->end_primitives[i].max[2] += 0.25f;
    }
    f->geometries[0].type = GEOMETRY_MOVING_INSTANCES;
    f->geometries[0].instances = f->moving_instances[0];
}

/* Makes seven ir nodes: the root, two leaves and an inner node below it, three leaves below that. */
static void fill_tree(struct fixture *f)
{
    static const uint32_t first[NODES] = {0, 0, 4, 3, 4, 6, 7}, count[NODES] = {9, 3, 5, 1, 2, 1, 2};
    memcpy(f->refs, refs, sizeof refs);
    for (int i = 0; i < NODES; i++) {
        f->boxes[i] = box_empty();
        for (uint32_t k = first[i]; k < first[i] + count[i]; k++)
            box_grow(&f->boxes[i], &f->primitives[refs[k]]);
        f->end_boxes[i] = box_empty();
        for (uint32_t k = first[i]; k < first[i] + count[i]; k++)
            box_grow(&f->end_boxes[i], &f->end_primitives[refs[k]]);
    }
    f->ir =
        (struct ir){.node_count = NODES, .ref_count = TRIANGLES, .key_count = 1, .boxes = {f->boxes}, .refs = f->refs};
    f->nodes[0] = (struct wide_node){.node = 0, .first_child = 1};
    f->nodes[0].slots[0] = (struct wide_child){1, 0, 3};
    f->nodes[0].slots[3] = (struct wide_child){2, 0, 0};
    f->nodes[0].slots[7] = (struct wide_child){3, 3, 1};
    f->nodes[1] = (struct wide_node){.node = 2, .first_leaf = 4};
    f->nodes[1].slots[1] = (struct wide_child){4, 4, 2};
    f->nodes[1].slots[2] = (struct wide_child){5, 6, 1};
    f->nodes[1].slots[4] = (struct wide_child){6, 7, 2};
    f->wide = (struct wide){.node_count = 2, .leaf_refs = TRIANGLES, .depth = 2, .nodes = f->nodes};
}

static void fill(struct fixture *f, uint32_t type)
{
    memset(f, 0, sizeof *f);
    for (int i = 0; i < TRIANGLES; i++) {
        f->primitives[i] = box_empty();
        for (int k = 0; k < 3; k++)
            box_add_point(&f->primitives[i], positions[indices[i][k]]);
        memcpy(f->aabbs[i], &f->primitives[i], sizeof f->aabbs[i]);
    }
    f->canonical.geometries = f->geometries;
    f->canonical.primitive_count = TRIANGLES;
    f->canonical.flags = BUILD_PREFER_FAST_TRACE;
    if (kind_find(type)->is_top)
        fill_instances(f);
    else
        fill_geometries(f, type);
    if (type == GEOMETRY_SPHERES || type == GEOMETRY_SWEPT_SPHERES)
        fill_round(f, type == GEOMETRY_SWEPT_SPHERES);
    if (type == GEOMETRY_MOVING_TRIANGLES)
        fill_moving_triangles(f);
    if (type == GEOMETRY_MOVING_INSTANCES)
        fill_moving_instances(f);
    fill_tree(f);
    if (kind_find(type)->moves) {
        f->ir.key_count = 2;
        f->ir.boxes[1] = f->end_boxes;
    }
}

static FILE *open_golden(const char *name, const char *mode)
{
    const char *directory = getenv("BVHD_GOLDEN");
    char path[1024];
    snprintf(path, sizeof path, "%s/portable-%s.hex", directory ? directory : "tests/golden", name);
    FILE *file = fopen(path, mode);
    if (!file)
        fail_msg("cannot open %s", path);
    return file;
}

static void write_golden(const char *name, const unsigned char *bytes, uint64_t size)
{
    FILE *file = open_golden(name, "w");
    for (uint64_t i = 0; i < size; i++)
        fprintf(file, "%02x%s", bytes[i], i % 16 == 15 || i + 1 == size ? "\n" : " ");
    assert_int_equal(fclose(file), 0);
}

static void compare_golden(const char *name, const unsigned char *bytes, uint64_t size)
{
    FILE *file = open_golden(name, "r");
    uint64_t count = 0;
    unsigned byte;
    for (; fscanf(file, "%x", &byte) == 1; count++)
        if (count < size && byte != bytes[count])
            fail_msg("%s: byte %llu is %02x, golden %02x", name, (unsigned long long)count, bytes[count], byte);
    fclose(file);
    assert_int_equal(count, size);
}

static void check(const char *name, const struct fixture *f, uint32_t flags)
{
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct layout_input input = {.canonical = &f->canonical,
                                       .ir = &f->ir,
                                       .wide = &f->wide,
                                       .layout_flags = flags,
                                       .memory = &memory,
                                       .parallel = &parallel_serial};
    unsigned char *blob;
    struct layout_sizes sizes;
    struct bvhd_error error;
    struct portable_view view;
    assert_int_equal(layout_portable.write(&input, &blob, &sizes, &error), BVHD_OK);
    if (getenv("BVHD_WRITE_GOLDEN"))
        write_golden(name, blob, sizes.total);
    compare_golden(name, blob, sizes.total);
    struct bytes bytes = {blob, sizes.total};
    if (portable_open(bytes, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", name, error.where, error.text);
    memory_free(&memory, blob);
    assert_int_equal(memory.live, 0);
}

static void indexed_triangles(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    check("v1-indexed", &f, 0);
}

static void fast_triangles(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    check("v1-triangles", &f, PORTABLE_FAST_TRIANGLES);
}

static void aabbs(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_AABBS);
    check("v1-aabbs", &f, 0);
}

static void instances(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_INSTANCES);
    check("v1-instances", &f, 0);
}

static void spheres(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_SPHERES);
    check("v2-spheres", &f, 0);
}

static void swept_spheres(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_SWEPT_SPHERES);
    check("v2-swept-spheres", &f, 0);
}

static void moving_triangles(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_MOVING_TRIANGLES);
    check("v2-moving-triangles", &f, 0);
}

static void moving_instances(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_MOVING_INSTANCES);
    check("v2-moving-instances", &f, 0);
}

static void empty(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    f.wide = (struct wide){0};
    f.ir.node_count = f.ir.ref_count = 0;
    check("v1-empty", &f, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(indexed_triangles),
        cmocka_unit_test(fast_triangles),
        cmocka_unit_test(aabbs),
        cmocka_unit_test(instances),
        cmocka_unit_test(empty),
        cmocka_unit_test(spheres),
        cmocka_unit_test(swept_spheres),
        cmocka_unit_test(moving_triangles),
        cmocka_unit_test(moving_instances),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

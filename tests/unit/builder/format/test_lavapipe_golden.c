/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_lavapipe_golden.c - tests that the bytes of version 1 of the lavapipe layout stay the same in both variants.
 *
 * Fixed small trees must give the golden bytes in tests/golden/lavapipe-v1-*.hex, which only change with the version.
 * With BVHD_WRITE_GOLDEN=1 in the environment the files are written instead of compared.
 */
#include "tests/support/unit.h"

#include "builder/format/lavapipe.h"
#include "builder/format/layout.h"

enum { PRIMITIVES = 6, FIRST = 4, NODES = 9 };

/* Primitive 2 is not in the tree, as if it were inactive; primitive 5 is in two leaves. */
static const float positions[3 * PRIMITIVES][3] = {
    {0, 0, 0},  {1, 0, 0.125f}, {0, 1, -0.0f},  {2, -0.0f, 1}, {3, 0, 1},     {2, 1.1f, 0.3333333f},
    {9, 9, 9},  {8, 9, 9},      {9, 8, 9},      {4, 0, 1},     {5, 1e-3f, 2}, {4, 1, 2},
    {-7, 0, 0}, {-6, 0, 1},     {-7, 1, 0.75f}, {10, 2, 0},    {20, 3, 0.5f}, {10, 4, 1000.5f},
};
static const uint32_t refs[PRIMITIVES] = {4, 5, 0, 1, 3, 5};
/*
 * An inner node's first child, or a leaf's ref. The children of the root's second child come before those of the first.
 */
static const struct ir_node nodes[NODES] = {{1, 0}, {5, 0}, {3, 0}, {2, 1}, {7, 0}, {0, 1}, {1, 1}, {3, 1}, {4, 1}};

struct fixture {
    struct canonical canonical;
    struct canonical_geometry geometries[2];
    struct canonical_reference references[2];
    float aabbs[PRIMITIVES][6];
    unsigned char instances[PRIMITIVES][64];
    struct box boxes[NODES];
    uint32_t refs[PRIMITIVES];
    struct ir_node nodes[NODES];
    struct ir ir;
};

static void fill_geometries(struct fixture *f, uint32_t type)
{
    f->canonical.type = STRUCTURE_BOTTOM;
    f->canonical.geometry_count = 2;
    for (uint32_t g = 0; g < 2; g++) {
        uint32_t first = g ? FIRST : 0, count = g ? PRIMITIVES - FIRST : FIRST;
        f->geometries[g] = (struct canonical_geometry){
            .type = type,
            .flags = g ? GEOMETRY_NO_DUPLICATE_ANY_HIT : GEOMETRY_OPAQUE,
            .primitive_count = count,
            .first_primitive = first,
            .vertex_count = type == GEOMETRY_TRIANGLES ? 3 * count : 0,
            .first_vertex = type == GEOMETRY_TRIANGLES ? 3 * first : 0,
            .positions = positions[3 * first],
            .boxes = f->aabbs[first],
        };
    }
}

/* Primitive 2 is a null instance. */
static void fill_instances(struct fixture *f)
{
    f->canonical.type = STRUCTURE_TOP;
    f->canonical.geometry_count = 1;
    f->canonical.reference_count = 2;
    f->canonical.references = f->references;
    for (uint32_t i = 0; i < PRIMITIVES; i++) {
        float matrix[12] = {2, 0, 0, (float)i, 0, 0.5f, 0, -1, 0.25f, 0, -4, 0.1f * (float)i};
        memcpy(f->instances[i], matrix, sizeof matrix);
        bytes_put32(f->instances[i] + 48, i | UINT32_C(0xff000000));
        bytes_put32(f->instances[i] + 52, (i * 7) | (uint32_t)INSTANCE_FLIP_FACING << 24);
        bytes_put64(f->instances[i] + 56, i == 2 ? 0 : 1 + i % 2);
    }
    f->geometries[0] = (struct canonical_geometry){.type = GEOMETRY_INSTANCES, .primitive_count = PRIMITIVES};
    f->geometries[0].instances = f->instances[0];
}

static void fill(struct fixture *f, uint32_t type)
{
    memset(f, 0, sizeof *f);
    struct box boxes[PRIMITIVES];
    for (int i = 0; i < PRIMITIVES; i++) {
        boxes[i] = box_empty();
        for (int k = 0; k < 3; k++)
            box_add_point(&boxes[i], positions[3 * i + k]);
        memcpy(f->aabbs[i], &boxes[i], sizeof f->aabbs[i]);
    }
    f->canonical.geometries = f->geometries;
    f->canonical.primitive_count = PRIMITIVES;
    if (type == GEOMETRY_INSTANCES)
        fill_instances(f);
    else
        fill_geometries(f, type);
    memcpy(f->refs, refs, sizeof refs);
    memcpy(f->nodes, nodes, sizeof nodes);
    f->refs[5] = 5;
    for (int i = NODES; i-- > 0;) {
        f->boxes[i] = nodes[i].count ? boxes[refs[nodes[i].first]] : f->boxes[nodes[i].first];
        if (!nodes[i].count)
            box_grow(&f->boxes[i], &f->boxes[nodes[i].first + 1]);
    }
    f->ir = (struct ir){
        .node_count = NODES, .ref_count = 5, .key_count = 1, .nodes = f->nodes, .boxes = {f->boxes}, .refs = f->refs};
}

static FILE *open_golden(const char *name, int variant, const char *mode)
{
    const char *directory = getenv("BVHD_GOLDEN");
    char path[1024];
    snprintf(path, sizeof path, "%s/lavapipe-v1-%s-%s.hex", directory ? directory : "tests/golden",
             variant == LAVAPIPE_PLAIN ? "plain" : "compacted", name);
    FILE *file = fopen(path, mode);
    if (!file)
        fail_msg("cannot open %s", path);
    return file;
}

static void write_golden(const char *name, int variant, const unsigned char *bytes, uint64_t size)
{
    FILE *file = open_golden(name, variant, "w");
    for (uint64_t i = 0; i < size; i++)
        fprintf(file, "%02x%s", bytes[i], i % 16 == 15 || i + 1 == size ? "\n" : " ");
    assert_int_equal(fclose(file), 0);
}

static void compare_golden(const char *name, int variant, const unsigned char *bytes, uint64_t size)
{
    FILE *file = open_golden(name, variant, "r");
    uint64_t count = 0;
    unsigned byte;
    for (; fscanf(file, "%x", &byte) == 1; count++)
        if (count < size && byte != bytes[count])
            fail_msg("%s: byte %llu is %02x, golden %02x", name, (unsigned long long)count, bytes[count], byte);
    fclose(file);
    assert_int_equal(count, size);
}

static void check(const char *name, const struct fixture *f)
{
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        const struct device_format device = {
            .driver_uuid = "25.0.7-golden", .compatibility_uuid = "other golden", .variant = (uint32_t)variant};
        struct memory memory;
        memory_init(&memory, UINT64_MAX);
        const struct layout_input input = {.canonical = &f->canonical,
                                           .ir = &f->ir,
                                           .device = &device,
                                           .memory = &memory,
                                           .parallel = &parallel_serial};
        unsigned char *blob;
        struct layout_sizes sizes;
        struct bvhd_error error;
        struct lavapipe_view view;
        assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, &error), BVHD_OK);
        if (getenv("BVHD_WRITE_GOLDEN"))
            write_golden(name, variant, blob, sizes.total);
        compare_golden(name, variant, blob, sizes.total);
        struct bytes bytes = {blob, sizes.total};
        if (lavapipe_open(bytes, (enum lavapipe_variant)variant, &memory, &view, &error) != BVHD_OK)
            fail_msg("%s: %s: %s", name, error.where, error.text);
        memory_free(&memory, blob);
        assert_int_equal(memory.live, 0);
    }
}

static void triangles(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    check("triangles", &f);
}

static void aabbs(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_AABBS);
    check("aabbs", &f);
}

static void instances(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_INSTANCES);
    check("instances", &f);
}

static void one(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    f.canonical.geometry_count = 1;
    f.canonical.primitive_count = f.geometries[0].primitive_count = 1;
    f.nodes[0] = (struct ir_node){2, 1};
    f.boxes[0] = f.boxes[3];
    f.ir.node_count = 1;
    check("one", &f);
}

static void empty(void **state)
{
    struct fixture f;
    (void)state;
    fill(&f, GEOMETRY_TRIANGLES);
    f.canonical.geometry_count = f.canonical.primitive_count = f.ir.node_count = f.ir.ref_count = 0;
    check("empty", &f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles), cmocka_unit_test(aabbs), cmocka_unit_test(instances),
        cmocka_unit_test(one),       cmocka_unit_test(empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

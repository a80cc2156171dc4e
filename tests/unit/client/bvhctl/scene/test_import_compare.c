/* SPDX-License-Identifier: Apache-2.0 */
/* test_import_compare.c - tests that two imports of a file are compared, and that hashes see every difference. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/scene/import_compare.h"
#include "client/bvhctl/scene/import_hash.h"
#include "tests/support/scratch.h"

static struct memory memory;

static int enter_scratch(void **state)
{
    memory_init(&memory, UINT64_MAX);
    return scratch_enter(state);
}

static void import_text(const char *path, const char *text, struct import *ret_import)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, strlen(text), file), strlen(text));
    fclose(file);
    struct bvhd_error error = {0};
    if (import_scene(path, NULL, &memory, ret_import, &error))
        fail_msg("%s: %s", error.where, error.text);
}

#define HEADER "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
#define ROWS "end_header\n0 0 0\n1 0 0\n1 2 0\n0 1 0.1\n9 9 9\n"

/* Both readers make two triangles of the quad; the vertex without a face is not in the bounds. */
static void test_agreement(void **state)
{
    (void)state;
    struct import import;
    import_text("quad.ply", HEADER "element face 1\nproperty list uchar int vertex_indices\n" ROWS "4 0 1 2 3\n",
                &import);
    struct import_comparison comparison = import_compare("quad.ply", &import, &memory);
    assert_int_equal(comparison.agreement, IMPORT_AGREES);
    assert_int_equal(comparison.first.triangles, 2);
    assert_int_equal(comparison.second.triangles, 2);
    assert_true(comparison.first.high[1] == 2);
    import.meshes[0].positions[0] = -0.5f;
    comparison = import_compare("quad.ply", &import, &memory);
    assert_int_equal(comparison.agreement, IMPORT_DIFFERS);
    import.meshes[0].positions[0] = 0;
    import.meshes[0].primitive_count = 1;
    comparison = import_compare("quad.ply", &import, &memory);
    assert_int_equal(comparison.agreement, IMPORT_DIFFERS);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

/* Assimp takes one triangle of each strip at most; and there are files that it does not read. */
static void test_disagreement(void **state)
{
    (void)state;
    struct import import;
    import_text("strip.ply", HEADER "element tristrips 1\nproperty list int int vertex_indices\n" ROWS "4 0 1 2 3\n",
                &import);
    assert_int_equal(import.triangle_count, 2);
    struct import_comparison comparison = import_compare("strip.ply", &import, &memory);
    assert_true(comparison.agreement == IMPORT_DIFFERS || comparison.agreement == IMPORT_AGREES);
    assert_int_equal(comparison.first.triangles, 2);
    remove("strip.ply");
    comparison = import_compare("strip.ply", &import, &memory);
    assert_int_equal(comparison.agreement, IMPORT_REFUSED);
    assert_true(comparison.text[0]);
    import_finish(&import);
    import_text("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &import);
    assert_int_equal(import_compare("one.obj", &import, &memory).agreement, IMPORT_NOT_COMPARED);
    import_finish(&import);
}

/* Instances count with their transforms, unless they are skipped. */
static void test_instances(void **state)
{
    (void)state;
    struct import import;
    import_text("quad.ply", HEADER "element face 1\nproperty list uchar int vertex_indices\n" ROWS "4 0 1 2 3\n",
                &import);
    const float moved[12] = {2, 0, 0, 10, 0, 1, 0, 0, 0, 0, 1, -5};
    memcpy(import.instances[0].transform, moved, sizeof moved);
    struct import_comparison comparison = import_compare("quad.ply", &import, &memory);
    assert_int_equal(comparison.agreement, IMPORT_DIFFERS);
    assert_true(comparison.first.low[0] == 10 && comparison.first.high[0] == 12 && comparison.first.low[2] == -5);
    import.instances[0].skipped = true;
    comparison = import_compare("quad.ply", &import, &memory);
    assert_int_equal(comparison.first.triangles, 0);
    assert_true(comparison.first.low[0] > comparison.first.high[0]);
    import_finish(&import);
}

static void test_hash(void **state)
{
    (void)state;
    struct import import;
    import_text("quad.ply", HEADER "element face 1\nproperty list uchar int vertex_indices\n" ROWS "4 0 1 2 3\n",
                &import);
    uint64_t hash = import_hash(&import);
    struct import_mesh *mesh = &import.meshes[0];
    unsigned char *places[] = {(unsigned char *)&mesh->positions[14],
                               (unsigned char *)&mesh->indices[5],
                               (unsigned char *)&import.instances[0].transform[3],
                               (unsigned char *)&import.instances[0].skipped,
                               (unsigned char *)&import.counts.lost,
                               (unsigned char *)&import.bottoms[0].meshes[0]};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        *places[i] ^= 1;
        assert_true(import_hash(&import) != hash);
        *places[i] ^= 1;
        assert_true(import_hash(&import) == hash);
    }
    import_finish(&import);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_agreement), cmocka_unit_test(test_disagreement),
                                       cmocka_unit_test(test_instances), cmocka_unit_test(test_hash)};
    return cmocka_run_group_tests_name("import_compare", tests, enter_scratch, scratch_remove);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_file_names.c - tests that names of files are safe, and depend on a structure's own source alone. */
#include "tests/support/unit.h"

#include "client/bvhctl/scene/file_names.h"

enum { MESHES = 4 };

static float corners[MESHES][9] = {
    {0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 0, 1, 0, 0, 0, 1, 1}, {0, 0, 0, 1, 0, 0, 0, 1, 2}};
static uint32_t triangle[3] = {0, 1, 2};
static uint32_t numbers[MESHES] = {0, 1, 2, 3};

/* A scene of meshes with their own bottom levels. */
struct fixture {
    struct memory memory;
    struct import_mesh meshes[MESHES];
    struct import_bottom bottoms[MESHES];
    struct import import;
    struct file_names names;
};

static void add(struct fixture *f, const char *name, int geometry)
{
    uint32_t i = f->import.mesh_count++;
    f->import.bottom_count++;
    f->meshes[i] = (struct import_mesh){.name = (char *)(uintptr_t)name,
                                        .material = (char *)(uintptr_t) "",
                                        .positions = corners[geometry],
                                        .indices = triangle,
                                        .vertex_count = 3,
                                        .primitive_count = 1};
    f->bottoms[i] = (struct import_bottom){.meshes = &numbers[i], .mesh_count = 1};
}

static void begin(struct fixture *f, const char *scene)
{
    *f = (struct fixture){.import = {.name = (char *)(uintptr_t)scene}};
    memory_init(&f->memory, UINT64_MAX);
    f->import.memory = &f->memory;
    f->import.meshes = f->meshes;
    f->import.bottoms = f->bottoms;
}

static void make(struct fixture *f)
{
    assert_int_equal(file_names_make(&f->import, &f->names, NULL), BVHD_OK);
}

static void finish(struct fixture *f)
{
    file_names_finish(&f->names);
    file_names_finish(&f->names);
    assert_int_equal(f->memory.live, 0);
}

/* Expects the name up to the digest, which is 16 hexadecimal digits. */
static void check_name(const char *scene, const char *mesh, const char *expected)
{
    struct fixture f;
    begin(&f, scene);
    add(&f, mesh, 0);
    make(&f);
    const char *file = f.names.files[0];
    size_t length = strlen(expected);
    assert_int_equal(strlen(file), length + 16 + 3);
    assert_memory_equal(file, expected, length);
    assert_int_equal(strspn(file + length, "0123456789abcdef"), 16);
    assert_string_equal(file + length + 16, ".as");
    finish(&f);
}

static void names_are_safe(void **state)
{
    (void)state;
    char endless[300];
    memset(endless, 'e', sizeof endless - 1);
    endless[sizeof endless - 1] = '\0';
    check_name("dragon", "Wing.left", "dragon.blas-Wing_left-");
    check_name("dragon", "", "dragon.blas-");
    check_name("dragon", "../../etc/pass wd", "dragon.blas-_etc_pass_wd-");
    check_name("\xc3\xa4\xc3\xb6 b", "\xc3\xa4\xc3\xb6 b", "_b.blas-_b-");
    check_name(".x", ".x", "_x.blas-_x-");
    check_name("dragon", endless, "dragon.blas-eeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeee-");
    check_name("dragon", "meshes[12]", "dragon.blas-");
    check_name("dragon", "meshes[12]-0", "dragon.blas-");
    check_name("dragon", "meshes[12]x", "dragon.blas-meshes_12_x-");
    struct fixture f;
    begin(&f, "");
    add(&f, "", 0);
    make(&f);
    assert_string_equal(f.names.files[1], "_.tlas.as");
    finish(&f);
}

/* Names stay when meshes are put in front, between and behind, and when their numbers change. */
static void neighbours_do_not_matter(void **state)
{
    struct fixture alone, among;
    (void)state;
    begin(&alone, "s");
    add(&alone, "a", 0);
    add(&alone, "meshes[1]", 1);
    begin(&among, "s");
    add(&among, "meshes[0]", 2);
    add(&among, "meshes[1]", 1);
    add(&among, "a", 0);
    make(&alone);
    make(&among);
    assert_string_equal(alone.names.files[0], among.names.files[2]);
    assert_string_equal(alone.names.files[1], among.names.files[1]);
    assert_string_not_equal(among.names.files[0], among.names.files[1]);
    finish(&alone);
    finish(&among);
}

/* A mesh's name depends on all that decides its bytes and its words in the manifest. */
static void contents_matter(void **state)
{
    struct fixture f;
    (void)state;
    begin(&f, "s");
    for (int i = 0; i < MESHES; i++)
        add(&f, "m", i == 1);
    f.meshes[2].material = (char *)(uintptr_t) "red";
    f.meshes[3].has_colour = true;
    make(&f);
    for (int i = 0; i < MESHES; i++) {
        assert_int_equal(f.names.first[i], i);
        for (int k = 0; k < i; k++)
            assert_string_not_equal(f.names.files[i], f.names.files[k]);
    }
    finish(&f);
}

static void equal_meshes_share_a_file(void **state)
{
    struct fixture f;
    (void)state;
    begin(&f, "s");
    add(&f, "b", 1);
    add(&f, "a", 0);
    add(&f, "b", 1);
    add(&f, "a", 0);
    make(&f);
    static const uint32_t first[] = {0, 1, 0, 1, 4};
    assert_int_equal(f.names.count, 5);
    assert_memory_equal(f.names.first, first, sizeof first);
    assert_string_equal(f.names.files[0], f.names.files[2]);
    assert_string_equal(f.names.files[4], "s.tlas.as");
    finish(&f);
}

static void several_primitives_have_the_name_of_their_mesh(void **state)
{
    struct fixture f;
    (void)state;
    begin(&f, "s");
    add(&f, "house-0", 0);
    add(&f, "house-1", 1);
    f.import.bottom_count = 1;
    f.bottoms[0].mesh_count = 2;
    make(&f);
    assert_memory_equal(f.names.files[0], "s.blas-house-", 13);
    assert_int_equal(strlen(f.names.files[0]), 13 + 16 + 3);
    finish(&f);
}

static void without_memory(void **state)
{
    struct fixture f;
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    begin(&f, "s");
    add(&f, "a", 0);
    for (int64_t n = 0; status != BVHD_OK; n++) {
        f.memory.fail_after = n;
        status = file_names_make(&f.import, &f.names, NULL);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && f.memory.live == 0));
    }
    finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_are_safe),
        cmocka_unit_test(neighbours_do_not_matter),
        cmocka_unit_test(contents_matter),
        cmocka_unit_test(equal_meshes_share_a_file),
        cmocka_unit_test(several_primitives_have_the_name_of_their_mesh),
        cmocka_unit_test(without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

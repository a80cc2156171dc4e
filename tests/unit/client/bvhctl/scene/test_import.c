/* SPDX-License-Identifier: Apache-2.0 */
/* test_import.c - tests that scene files are imported completely and bit by bit, and that broken files are refused. */
#include "tests/support/unit.h"

#include <math.h>
#include <unistd.h>

#include "client/bvhctl/scene/import.h"
#include "tests/support/scratch.h"

static void write_file(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

static void write_text(const char *path, const char *text)
{
    write_file(path, text, strlen(text));
}

static void import_good(const char *path, struct memory *memory, struct import *ret_import)
{
    struct bvhd_error error = {0};
    memory_init(memory, UINT64_MAX);
    if (import_scene(path, NULL, memory, ret_import, &error))
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

/* A quad and a triangle, a line and a point, in one object; a second object with another material. */
static const char sample_obj[] = "o first\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 5 5\n"
                                 "usemtl red\nf 1 2 3 4\nf 1 2 5\nl 1 5\np 5\n"
                                 "o second\nusemtl blue\nv 9 9 9\nf 1 2 6\n";

static void test_faces(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    write_text("a scene.v2.obj", sample_obj);
    import_good("a scene.v2.obj", &memory, &import);
    assert_string_equal(import.name, "a scene.v2");
    assert_int_equal(import.triangle_count, 4);
    assert_int_equal(import.counts.points, 1);
    assert_int_equal(import.counts.lines, 1);
    assert_int_equal(import.skipped_instances, 0);
    uint64_t triangles = 0;
    for (uint32_t i = 0; i < import.mesh_count; i++) {
        triangles += import.meshes[i].primitive_count;
        for (uint32_t k = 0; k < 3 * import.meshes[i].primitive_count; k++)
            assert_true(import.meshes[i].indices[k] < import.meshes[i].vertex_count);
    }
    assert_int_equal(triangles, 4);
    assert_true(import.file_count >= 1);
    assert_string_equal(import.files[0], "a scene.v2.obj");
    finish(&import, &memory);
}

/* Corners at the same place are one vertex, which assimp gives each triangle of an OBJ file for itself. */
static void test_welded(void **state)
{
    (void)state;
    static const uint32_t expected[9] = {0, 1, 2, 0, 2, 3, 3, 2, 4};
    struct memory memory;
    struct import import;
    write_text("welded.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 0\nvn 0 0 1\nvn 0 1 0\n"
                             "f 1//1 2//1 3//1\nf 1//2 3//2 4//2\nf 4//1 3//2 5//1\n");
    import_good("welded.obj", &memory, &import);
    assert_int_equal(import.meshes[0].vertex_count, 5);
    assert_int_equal(import.meshes[0].primitive_count, 3);
    assert_memory_equal(import.meshes[0].indices, expected, sizeof expected);
    finish(&import, &memory);
}

/*
 * A binary PLY file with NaN, infinity, a repeated vertex and a face that names one vertex three times: everything must
 * be imported bit by bit.
 */
static void test_nothing_is_dropped(void **state)
{
    (void)state;
    static const char header[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
        "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n";
    const float positions[15] = {0, 0, 0, NAN, 1, 2, 3, INFINITY, -INFINITY, 0, 0, 0, 1e-42f, 3e38f, -0.0f};
    const int32_t faces[4][3] = {{0, 1, 2}, {3, 3, 3}, {0, 3, 4}, {4, 2, 0}};
    unsigned char data[512];
    size_t size = sizeof header - 1;
    memcpy(data, header, size);
    memcpy(data + size, positions, sizeof positions);
    size += sizeof positions;
    for (int i = 0; i < 4; i++) {
        data[size] = 3;
        memcpy(data + size + 1, faces[i], sizeof faces[i]);
        size += 1 + sizeof faces[i];
    }
    write_file("odd.ply", data, size);
    struct memory memory;
    struct import import;
    import_good("odd.ply", &memory, &import);
    assert_int_equal(import.mesh_count, 1);
    assert_int_equal(import.meshes[0].primitive_count, 4);
    assert_int_equal(import.meshes[0].vertex_count, 5);
    assert_memory_equal(import.meshes[0].positions, positions, sizeof positions);
    assert_memory_equal(import.meshes[0].indices, faces, sizeof faces);
    finish(&import, &memory);
}

/*
 * Nodes: A (mesh 0, moved), its child B (mesh 0, scaled), C (mesh 1), D (mesh 0 under a matrix without an inverse), E
 * (no mesh, twice the size) with the child F (mesh 1).
 */
static const char sample_gltf[] =
    "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0,2,3,4]}],"
    "\"buffers\":[{\"uri\":\"sample.bin\",\"byteLength\":48}],"
    "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":"
    "12}],"
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,"
    "2,0]},"
    "{\"bufferView\":1,\"componentType\":5125,\"count\":3,\"type\":\"SCALAR\"}],"
    "\"materials\":[{\"name\":\"green\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.25,0.5,0.125,1]}}],"
    "\"meshes\":[{\"name\":\"m0\",\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,\"material\":0}]},"
    "{\"name\":\"m1\",\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,\"material\":0},"
    "{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],"
    "\"nodes\":[{\"name\":\"A\",\"mesh\":0,\"translation\":[10,20,30],\"children\":[1]},"
    "{\"name\":\"B\",\"mesh\":0,\"scale\":[2,3,4]},"
    "{\"name\":\"C\",\"mesh\":1},"
    "{\"name\":\"D\",\"mesh\":0,\"matrix\":[1,0,0,0,0,0,0,0,0,0,1,0,0,0,0,1]},"
    "{\"name\":\"E\",\"scale\":[2,2,2],\"children\":[5]},"
    "{\"name\":\"F\",\"mesh\":1,\"translation\":[1,0,0]}]}";

static void write_sample_gltf(void)
{
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 2, 0};
    const uint32_t indices[3] = {0, 1, 2};
    unsigned char data[48];
    memcpy(data, positions, sizeof positions);
    memcpy(data + sizeof positions, indices, sizeof indices);
    write_file("sample.bin", data, sizeof data);
    write_text("sample.gltf", sample_gltf);
}

static void test_nodes(void **state)
{
    (void)state;
    static const float expected[5][12] = {{1, 0, 0, 10, 0, 1, 0, 20, 0, 0, 1, 30},
                                          {2, 0, 0, 10, 0, 3, 0, 20, 0, 0, 4, 30},
                                          {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                          {1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0},
                                          {2, 0, 0, 2, 0, 2, 0, 0, 0, 0, 2, 0}};
    static const uint32_t bottoms[5] = {0, 0, 1, 0, 1};
    struct memory memory;
    struct import import;
    write_sample_gltf();
    import_good("sample.gltf", &memory, &import);
    assert_int_equal(import.bottom_count, 2);
    assert_int_equal(import.bottoms[0].mesh_count, 1);
    assert_int_equal(import.bottoms[1].mesh_count, 2);
    assert_string_equal(import.bottoms[1].name, "C");
    assert_int_equal(import.instance_count, 5);
    for (int i = 0; i < 5; i++) {
        assert_int_equal(import.instances[i].bottom, bottoms[i]);
        assert_memory_equal(import.instances[i].transform, expected[i], sizeof expected[i]);
        assert_int_equal(import.instances[i].skipped, i == 3);
    }
    assert_int_equal(import.skipped_instances, 1);
    const struct import_mesh *mesh = &import.meshes[import.bottoms[0].meshes[0]];
    assert_string_equal(mesh->material, "green");
    assert_true(mesh->has_colour && mesh->colour[0] == 0.25f && mesh->colour[1] == 0.5f && mesh->colour[2] == 0.125f);
    assert_int_equal(import.file_count, 2);
    finish(&import, &memory);
}

static void test_oracle_meshes(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    struct oracle_mesh *meshes;
    uint32_t count;
    write_sample_gltf();
    import_good("sample.gltf", &memory, &import);
    assert_int_equal(import_oracle_meshes(&import, true, &meshes, &count, NULL), BVHD_OK);
    assert_int_equal(count, 6); /* one each for A and B, two each for C and F */
    static const uint32_t instances[6] = {0, 1, 2, 2, 4, 4}, geometries[6] = {0, 0, 0, 1, 0, 1};
    for (int i = 0; i < 6; i++) {
        assert_int_equal(meshes[i].instance, instances[i]);
        assert_int_equal(meshes[i].geometry, geometries[i]);
        assert_int_equal(meshes[i].primitive_count, 1);
        assert_ptr_equal(meshes[i].transform, import.instances[instances[i]].transform);
    }
    memory_free(&memory, meshes);
    assert_int_equal(import_oracle_meshes(&import, false, &meshes, &count, NULL), BVHD_OK);
    assert_int_equal(count, 1);
    assert_null(meshes[0].transform);
    assert_true(meshes[0].instance == RAY_NO_INSTANCE);
    memory_free(&memory, meshes);
    finish(&import, &memory);
}

/* There are more distinct lists of meshes than the hash table first has room for, and each is used twice. */
static void test_many_bottoms(void **state)
{
    (void)state;
    enum { BOTTOMS = 300 };
    FILE *file = fopen("many.gltf", "w");
    fputs("{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"buffers\":[{\"uri\":\"sample.bin\",\"byteLength\":48}],"
          "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,"
          "\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,2,0]}],\"meshes\":[",
          file);
    for (int i = 0; i < BOTTOMS; i++)
        fprintf(file, "%s{\"name\":\"mesh%d\",\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}", i ? "," : "", i);
    fputs("],\"nodes\":[", file);
    for (int i = 0; i < 2 * BOTTOMS; i++)
        fprintf(file, "%s{\"mesh\":%d}", i ? "," : "", i % BOTTOMS);
    fputs("],\"scenes\":[{\"nodes\":[0", file);
    for (int i = 1; i < 2 * BOTTOMS; i++)
        fprintf(file, ",%d", i);
    fputs("]}]}", file);
    fclose(file);
    write_sample_gltf();
    struct memory memory;
    struct import import;
    import_good("many.gltf", &memory, &import);
    assert_int_equal(import.bottom_count, BOTTOMS);
    assert_int_equal(import.instance_count, 2 * BOTTOMS);
    for (uint32_t i = 0; i < 2 * BOTTOMS; i++)
        assert_int_equal(import.instances[i].bottom, i % BOTTOMS);
    finish(&import, &memory);
}

static void expect_failure(const char *path, enum bvhd_status expected)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_scene(path, NULL, &memory, &import, &error), expected);
    assert_int_equal(error.status, expected);
    assert_string_equal(error.where, path);
    assert_int_equal(memory.live, 0);
}

static void test_failures(void **state)
{
    (void)state;
    expect_failure("missing.obj", BVHD_NOT_FOUND);
    write_text("garbage.obj.unknown", "???");
    expect_failure("garbage.obj.unknown", BVHD_UNSUPPORTED);
    write_text("cut.gltf", "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,");
    expect_failure("cut.gltf", BVHD_UNSUPPORTED);
    write_text("lines.obj", "v 0 0 0\nv 1 1 1\nl 1 2\n");
    expect_failure("lines.obj", BVHD_INVALID);
    expect_failure(".", BVHD_UNSUPPORTED);
}

/*
 * A truncated file, at which some versions of assimp abort: this process survives, and no memory is held.
 */
static void test_importer_crash(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    write_text("short.ply",
               "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
               "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n");
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = import_scene("short.ply", NULL, &memory, &import, NULL);
    assert_true(status == BVHD_UNSUPPORTED || status == BVHD_INVALID);
    assert_int_equal(memory.live, 0);
}

static void test_no_memory(void **state)
{
    (void)state;
    write_sample_gltf();
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status; after++) {
        struct memory memory;
        struct import import;
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = import_scene("sample.gltf", NULL, &memory, &import, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (!status)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 200);
    }
}

static void check_name(const char *path, const char *expected)
{
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    char *name = import_name(path, &memory);
    assert_string_equal(name, expected);
    memory_free(&memory, name);
}

static struct import_mesh *find_shape(const struct import *import, enum import_shape shape)
{
    for (uint32_t i = 0; i < import->mesh_count; i++)
        if (import->meshes[i].shape == shape && import->meshes[i].primitive_count)
            return &import->meshes[i];
    fail_msg("no mesh of shape %d", (int)shape);
    return NULL;
}

/* Points and lines of files that assimp reads, in this process and in one of its own. */
static void test_round(void **state)
{
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\nl 1 2 3 5\np 5\n";
    const struct import_wish wish = {.point_radius = 0.5f, .line_radius = 0.25f};
    (void)state;
    write_text("round.obj", text);
    for (int own_process = 0; own_process < 2; own_process++) {
        struct memory memory;
        struct import import;
        struct bvhd_error error = {0};
        memory_init(&memory, UINT64_MAX);
        enum bvhd_status status = own_process ? import_scene_as("round.obj", &wish, &memory, &import, &error)
                                              : import_read_as("round.obj", &wish, &memory, &import, &error);
        assert_int_equal(status, BVHD_OK);
        assert_false(import_counts_any(&import.counts));
        assert_int_equal(import.triangle_count, 1);
        assert_int_equal(import.point_count, 1);
        assert_int_equal(import.line_count, 3);
        assert_int_equal(import.bottom_count, 3);
        assert_int_equal(import.instance_count, 3);
        const struct import_mesh *points = find_shape(&import, IMPORT_POINTS),
                                 *lines = find_shape(&import, IMPORT_LINES);
        assert_true(points->positions[0] == 5 && points->radii[0] == 0.5f);
        assert_int_equal(lines->vertex_count, 4);
        assert_true(lines->positions[9] == 5 && lines->radii[3] == 0.25f);
        assert_int_equal(lines->caps[2], IMPORT_CAP_SECOND);
        import_finish(&import);
        assert_int_equal(memory.live, 0);
    }
}

static void test_round_no_memory(void **state)
{
    const struct import_wish wish = {.point_radius = 0.5f, .line_radius = 0.25f};
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    write_text("round.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nl 1 2 3\np 2\n");
    for (int after = 0; status == BVHD_NO_MEMORY; after++) {
        struct memory memory;
        struct import import;
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = import_read_as("round.obj", &wish, &memory, &import, NULL);
        if (status == BVHD_OK)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 1000);
    }
    assert_int_equal(status, BVHD_OK);
}

static void test_names(void **state)
{
    (void)state;
    check_name("/a/b.c/dragon.ply", "dragon");
    check_name("dragon", "dragon");
    check_name("a.b/dragon", "dragon");
    check_name("x/.hidden", ".hidden");
    check_name("two.dots.obj", "two.dots");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_faces),
        cmocka_unit_test(test_welded),
        cmocka_unit_test(test_nothing_is_dropped),
        cmocka_unit_test(test_nodes),
        cmocka_unit_test(test_oracle_meshes),
        cmocka_unit_test(test_many_bottoms),
        cmocka_unit_test(test_failures),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_round),
        cmocka_unit_test(test_round_no_memory),
        cmocka_unit_test(test_importer_crash),
        cmocka_unit_test(test_names),
    };
    return cmocka_run_group_tests_name("import", tests, scratch_enter, scratch_remove);
}

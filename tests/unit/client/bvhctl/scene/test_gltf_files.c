/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_files.c - tests what surrounds the geometry of glTF files: URIs, names, colours, chunks, other versions. */
#include "tests/support/unit.h"

#include <sys/stat.h>
#include <unistd.h>

#include "client/bvhctl/scene/gltf_uri.h"
#include "client/bvhctl/scene/import.h"
#include "tests/support/scene/gltf_case.h"
#include "tests/support/scratch.h"

static void write_file(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

/* Writes a text in which ' stands for ". */
static void write_json(const char *path, const char *text)
{
    char copy[8192];
    snprintf(copy, sizeof copy, "%s", text);
    for (char *at = copy; *at; at++)
        *at = *at == '\'' ? '"' : *at;
    write_file(path, copy, strlen(copy));
}

static const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 2, 0};

#define GEOMETRY                                                                                                       \
    "'nodes':[{'mesh':0}],'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"                                  \
    "'bufferViews':[{'buffer':0,'byteLength':36}],"                                                                    \
    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}]"
#define FILE_WITH(uri) "{'asset':{'version':'2.0'}," GEOMETRY ",'buffers':[{'byteLength':36,'uri':'" uri "'}]}"

static void read_good(const char *path, struct memory *memory, struct import *ret_import)
{
    struct bvhd_error error = {0};
    memory_init(memory, UINT64_MAX);
    if (import_scene(path, NULL, memory, ret_import, &error))
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

static void expect_triangle(const char *path, uint32_t files)
{
    struct memory memory;
    struct import import;
    read_good(path, &memory, &import);
    assert_int_equal(import.triangle_count, 1);
    assert_memory_equal(import.meshes[0].positions, triangle, sizeof triangle);
    assert_int_equal(import.file_count, files);
    finish(&import, &memory);
}

static void expect_error(const char *path, enum bvhd_status expected, const char *expected_text)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    char text[512];
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_scene(path, NULL, &memory, &import, &error), expected);
    snprintf(text, sizeof text, "%s: %s", error.where, error.text);
    if (!strstr(text, expected_text))
        fail_msg("'%s' does not say '%s'", text, expected_text);
    assert_int_equal(memory.live, 0);
}

static void test_files(void **state)
{
    (void)state;
    assert_int_equal(mkdir("sub", 0777), 0);
    write_file("a b%.bin", triangle, sizeof triangle);
    write_file("50%25.bin", triangle, sizeof triangle);
    write_file("sub/in.bin", triangle, sizeof triangle);
    write_json("spaces.gltf", FILE_WITH("a%20b%25.bin"));
    expect_triangle("spaces.gltf", 2);
    write_json("literal.gltf", FILE_WITH("50%25.bin"));
    expect_triangle("literal.gltf", 2);
    write_json("sub/up.gltf", FILE_WITH("../sub/in.bin"));
    expect_triangle("sub/up.gltf", 2);
    write_json("missing.gltf", FILE_WITH("none.bin"));
    expect_error("missing.gltf", BVHD_NOT_FOUND, "none.bin");
    write_json("remote.gltf", FILE_WITH("https://example.org/a.bin"));
    expect_error("remote.gltf", BVHD_UNSUPPORTED, "remote.gltf: buffers[0].uri: only files and data: URIs");
    write_file("short.bin", triangle, 20);
    write_json("short.gltf", FILE_WITH("short.bin"));
    expect_error("short.gltf", BVHD_INVALID, "short.gltf: buffers[0].byteLength: 36 bytes, but only 20 are there");
    write_json("number.gltf", "{'asset':{'version':'2.0'}," GEOMETRY ",'buffers':[{'byteLength':36,'uri':7}]}");
    expect_error("number.gltf", BVHD_INVALID, "buffers[0].uri: not a text");
}

#define BASE64 "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"

static void test_data_uris(void **state)
{
    (void)state;
    write_json("data.gltf", FILE_WITH("data:application/octet-stream;base64," BASE64));
    expect_triangle("data.gltf", 1);
    write_json("bare.gltf", FILE_WITH("data:;base64," BASE64));
    expect_triangle("bare.gltf", 1);
    write_json("wrong.gltf", FILE_WITH("data:;base64,????"));
    expect_error("wrong.gltf", BVHD_INVALID, "buffers[0].uri: not a data: URI");
    write_json("comma.gltf", FILE_WITH("data:nothing"));
    expect_error("comma.gltf", BVHD_INVALID, "buffers[0].uri: not a data: URI");
    write_json("few.gltf", FILE_WITH("data:;base64,AAAA"));
    expect_error("few.gltf", BVHD_INVALID, "buffers[0].byteLength: 36 bytes, but only 3 are there");
}

static void expect_bytes(const char *uri, const char *expected, size_t size)
{
    struct memory memory;
    unsigned char *data;
    uint64_t decoded;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(gltf_uri_decode(uri, &memory, &data, &decoded), BVHD_OK);
    assert_int_equal(decoded, size);
    assert_memory_equal(data, expected, size);
    memory_free(&memory, data);
}

static void test_decoding(void **state)
{
    (void)state;
    struct memory memory;
    unsigned char *data;
    uint64_t size;
    memory_init(&memory, UINT64_MAX);
    expect_bytes("data:;base64,", "", 0);
    expect_bytes("data:;base64,TQ==", "M", 1);
    expect_bytes("data:;base64,TWE=", "Ma", 2);
    expect_bytes("data:;base64,TWE", "Ma", 2);
    expect_bytes("data:;base64,TWFu", "Man", 3);
    expect_bytes("data:;base64,-_8", "\xfb\xff", 2);
    expect_bytes("data:,a%20b%2", "a b%2", 5);
    assert_int_equal(gltf_uri_decode("data:;base64,T", &memory, &data, &size), BVHD_INVALID);
    assert_int_equal(gltf_uri_decode("data:;base64,TQ==TQ", &memory, &data, &size), BVHD_INVALID);
    assert_int_equal(gltf_uri_kind("C:x.bin"), GLTF_URI_FILE);
    assert_int_equal(gltf_uri_kind("a/b:c.bin"), GLTF_URI_FILE);
    assert_int_equal(gltf_uri_kind("file:///x.bin"), GLTF_URI_REMOTE);
    assert_int_equal(memory.live, 0);
}

/* The writer of a GLB may pad the JSON with zeros, the BIN chunk may be longer, and other chunks may follow. */
static void test_chunks(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    static const char json[] = "{'asset':{'version':'2.0'}," GEOMETRY ",'buffers':[{'byteLength':36}]}";
    size_t size = gltf_case_pack(json, (const uint8_t *)triangle, sizeof triangle, bytes);
    write_file("good.glb", bytes, size);
    expect_triangle("good.glb", 1);
    write_file("no-name", bytes, size);
    expect_triangle("no-name", 1);
    memcpy(bytes + size, "\4\0\0\0MORE1234", 12);
    uint32_t length = (uint32_t)size + 12;
    memcpy(bytes + 8, &length, sizeof length);
    write_file("more.glb", bytes, length + 5);
    expect_triangle("more.glb", 1);
    struct memory memory;
    struct import import;
    read_good("more.glb", &memory, &import);
    assert_int_equal(import.counts.unknown_chunks, 1);
    assert_int_equal(import.counts.extra_bytes, 5);
    finish(&import, &memory);
    bytes[4] = 3;
    write_file("three.glb", bytes, length);
    expect_error("three.glb", BVHD_UNSUPPORTED, "three.glb: GLB: version 3");
    bytes[4] = 2;
    bytes[16] = 'X';
    write_file("first.glb", bytes, length);
    expect_error("first.glb", BVHD_UNSUPPORTED, "first.glb: GLB: the first chunk is not JSON");
    size = gltf_case_pack(json, NULL, 0, bytes);
    write_file("none.glb", bytes, size);
    expect_error("none.glb", BVHD_INVALID, "none.glb: buffers[0].uri: missing");
}

static void test_versions(void **state)
{
    (void)state;
    write_json("three.gltf", "{'asset':{'version':'3.0'}}");
    expect_error("three.gltf", BVHD_UNSUPPORTED, "three.gltf: asset.version: '3.0', but only 2.0");
    write_json("least.gltf", "{'asset':{'version':'2.1','minVersion':'2.1'}}");
    expect_error("least.gltf", BVHD_UNSUPPORTED, "least.gltf: asset.minVersion");
    write_json("none.gltf", "{'meshes':[]}");
    expect_error("none.gltf", BVHD_UNSUPPORTED, "none.gltf: asset.version: missing");
    write_json("list.gltf", "[]");
    expect_error("list.gltf", BVHD_UNSUPPORTED, "list.gltf: the JSON is not one object");
    write_json("after.gltf", "{'asset':{'version':'2.0'}} x");
    expect_error("after.gltf", BVHD_UNSUPPORTED, "after.gltf: the JSON is not one object");
    write_json("wrong.gltf", "{'asset':{'version':2.0.0}}");
    expect_error("wrong.gltf", BVHD_UNSUPPORTED, "wrong.gltf: no JSON from byte");
    write_json("empty.gltf", "");
    expect_error("empty.gltf", BVHD_UNSUPPORTED, "empty.gltf: the JSON is not complete");
    write_json("kind.gltf", "{'asset':{'version':'2.0'},'meshes':{}}");
    expect_error("kind.gltf", BVHD_INVALID, "kind.gltf: meshes: no array");
}

/* Text that ends anywhere is refused. */
static void test_truncated_text(void **state)
{
    (void)state;
    static const char json[] = FILE_WITH("data:;base64," BASE64);
    char cut[sizeof json];
    struct memory memory;
    struct import import;
    memory_init(&memory, UINT64_MAX);
    for (size_t length = 0; length + 1 < sizeof json; length++) {
        memcpy(cut, json, length);
        cut[length] = '\0';
        write_json("cut.gltf", cut);
        assert_int_equal(import_read("cut.gltf", NULL, &memory, &import, NULL), BVHD_UNSUPPORTED);
        assert_int_equal(memory.live, 0);
    }
}

static const char sample[] =
    "{'asset':{'version':'2.0'},'nodes':[{'mesh':0},{'mesh':1,'name':'second'},{'mesh':1,'name':'third'}],"
    "'materials':[{'name':'red','pbrMetallicRoughness':{'baseColorFactor':[1,0.5,0,1]}},{'name':'white'},{},"
    "{'pbrMetallicRoughness':{'baseColorFactor':[0,2,-1,1]},'extensions':{'KHR_materials_unlit':{}}},"
    "{'name':'old','extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[0.25,0.5,0.75,1]}}}],"
    "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]},{'name':'parts','primitives':["
    "{'attributes':{'POSITION':0},'material':1},{'attributes':{'POSITION':0},'material':2},"
    "{'attributes':{'POSITION':0},'material':3},{'attributes':{'POSITION':0},'material':4},"
    "{'attributes':{'POSITION':0}}]},{'name':'unused','primitives':[{'attributes':{'POSITION':99}}]}],"
    "'bufferViews':[{'buffer':0,'byteLength':36}],"
    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}],"
    "'buffers':[{'byteLength':36,'uri':'data:;base64," BASE64 "'}]}";

static void test_names_and_colours(void **state)
{
    (void)state;
    static const char *const names[6] = {"meshes[0]", "parts-0", "parts-1", "parts-2", "parts-3", "parts-4"};
    static const char *const materials[6] = {"red", "white", "", "", "old", ""};
    static const float colours[6][3] = {{1, 0.5f, 0}, {1, 1, 1}, {-1}, {0, 1, 0}, {0.25f, 0.5f, 0.75f}, {-1}};
    struct memory memory;
    struct import import;
    write_json("names.gltf", sample);
    read_good("names.gltf", &memory, &import);
    assert_int_equal(import.mesh_count, 6);
    for (int i = 0; i < 6; i++) {
        assert_string_equal(import.meshes[i].name, names[i]);
        assert_string_equal(import.meshes[i].material, materials[i]);
        assert_int_equal(import.meshes[i].has_colour, colours[i][0] >= 0);
        if (import.meshes[i].has_colour)
            assert_memory_equal(import.meshes[i].colour, colours[i], sizeof colours[i]);
    }
    assert_int_equal(import.bottom_count, 2);
    assert_string_equal(import.bottoms[0].name, "meshes[0]");
    assert_string_equal(import.bottoms[1].name, "second");
    assert_int_equal(import.instance_count, 3);
    assert_int_equal(import.counts.meshes, 1);
    finish(&import, &memory);
}

/* The quad of 82 bytes as Google's encoder writes it, which assimp decodes. */
static const char draco[] =
    "{'asset':{'version':'2.0'},'extensionsUsed':['KHR_draco_mesh_compression'],%s'nodes':[{'mesh':0}],"
    "'scene':0,'meshes':[{'primitives':[{'attributes':{'POSITION':0},'indices':1,'extensions':{"
    "'KHR_draco_mesh_compression':{'bufferView':0,'attributes':{'POSITION':0}}}}]}],"
    "'bufferViews':[{'buffer':0,'byteLength':82}],"
    "'accessors':[{'componentType':5126,'count':4,'type':'VEC3','min':[0,0,0],'max':[2,3,0]},"
    "{'componentType':5123,'count':6,'type':'SCALAR'}],"
    "'buffers':[{'byteLength':82,'uri':'data:application/octet-stream;base64,"
    "RFJBQ08CAgEBAAAABAIAAgAAAR//AREB/"
    "wAAAQAJAwAAAAAAAAAAAAAAAAAAAAAAAEAAAEBAAAAAAAAAAAAAAEBAAAAAAAAAAEAAAAAAAAAAAA=='}]}";

/* Files with Draco are left to assimp, which decodes them in Debian, or says that it does not. */
static void test_draco(void **state)
{
    (void)state;
    char text[4096];
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    snprintf(text, sizeof text, draco, "'scenes':[{'nodes':[0]},{'nodes':[0]}],");
    write_json("draco.gltf", text);
    enum bvhd_status status = import_scene("draco.gltf", NULL, &memory, &import, &error);
    if (!status) {
        assert_int_equal(import.triangle_count, 2);
        assert_int_equal(import.meshes[0].vertex_count, 4);
        assert_int_equal(import.counts.scenes, 1);
        import_finish(&import);
    } else {
        assert_int_equal(status, BVHD_UNSUPPORTED);
        assert_non_null(strstr(error.text, "raco"));
    }
    assert_int_equal(import_scene("draco.gltf", "0", &memory, &import, &error), BVHD_UNSUPPORTED);
    assert_non_null(strstr(error.text, "Draco"));
    assert_int_equal(memory.live, 0);
}

/* Choosing a scene is for glTF; other files have nothing to choose from. */
static void test_scene_of_others(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    write_json("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_int_equal(import_scene("one.obj", "0", &memory, &import, &error), BVHD_NOT_FOUND);
    assert_non_null(strstr(error.text, "no scene '0'"));
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_files),           cmocka_unit_test(test_data_uris),
        cmocka_unit_test(test_decoding),        cmocka_unit_test(test_chunks),
        cmocka_unit_test(test_versions),        cmocka_unit_test(test_names_and_colours),
        cmocka_unit_test(test_truncated_text),  cmocka_unit_test(test_draco),
        cmocka_unit_test(test_scene_of_others),
    };
    return cmocka_run_group_tests_name("gltf_files", tests, scratch_enter, scratch_remove);
}

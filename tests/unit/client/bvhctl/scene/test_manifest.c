/* SPDX-License-Identifier: Apache-2.0 */
/* test_manifest.c - tests that manifest.json is written and read, and that hostile ones are refused. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/manifest_internal.h"
#include "tests/support/scratch.h"

static enum bvhd_status read_text(const char *text, struct memory *memory, struct manifest *ret_manifest,
                                  struct bvhd_error *error)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", scratch_folder, MANIFEST_NAME);
    memory_init(memory, UINT64_MAX);
    assert_int_equal(files_write(path, (struct bytes){(const unsigned char *)text, strlen(text)}, memory, NULL, NULL),
                     BVHD_OK);
    return manifest_read(scratch_folder, memory, ret_manifest, error);
}

static const char good[] = "{\"schema\":1,\"structures\":["
                           "{\"file\":\"s.blas-0.as\",\"type\":\"blas\",\"scene\":\"s\",\"name\":\"m\",\"target\":"
                           "\"portable\",\"geometries\":[{\"color\":[0."
                           "5,"
                           "0,1]},{},{\"color\":[2,0,0]}]},"
                           "{\"file\":\"s.tlas.as\",\"type\":\"tlas\",\"scene\":\"s\",\"name\":\"s\",\"target\":"
                           "\"lavapipe\",\"geometries\":[],\"handles\":["
                           "\"s.blas-0.as\"],\"new\":1}]}";

static void test_read(void **state)
{
    (void)state;
    struct memory memory;
    struct manifest manifest;
    assert_int_equal(read_text(good, &memory, &manifest, NULL), BVHD_OK);
    assert_int_equal(manifest.count, 2);
    const struct manifest_entry *blas = &manifest.entries[0], *tlas = &manifest.entries[1];
    assert_string_equal(blas->file, "s.blas-0.as");
    assert_string_equal(blas->name, "m");
    assert_false(blas->is_top);
    assert_int_equal(blas->target, TARGET_PORTABLE);
    assert_int_equal(tlas->target, TARGET_LAVAPIPE);
    assert_int_equal(blas->colour_count, 3);
    assert_true(blas->colours[0].rgb[0] == 0.5f && blas->colours[0].rgb[2] == 1.0f);
    assert_true(blas->colours[1].rgb[0] < 0 && blas->colours[2].rgb[0] < 0);
    assert_true(tlas->is_top);
    assert_int_equal(tlas->handle_count, 1);
    assert_string_equal(tlas->handles[0], "s.blas-0.as");
    manifest_finish(&manifest);
    manifest_finish(&manifest);
    assert_int_equal(memory.live, 0);
}

static void expect_corrupt(const char *text, const char *place)
{
    struct memory memory;
    struct manifest manifest;
    struct bvhd_error error = {0};
    assert_int_equal(read_text(text, &memory, &manifest, &error), BVHD_CORRUPT);
    if (!strstr(error.where, place))
        fail_msg("'%s' is not in '%s'", place, error.where);
    assert_int_equal(memory.live, 0);
}

#define ENTRY(file, type, more)                                                                                        \
    "{\"schema\":1,\"structures\":[{\"file\":" file ",\"type\":" type                                                  \
    ",\"scene\":\"s\",\"name\":\"n\",\"target\":\"portable\",\"geometries\":[]" more "}]}"

#define NO_TARGET(more)                                                                                                \
    "{\"schema\":1,\"structures\":[{\"file\":\"a\",\"type\":\"blas\",\"scene\":\"s\",\"name\":\"n\",\"geometries\":["  \
    "]" more "}]}"

static void test_hostile(void **state)
{
    (void)state;
    expect_corrupt("", "manifest.json");
    expect_corrupt("not json", "manifest.json");
    expect_corrupt("[]", "manifest.json");
    expect_corrupt("{\"schema\":2,\"structures\":[]}", "manifest.json");
    expect_corrupt("{\"schema\":1}", "manifest.json");
    expect_corrupt("{\"schema\":1,\"structures\":[7]}", "structures[0].file");
    expect_corrupt(ENTRY("\"../../etc/passwd\"", "\"blas\"", ""), "structures[0].file");
    expect_corrupt(ENTRY("\"/x\"", "\"blas\"", ""), "structures[0].file");
    expect_corrupt(ENTRY("\"..\"", "\"blas\"", ""), "structures[0].file");
    expect_corrupt(ENTRY("\"\"", "\"blas\"", ""), "structures[0].file");
    expect_corrupt(ENTRY("1", "\"blas\"", ""), "structures[0].file");
    expect_corrupt(ENTRY("\"a\"", "\"slab\"", ""), "structures[0].type");
    expect_corrupt(NO_TARGET(""), "structures[0].target");
    expect_corrupt(NO_TARGET(",\"target\":1"), "structures[0].target");
    expect_corrupt(NO_TARGET(",\"target\":\"teapot\""), "structures[0].target");
    expect_corrupt(ENTRY("\"a\"", "null", ""), "structures[0].type");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_scene\":7"), "structures[0].source_scene");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_scene\":{\"number\":-1,\"name\":\"\"}"),
                   "structures[0].source_scene");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_scene\":{\"number\":1}"),
                   "structures[0].source_scene");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_scene\":{\"number\":5e9,\"name\":\"\"}"),
                   "structures[0].source_scene");
    static const char *const moments[] = {"7",
                                          "{\"time\":1}",
                                          "{\"time\":1,\"animation\":-1}",
                                          "{\"time\":1,\"animation\":5e9}",
                                          "{\"time\":\"1\",\"animation\":0}",
                                          "{\"animation\":null}",
                                          "{\"time\":1e999,\"animation\":null}",
                                          "{\"time\":1,\"end\":1,\"animation\":0}",
                                          "{\"time\":1,\"end\":\"2\",\"animation\":0}",
                                          "{\"time\":1,\"end\":1e999,\"animation\":0}"};
    for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
        char text[512];
        snprintf(text, sizeof text, ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_moment\":%s"), moments[i]);
        expect_corrupt(text, "structures[0].source_moment");
    }
    static const char *const radii[] = {"{\"points\":\"1\"}", "{\"lines\":0}", "{\"points\":1,\"lines\":-1}",
                                        "{\"points\":1e300}", "{\"lines\":1e-300}"};
    for (size_t i = 0; i < sizeof radii / sizeof *radii; i++) {
        char text[512];
        snprintf(text, sizeof text, ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_radii\":%s"), radii[i]);
        expect_corrupt(text, "structures[0].source_radii");
    }
    expect_corrupt(ENTRY("\".\"", "\"blas\"", ""), "structures[0].file");
    expect_corrupt("{\"schema\":1,\"structures\":[{\"file\":\"a\",\"type\":\"blas\",\"scene\":\"s\",\"name\":\"n\","
                   "\"target\":\"portable\",\"geometries\":7}]}",
                   "structures[0].geometries");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ""), "structures[0].handles");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[3]"), "structures[0].handles");
    expect_corrupt(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[\"b\",\"../c\"]"), "structures[0].handles");
}

/* Wishes are what a scene was read by: a scene by its number, a moment, an animation by its number, or none of them. */
static void test_wish(void **state)
{
    (void)state;
    struct memory memory;
    struct manifest manifest;
    struct manifest_wish wish;
    assert_int_equal(read_text(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[]"), &memory, &manifest, NULL), BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_true(!wish.wish.scene && !wish.wish.moment && !wish.wish.wants_looks);
    manifest_finish(&manifest);
    assert_int_equal(
        read_text(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_moment\":{\"time\":-0.1,\"animation\":null}"),
                  &memory, &manifest, NULL),
        BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_true(wish.wish.moment && wish.wish.moment->time == -0.1 && !wish.wish.moment->animation);
    assert_false(wish.wish.moment->is_shutter);
    manifest_finish(&manifest);
    assert_int_equal(read_text(ENTRY("\"a\"", "\"tlas\"",
                                     ",\"handles\":[],\"source_moment\":{\"time\":1,\"end\":1.5,\"animation\":0}"),
                               &memory, &manifest, NULL),
                     BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_true(wish.wish.moment && wish.wish.moment->is_shutter && wish.wish.moment->end == 1.5);
    assert_false(wish.wish.moment->is_for_updates);
    manifest_finish(&manifest);
    assert_int_equal(
        read_text("{\"schema\":1,\"options\":{\"target\":\"portable\",\"flags\":[\"allow-update\"]},\"structures\":[{"
                  "\"file\":\"a\",\"type\":\"tlas\",\"scene\":\"s\",\"name\":\"n\",\"target\":\"portable\","
                  "\"geometries\":[],\"handles\":[],\"source_moment\":{\"time\":1,\"end\":2,\"animation\":0}}]}",
                  &memory, &manifest, NULL),
        BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_true(wish.wish.moment->is_for_updates);
    manifest_finish(&manifest);
    assert_int_equal(read_text(ENTRY("\"a\"", "\"tlas\"",
                                     ",\"handles\":[],\"source_scene\":{\"number\":4,\"name\":\"night\"},"
                                     "\"source_moment\":{\"time\":2,\"animation\":7}"),
                               &memory, &manifest, NULL),
                     BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_string_equal(wish.wish.scene, "4");
    assert_true(wish.wish.moment && wish.wish.moment->time == 2);
    assert_string_equal(wish.wish.moment->animation, "7");
    assert_true(wish.wish.point_radius == 0 && wish.wish.line_radius == 0);
    manifest_finish(&manifest);
    assert_int_equal(
        read_text(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_radii\":{\"points\":0.5,\"lines\":0.25}"),
                  &memory, &manifest, NULL),
        BVHD_OK);
    manifest_wish_init(&wish, &manifest.entries[0]);
    assert_true(wish.wish.point_radius == 0.5f && wish.wish.line_radius == 0.25f);
    manifest_finish(&manifest);
}

#define NODES(nodes) "{\"schema\":1,\"structures\":[7,{\"file\":\"b\"},{\"file\":\"a\",\"nodes\":" nodes "}]}"

/* The nodes of a top level are read with their files, or refused, and each allocation may fail. */
static void test_nodes(void **state)
{
    (void)state;
    static const char *const broken[] = {NODES("7"), NODES("[7]"), NODES("[{\"file\":7}]"), "{\"schema\":1}", "{", ""};
    static const char right[] = NODES("[{\"file\":\"x.as\"},{\"name\":\"n\",\"file\":\"y.as\"}]");
    struct memory memory;
    struct manifest ignored;
    struct manifest_nodes nodes;
    struct bvhd_error error;
    char file[128];
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        if (read_text(broken[i], &memory, &ignored, &error) == BVHD_OK)
            manifest_finish(&ignored);
        assert_int_equal(manifest_read_nodes(scratch_folder, "a", &memory, &nodes, &error), BVHD_CORRUPT);
        assert_true(*error.where && *error.text);
        assert_int_equal(memory.live, 0);
    }
    assert_int_not_equal(read_text(right, &memory, &ignored, &error), BVHD_OK);
    assert_int_equal(manifest_read_nodes(scratch_folder, "c", &memory, &nodes, &error), BVHD_CORRUPT);
    assert_int_equal(manifest_read_nodes("/nonexistent", "a", &memory, &nodes, &error), BVHD_NOT_FOUND);
    assert_int_equal(manifest_read_nodes("/dev/null", "a", &memory, &nodes, &error), BVHD_IO);
    snprintf(file, sizeof file, "%s/%s", scratch_folder, MANIFEST_NAME);
    assert_int_equal(manifest_read_nodes(file, "a", &memory, &nodes, &error), BVHD_IO);
    assert_string_equal(error.text, "neither a directory nor a container of structures");
    assert_int_equal(memory.live, 0);
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        atomic_store(&memory.fail_after, after);
        status = manifest_read_nodes(scratch_folder, "a", &memory, &nodes, &error);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && memory.live == 0));
        assert_true(after < 50);
    }
    assert_int_equal(nodes.count, 2);
    assert_string_equal(nodes.files[0], "x.as");
    assert_string_equal(nodes.files[1], "y.as");
    manifest_nodes_finish(&nodes);
    manifest_nodes_finish(&nodes);
    manifest_nodes_finish(NULL);
    assert_int_equal(memory.live, 0);
}

#define OPTIONS(text) "{\"schema\":1,\"options\":" text ",\"structures\":[]}"
#define KNOWN(members) OPTIONS("{\"target\":\"portable\"," members "}")
#define LISTS(flags) "\"flags\":" flags ",\"layout\":[],\"geometry_flags\":[\"opaque\"]"

/* Options are known if the manifest has them, and this version knows each name. */
static void test_options(void **state)
{
    (void)state;
    static const char *const unknown[] = {
        "{\"schema\":1,\"structures\":[]}",
        OPTIONS("7"),
        OPTIONS("{}"),
        OPTIONS("{" LISTS("[]") "}"),
        KNOWN(LISTS("[\"allow-flight\"]")),
        KNOWN(LISTS("7")),
        KNOWN(LISTS("[7]")),
        KNOWN(LISTS("[]") ",\"quality\":\"best\""),
        KNOWN(LISTS("[]") ",\"builder\":7"),
        OPTIONS("{\"target\":\"teapot\"," LISTS("[]") "}"),
    };
    struct memory memory;
    struct manifest manifest;
    for (size_t i = 0; i < sizeof unknown / sizeof *unknown; i++) {
        assert_int_equal(read_text(unknown[i], &memory, &manifest, NULL), BVHD_OK);
        assert_false(manifest.options.are_known);
        manifest_finish(&manifest);
    }
    assert_int_equal(
        read_text(KNOWN(LISTS("[\"allow-update\",\"low-memory\"]") ",\"quality\":\"high\",\"builder\":"
                                                                   "\"embree\",\"rays_per_primitive\":2.5"),
                  &memory, &manifest, NULL),
        BVHD_OK);
    assert_true(manifest.options.are_known);
    assert_int_equal(manifest.options.build_flags, BUILD_ALLOW_UPDATE | BUILD_LOW_MEMORY);
    assert_int_equal(manifest.options.geometry_flags, GEOMETRY_OPAQUE);
    assert_int_equal(manifest.options.build.target, TARGET_PORTABLE);
    assert_int_equal(manifest.options.build.quality, QUALITY_HIGH);
    assert_int_equal(manifest.options.build.builder, BUILDER_EMBREE);
    assert_true(manifest.options.rays == 2.5);
    manifest_finish(&manifest);
    static const char *const no_rays[] = {"null", "\"2\"", "0", "-2.5", "1e999"};
    for (size_t i = 0; i < sizeof no_rays / sizeof *no_rays; i++) {
        char text[256];
        snprintf(text, sizeof text, KNOWN(LISTS("[]") ",\"quality\":null,\"rays_per_primitive\":%s"), no_rays[i]);
        assert_int_equal(read_text(text, &memory, &manifest, NULL), BVHD_OK);
        assert_true(manifest.options.are_known && manifest.options.rays == 0);
        assert_int_equal(manifest.options.build.quality, QUALITY_UNSPECIFIED);
        manifest_finish(&manifest);
    }
}

/* A top level is found by its scene's name, and by the name and the number of the scene in its file. */
static void test_find_top(void **state)
{
    (void)state;
    struct memory memory;
    struct manifest manifest;
    assert_int_equal(
        read_text(ENTRY("\"a\"", "\"tlas\"", ",\"handles\":[],\"source_scene\":{\"number\":3,\"name\":\"night\"}"),
                  &memory, &manifest, NULL),
        BVHD_OK);
    const struct manifest_entry *top = &manifest.entries[0];
    assert_true(top->has_source);
    assert_int_equal(top->source_number, 3);
    assert_ptr_equal(manifest_find_top(&manifest, NULL, "s"), top);
    assert_ptr_equal(manifest_find_top(&manifest, NULL, "night"), top);
    assert_ptr_equal(manifest_find_top(&manifest, NULL, "3"), top);
    assert_null(manifest_find_top(&manifest, NULL, "day"));
    assert_null(manifest_find_top(&manifest, NULL, "1"));
    manifest_finish(&manifest);
    assert_int_equal(memory.live, 0);
}

/*
 * Some manifests have sizes, the files of scenes, or scenes without a name. Values that are not possible are left out.
 */
static void test_optional_members(void **state)
{
    (void)state;
#define FILES(file, path) "{\"file\":" file ",\"files\":[{\"path\":" path "}]}"
    static const char text[] =
        "{\"schema\":1,\"structures\":["
        "{\"file\":\"a\",\"type\":\"tlas\",\"scene\":\"s\",\"name\":\"n\",\"target\":\"portable\",\"geometries\":[],"
        "\"handles\":[],\"bytes\":12,\"source_scene\":{\"number\":3,\"name\":\"\"}},"
        "{\"file\":\"b\",\"type\":\"blas\",\"scene\":\"s\",\"name\":\"n\",\"target\":\"portable\",\"bytes\":-1,"
        "\"geometries\":[{\"color\":[\"a\",0,0]},{\"color\":[-1,0,0]},{\"color\":7}]},"
        "{\"file\":\"c\",\"type\":\"blas\",\"scene\":\"s\",\"name\":\"n\",\"target\":\"portable\",\"bytes\":1e16,"
        "\"geometries\":[],\"source_scene\":{\"number\":4,\"name\":\"dusk\"}}],"
        "\"scenes\":[" FILES("7", "\"x.gltf\"") "," FILES("\"a\"", "7") "," FILES("\"a\"", "\"../x.gltf\"") "," FILES(
            "\"a\"", "\"x.gltf\"") "," FILES("\"a\"", "\"y.gltf\"") "]}";
    struct memory memory;
    struct manifest manifest;
    struct bvhd_error error = {0};
    if (read_text(text, &memory, &manifest, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_int_equal(manifest.count, 3);
    assert_string_equal(manifest.entries[0].source_file, "x.gltf");
    assert_null(manifest.entries[0].source_name);
    assert_null(manifest.entries[1].source_file);
    assert_string_equal(manifest.entries[2].source_name, "dusk");
    for (int i = 0; i < 3; i++)
        assert_true(manifest.entries[1].colours[i].rgb[0] < 0);
    assert_ptr_equal(manifest_find_top(&manifest, NULL, "3"), &manifest.entries[0]);
    assert_null(manifest_find_top(&manifest, NULL, "night"));
    manifest_finish(&manifest);
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        atomic_store(&memory.fail_after, after);
        status = manifest_read(scratch_folder, &memory, &manifest, NULL);
        assert_true((status == BVHD_OK || status == BVHD_NO_MEMORY) && after < 100);
        if (status == BVHD_OK)
            manifest_finish(&manifest);
        assert_int_equal(memory.live, 0);
    }
    manifest_finish(NULL);
}

/* Several files may have a scene of that name: the name of the file decides, and without it there is no answer. */
static void test_find_top_of_file(void **state)
{
    (void)state;
#define TOP(scene, file)                                                                                               \
    "{\"file\":\"" file "\",\"type\":\"tlas\",\"scene\":\"" scene "\",\"name\":\"n\",\"target\":\"portable\","         \
    "\"handles\":[],\"geometries\":[],\"source_scene\":{\"number\":1,\"name\":\"night\"}}"
    struct memory memory;
    struct manifest manifest;
    struct bvhd_error error = {0};
    if (read_text("{\"schema\":1,\"structures\":[" TOP("a", "f") "," TOP("b", "g") "]}", &memory, &manifest, &error))
        fail_msg("%s: %s", error.where, error.text);
    assert_ptr_equal(manifest_find_top(&manifest, "b", "night"), &manifest.entries[1]);
    assert_ptr_equal(manifest_find_top(&manifest, "a", "1"), &manifest.entries[0]);
    assert_ptr_equal(manifest_find_top(&manifest, "c", "b"), &manifest.entries[1]);
    assert_null(manifest_find_top(&manifest, "c", "night"));
    assert_null(manifest_find_top(&manifest, NULL, "night"));
    manifest_finish(&manifest);
    assert_int_equal(memory.live, 0);
}

/* Nesting that is deep enough to overflow the stack of a recursive parser is refused. */
static void test_deep_nesting(void **state)
{
    (void)state;
    enum { DEPTH = 200000 };
    char *text = malloc(DEPTH + 1);
    memset(text, '[', DEPTH);
    text[DEPTH] = '\0';
    expect_corrupt(text, "manifest.json");
    free(text);
}

static void test_every_cut(void **state)
{
    (void)state;
    char text[sizeof good];
    for (size_t size = 0; size < sizeof good - 1; size++) {
        struct memory memory;
        struct manifest manifest;
        memcpy(text, good, size);
        text[size] = '\0';
        assert_int_equal(read_text(text, &memory, &manifest, NULL), BVHD_CORRUPT);
        assert_int_equal(memory.live, 0);
    }
}

static void test_missing_and_memory(void **state)
{
    (void)state;
    struct memory memory;
    struct manifest manifest;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(manifest_read("/nowhere/at/all", &memory, &manifest, NULL), BVHD_NOT_FOUND);
    assert_int_equal(read_text(good, &memory, &manifest, NULL), BVHD_OK);
    manifest_finish(&manifest);
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        atomic_store(&memory.fail_after, after);
        status = manifest_read(scratch_folder, &memory, &manifest, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (status == BVHD_OK)
            manifest_finish(&manifest);
        assert_int_equal(memory.live, 0);
        assert_true(after < 100);
    }
}

/* Nodes of the same key in other places of a manifest, and texts that look like them, stay. */
static void test_nodes_are_dropped(void **state)
{
    (void)state;
    static const char *const texts[][2] = {
        {"{\"s\":[{\"nodes\":[{\"name\":\"]\\\"\"},[]],\"a\":1}]}", "{\"s\":[{\"nodes\":[],\"a\":1}]}"},
        {"{\"s\":[{\"nodes\" : [1] },{\"nodes\":[2]}]}", "{\"s\":[{\"nodes\" : [] },{\"nodes\":[]}]}"},
        {"{\"nodes\":[1],\"s\":[{\"n\":{\"nodes\":[2]}}]}", "{\"nodes\":[1],\"s\":[{\"n\":{\"nodes\":[2]}}]}"},
        {"{\"s\":[{\"a\":\"nodes\",\"nodes\":7}]}", "{\"s\":[{\"a\":\"nodes\",\"nodes\":7}]}"},
        {"{\"s\":[{\"nodes\":[1,2", "{\"s\":[{\"nodes\":[]"},
        {"{\"s\":[{\"nodes", "{\"s\":[{\"nodes"},
        {"{\"s\":[{\"nodes\"", "{\"s\":[{\"nodes\""},
        {"{\"s\":[{\"nodes\":", "{\"s\":[{\"nodes\":"},
        {"\"\\", "\"\\"},
        {"]]]]", "]]]]"},
        {"", ""},
    };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        uint64_t size = strlen(texts[i][0]);
        char *text = malloc(size ? size : 1); /* without a zero byte behind it */
        assert_non_null(text);
        memcpy(text, texts[i][0], size);
        uint64_t left = manifest_drop_nodes(text, size);
        assert_int_equal(left, strlen(texts[i][1]));
        assert_memory_equal(text, texts[i][1], left);
        free(text);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_read),
        cmocka_unit_test(test_hostile),
        cmocka_unit_test(test_wish),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_nodes),
        cmocka_unit_test(test_find_top),
        cmocka_unit_test(test_optional_members),
        cmocka_unit_test(test_find_top_of_file),
        cmocka_unit_test(test_deep_nesting),
        cmocka_unit_test(test_every_cut),
        cmocka_unit_test(test_missing_and_memory),
        cmocka_unit_test(test_nodes_are_dropped),
    };
    return cmocka_run_group_tests_name("manifest", tests, scratch_make, scratch_remove);
}

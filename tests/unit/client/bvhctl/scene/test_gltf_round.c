/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_round.c - tests points and lines of glTF files: their modes, radii, looks, and what is refused. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/gltf_round.h"
#include "client/bvhctl/scene/import.h"
#include "tests/support/scene/gltf_case.h"
#include "tests/support/scratch.h"

enum { ROOM = 8 };

static void places(void **state)
{
    static const struct {
        enum gltf_mode mode;
        uint32_t corners, count, indices[ROOM];
    } cases[] = {
        {GLTF_POINTS, 3, 3, {5, 6, 7}},       {GLTF_POINTS, 0, 0, {0}},     {GLTF_LINES, 4, 2, {5, 6, 7, 8}},
        {GLTF_LINES, 3, 1, {5, 6}},           {GLTF_LINES, 1, 0, {0}},      {GLTF_LINE_STRIP, 3, 2, {5, 6, 6, 7}},
        {GLTF_LINE_STRIP, 1, 0, {0}},         {GLTF_LINE_STRIP, 0, 0, {0}}, {GLTF_LINE_LOOP, 3, 3, {5, 6, 6, 7, 7, 5}},
        {GLTF_LINE_LOOP, 2, 2, {5, 6, 6, 5}}, {GLTF_LINE_LOOP, 1, 0, {0}},
    };
    static const uint32_t corners[] = {5, 6, 7, 8};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint32_t indices[ROOM] = {0}, plain[ROOM] = {0}, ends = cases[i].mode == GLTF_POINTS ? 1 : 2;
        assert_int_equal(gltf_round_count(cases[i].mode, cases[i].corners), cases[i].count);
        gltf_round_place(cases[i].mode, corners, cases[i].corners, indices);
        gltf_round_place(cases[i].mode, NULL, cases[i].corners, plain);
        assert_memory_equal(indices, cases[i].indices, sizeof indices);
        for (uint32_t k = 0; k < ends * cases[i].count; k++)
            assert_int_equal(plain[k] + 5, indices[k]);
    }
}

/*
 * The bytes of the files: four positions (accessor 0), radii 1 to 4 (1), widths (2), radii as bytes that are normalized
 * (3), indices (4), one negative radius (5), one that is NaN (6), three radii (7), colours (8), an infinite one (9),
 * three indices (10), one index (11), radii as integers of 32 bits (12), radii of which a sparse one is beyond (13).
 */
struct bin {
    float positions[4][3], radii[4], widths[4], negative[4], nan[4], infinite[4], colours[4][4];
    uint16_t indices[4];
    uint8_t bytes[4];
};

static size_t write_file(const char *primitives, const char *nodes)
{
    static uint8_t bytes[GLTF_CASE_ROOM];
    char json[4096];
    struct bin bin = {.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}},
                      .radii = {1, 2, 3, 4},
                      .widths = {4, 3, 2, 1},
                      .negative = {1, 1, -0.5f, 1},
                      .nan = {1, NAN, 1, 1},
                      .infinite = {INFINITY, 1, 1, 1},
                      .indices = {3, 1, 1, 2},
                      .bytes = {0, 51, 102, 255}};
    for (int i = 0; i < 4; i++)
        bin.colours[i][i % 3] = bin.colours[i][3] = 1;
    const struct {
        size_t offset, size;
        const char *rest;
    } arrays[] = {
        {offsetof(struct bin, positions), sizeof bin.positions, "'componentType':5126,'count':4,'type':'VEC3'"},
        {offsetof(struct bin, radii), sizeof bin.radii, "'componentType':5126,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, widths), sizeof bin.widths, "'componentType':5126,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, bytes), 4, "'componentType':5121,'normalized':true,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, indices), 8, "'componentType':5123,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, negative), sizeof bin.negative, "'componentType':5126,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, nan), sizeof bin.nan, "'componentType':5126,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, radii), 12, "'componentType':5126,'count':3,'type':'SCALAR'"},
        {offsetof(struct bin, colours), sizeof bin.colours, "'componentType':5126,'count':4,'type':'VEC4'"},
        {offsetof(struct bin, infinite), sizeof bin.infinite, "'componentType':5126,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, indices), 8, "'componentType':5123,'count':3,'type':'SCALAR'"},
        {offsetof(struct bin, indices), 8, "'componentType':5123,'count':1,'type':'SCALAR'"},
        {offsetof(struct bin, radii), 16, "'componentType':5125,'count':4,'type':'SCALAR'"},
        {offsetof(struct bin, radii), 16,
         "'componentType':5126,'count':4,'type':'SCALAR','sparse':{'count':2,'indices':{'bufferView':3,"
         "'componentType':5121},'values':{'bufferView':1}}"},
    };
    size_t used = (size_t)snprintf(json, sizeof json,
                                   "{'asset':{'version':'2.0'},'scenes':[{'nodes':[0]}],'nodes':[%s],"
                                   "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}],"
                                   "'meshes':[{'name':'m','primitives':[%s]}],'buffers':[{'byteLength':%zu}],"
                                   "'bufferViews':[",
                                   nodes, primitives, sizeof bin);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        used += (size_t)snprintf(json + used, sizeof json - used, "%s{'buffer':0,'byteOffset':%zu,'byteLength':%zu}",
                                 i ? "," : "", arrays[i].offset, arrays[i].size);
    used += (size_t)snprintf(json + used, sizeof json - used, "],'accessors':[");
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        used += (size_t)snprintf(json + used, sizeof json - used, "%s{'bufferView':%zu,%s}", i ? "," : "", i,
                                 arrays[i].rest);
    snprintf(json + used, sizeof json - used, "]}");
    size_t size = gltf_case_pack(json, (const uint8_t *)&bin, sizeof bin, bytes);
    FILE *file = fopen("case.glb", "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    fclose(file);
    return size;
}

static const struct import_wish both = {.point_radius = 0.5f, .line_radius = 0.25f, .wants_looks = true};

static void read_file(const char *primitives, const struct import_wish *wish, struct memory *memory,
                      struct import *ret_import)
{
    struct bvhd_error error = {0};
    write_file(primitives, "{'mesh':0}");
    memory_init(memory, UINT64_MAX);
    if (import_read_as("case.glb", wish, memory, ret_import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

#define ALL "'attributes':{'POSITION':0,'_RADIUS':1}"

static void radii_are_read(void **state)
{
    static const struct {
        const char *primitive;
        enum import_shape shape;
        uint32_t primitives, vertices;
        float x[ROOM], radii[ROOM];
    } cases[] = {
        {"{'attributes':{'POSITION':0},'mode':0}", IMPORT_POINTS, 4, 4, {0, 1, 2, 3}, {0.5f, 0.5f, 0.5f, 0.5f}},
        {"{" ALL ",'mode':0}", IMPORT_POINTS, 4, 4, {0, 1, 2, 3}, {1, 2, 3, 4}},
        {"{" ALL ",'mode':0,'indices':4}", IMPORT_POINTS, 4, 4, {3, 1, 1, 2}, {4, 2, 2, 3}},
        {"{'attributes':{'POSITION':0,'_WIDTH':2},'mode':0}", IMPORT_POINTS, 4, 4, {0, 1, 2, 3}, {2, 1.5f, 1, 0.5f}},
        {"{'attributes':{'POSITION':0,'_WIDTH':2,'_RADIUS':1},'mode':0}",
         IMPORT_POINTS,
         4,
         4,
         {0, 1, 2, 3},
         {1, 2, 3, 4}},
        {"{'attributes':{'POSITION':0,'_RADIUS':3},'mode':0}", IMPORT_POINTS, 4, 4, {0, 1, 2, 3}, {0, 0.2f, 0.4f, 1}},
        {"{'attributes':{'POSITION':0},'mode':3}", IMPORT_LINES, 3, 4, {0, 1, 2, 3}, {0.25f, 0.25f, 0.25f, 0.25f}},
        {"{" ALL ",'mode':3}", IMPORT_LINES, 3, 4, {0, 1, 2, 3}, {1, 2, 3, 4}},
        {"{" ALL ",'mode':2}", IMPORT_LINES, 4, 5, {0, 1, 2, 3, 0}, {1, 2, 3, 4, 1}},
        {"{" ALL ",'mode':1}", IMPORT_LINES, 2, 4, {0, 1, 2, 3}, {1, 2, 3, 4}},
        {"{" ALL ",'mode':1,'indices':4}", IMPORT_LINES, 2, 3, {3, 1, 2}, {4, 2, 3}},
    };
    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct memory memory;
        struct import import;
        read_file(cases[c].primitive, &both, &memory, &import);
        const struct import_mesh *mesh = &import.meshes[0];
        assert_int_equal(mesh->shape, cases[c].shape);
        assert_int_equal(mesh->primitive_count, cases[c].primitives);
        assert_int_equal(mesh->vertex_count, cases[c].vertices);
        assert_int_equal(import.point_count + import.line_count, cases[c].primitives);
        assert_int_equal(import.triangle_count, 0);
        assert_false(import_counts_any(&import.counts));
        for (uint32_t i = 0; i < mesh->vertex_count; i++)
            if (mesh->positions[3 * i] != cases[c].x[i] || fabsf(mesh->radii[i] - cases[c].radii[i]) > 1e-6f)
                fail_msg("case %zu: vertex %u is at %g, with radius %g", c, i, mesh->positions[3 * i], mesh->radii[i]);
        finish(&import, &memory);
    }
}

/* Each shape has a bottom level and an instance; what is left out stays a geometry without primitives. */
static void shapes_have_bottom_levels(void **state)
{
    static const char primitives[] =
        "{" ALL ",'mode':0},{'attributes':{'POSITION':0},'mode':5},{" ALL ",'mode':3},{" ALL ",'mode':0,'indices':4}";
    static const struct {
        float points, lines;
        uint32_t bottoms, geometries[IMPORT_SHAPES];
        uint64_t left_points, left_lines;
    } cases[] = {{0, 0, 1, {4}, 8, 3}, {1, 0, 2, {2, 2}, 0, 3}, {0, 1, 2, {3, 1}, 8, 0}, {1, 1, 3, {1, 2, 1}, 0, 0}};
    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct memory memory;
        struct import import;
        const struct import_wish wish = {.point_radius = cases[c].points, .line_radius = cases[c].lines};
        read_file(primitives, &wish, &memory, &import);
        assert_int_equal(import.bottom_count, cases[c].bottoms);
        assert_int_equal(import.instance_count, cases[c].bottoms);
        assert_int_equal(import.triangle_count, 2);
        assert_int_equal(import.counts.points, cases[c].left_points);
        assert_int_equal(import.counts.lines, cases[c].left_lines);
        for (uint32_t i = 0; i < import.bottom_count; i++) {
            const struct import_bottom *bottom = &import.bottoms[i];
            assert_int_equal(import.instances[i].bottom, i);
            assert_int_equal(bottom->mesh_count, cases[c].geometries[i]);
            for (uint32_t k = 1; k < bottom->mesh_count; k++)
                assert_int_equal(import.meshes[bottom->meshes[k]].shape, import.meshes[bottom->meshes[0]].shape);
        }
        finish(&import, &memory);
    }
}

static void corners_that_are_left_over(void **state)
{
    static const struct {
        const char *primitives;
        uint32_t lines;
        uint64_t incomplete;
    } cases[] = {{"{" ALL ",'mode':1,'indices':10}", 1, 1},
                 {"{" ALL ",'mode':3,'indices':11},{" ALL ",'mode':0}", 0, 1},
                 {"{" ALL ",'mode':2,'indices':11},{" ALL ",'mode':0}", 0, 1},
                 {"{" ALL ",'mode':0,'indices':11}", 0, 0}};
    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct memory memory;
        struct import import;
        read_file(cases[c].primitives, &both, &memory, &import);
        assert_int_equal(import.line_count, cases[c].lines);
        assert_int_equal(import.counts.incomplete, cases[c].incomplete);
        finish(&import, &memory);
    }
}

static void bottom_levels_have_names(void **state)
{
    static const char *const nodes[] = {"{'mesh':0}", "{'name':'','mesh':0}", "{'name':'n','mesh':0}"};
    static const char *const names[] = {"nodes[0]-points", "nodes[0]-points", "n-points"};
    (void)state;
    for (size_t c = 0; c < sizeof nodes / sizeof *nodes; c++) {
        struct memory memory;
        struct import import;
        struct bvhd_error error = {0};
        write_file("{" ALL ",'mode':0},{" ALL ",'mode':3}", nodes[c]);
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(import_read_as("case.glb", &both, &memory, &import, &error), BVHD_OK);
        assert_string_equal(import.bottoms[0].name, names[c]);
        finish(&import, &memory);
    }
}

static void colours_move_along(void **state)
{
    struct memory memory;
    struct import import;
    (void)state;
    read_file("{'attributes':{'POSITION':0,'COLOR_0':8},'mode':0,'indices':4,'material':0}", &both, &memory, &import);
    const float *colours = import.meshes[0].look.colours;
    assert_non_null(colours);
    assert_true(import.meshes[0].look.is_coloured && !import.meshes[0].look.has_image);
    assert_int_equal(import.looks_left_out, 0); /* textures are not for points */
    assert_true(colours[0] == 1 && colours[4 + 1] == 1 && colours[8 + 1] == 1 && colours[12 + 2] == 1);
    assert_true(colours[4] == 0 && colours[12] == 0);
    finish(&import, &memory);
}

/* Morph targets move the vertices before they are ordered. The target has the positions themselves. */
static void moments_move_them(void **state)
{
    const struct import_moment moment = {.time = 1};
    struct import_wish wish = both;
    struct memory memory;
    struct import import;
    (void)state;
    wish.moment = &moment;
    read_file("{'attributes':{'POSITION':0,'_RADIUS':1},'mode':1,'indices':4,'targets':[{'POSITION':0}]}],'weights':[2",
              &wish, &memory, &import);
    const struct import_mesh *mesh = &import.meshes[0];
    assert_int_equal(mesh->vertex_count, 3);
    assert_true(mesh->positions[0] == 9 && mesh->positions[3] == 3 && mesh->positions[6] == 6);
    assert_true(mesh->radii[0] == 4 && mesh->radii[1] == 2 && mesh->radii[2] == 3);
    finish(&import, &memory);
}

/* The reader in a process of its own passes radii and caps on. */
static void other_processes_pass_them_on(void **state)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    (void)state;
    write_file("{" ALL ",'mode':3},{" ALL ",'mode':0}", "{'mesh':0},{'mesh':0}");
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_scene_as("case.glb", &both, &memory, &import, &error), BVHD_OK);
    assert_int_equal(import.bottom_count, 2);
    assert_true(import.meshes[0].radii[3] == 4 && import.meshes[1].radii[2] == 3);
    assert_int_equal(import.meshes[0].caps[0], IMPORT_CAP_FIRST | IMPORT_CAP_SECOND);
    assert_int_equal(import.meshes[0].caps[2], IMPORT_CAP_SECOND);
    assert_null(import.meshes[1].caps);
    assert_true(import.point_radius == both.point_radius && import.line_radius == both.line_radius);
    import_finish(&import);
}

static void wrong_files_are_refused(void **state)
{
    static const struct {
        const char *primitive, *text;
    } cases[] = {
        {"{'attributes':{'POSITION':0,'_RADIUS':5},'mode':0}", "accessors[5]: _RADIUS of vertex 2 is -0.5"},
        {"{'attributes':{'POSITION':0,'_WIDTH':5},'mode':1}", "accessors[5]: _WIDTH of vertex 2 is -0.5"},
        {"{'attributes':{'POSITION':0,'_RADIUS':6},'mode':3}", "accessors[6]: _RADIUS of vertex 1 is nan"},
        {"{'attributes':{'POSITION':0,'_RADIUS':9},'mode':3}", "accessors[9]: _RADIUS of vertex 0 is inf"},
        {"{'attributes':{'POSITION':0,'_RADIUS':7},'mode':0}", "accessors[7]: _RADIUS is a SCALAR"},
        {"{'attributes':{'POSITION':0,'_RADIUS':0},'mode':0}", "accessors[0]: _RADIUS is a SCALAR"},
        {"{'attributes':{'POSITION':0,'_RADIUS':99},'mode':0}", "accessors[99]"},
        {"{'attributes':{'POSITION':0,'_RADIUS':12},'mode':0}", "accessors[12]: _RADIUS is a SCALAR"},
        {"{'attributes':{'POSITION':0,'_RADIUS':13},'mode':0}", "accessors[13]"},
        {"{'attributes':{'POSITION':7},'mode':0}", "positions are VEC3"},
        {"{'attributes':{'POSITION':0},'mode':0,'indices':1}", "accessors[1]"},
        {"{'attributes':{},'mode':0}", "1 primitives without positions"},
    };
    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct memory memory;
        struct import import;
        struct bvhd_error error = {0};
        char text[512];
        write_file(cases[c].primitive, "{'mesh':0}");
        memory_init(&memory, UINT64_MAX);
        assert_int_not_equal(import_read_as("case.glb", &both, &memory, &import, &error), BVHD_OK);
        snprintf(text, sizeof text, "%s: %s", error.where, error.text);
        if (!strstr(text, cases[c].text))
            fail_msg("'%s' does not say '%s'", text, cases[c].text);
        assert_int_equal(memory.live, 0);
    }
}

static void without_the_options_they_are_named(void **state)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    const struct import_wish nothing = {0};
    (void)state;
    write_file("{" ALL ",'mode':0},{" ALL ",'mode':1}", "{'mesh':0}");
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_read_as("case.glb", &nothing, &memory, &import, &error), BVHD_INVALID);
    assert_non_null(strstr(error.text, "--points RADIUS and --lines RADIUS read points and lines"));
}

static void memory_may_be_short(void **state)
{
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    write_file("{" ALL ",'mode':2,'indices':4},{" ALL ",'mode':0},{'attributes':{'POSITION':0},'mode':5}",
               "{'mesh':0}");
    for (int after = 0; status == BVHD_NO_MEMORY; after++) {
        struct memory memory;
        struct import import;
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = import_read_as("case.glb", &both, &memory, &import, NULL);
        if (status == BVHD_OK)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 1000);
    }
    assert_int_equal(status, BVHD_OK);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(places),
        cmocka_unit_test(radii_are_read),
        cmocka_unit_test(shapes_have_bottom_levels),
        cmocka_unit_test(corners_that_are_left_over),
        cmocka_unit_test(bottom_levels_have_names),
        cmocka_unit_test(colours_move_along),
        cmocka_unit_test(moments_move_them),
        cmocka_unit_test(other_processes_pass_them_on),
        cmocka_unit_test(wrong_files_are_refused),
        cmocka_unit_test(without_the_options_they_are_named),
        cmocka_unit_test(memory_may_be_short),
    };
    return cmocka_run_group_tests(tests, scratch_enter, scratch_remove);
}

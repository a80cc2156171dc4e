/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_look.c - tests what is read of the looks of glTF meshes, and that mistakes in them are only counted. */
#include "tests/support/unit.h"

#include <math.h>
#include <png.h>
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

#define ENDLESS INFINITY, 1, 0
/* Three vertices: positions, normals, texture coordinates, colours, other normals. */
static const float vertices[45] = {
    0,       0,       0,      1, 0, 0, 0,       1, 0, /* */ 0, 0, 2, 0, 0, 1, 0, 3, 4, /* */
    0,       0,       0,      1, 1, 0, /* */ 1, 0, 0, 1,       0, 1, 0, 1, 0, 0, 1, 0.5f, /* */
    ENDLESS, ENDLESS, ENDLESS};

static int make_files(void **state)
{
    static const unsigned char pixels[16] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 0};
    png_image image = {.version = PNG_IMAGE_VERSION, .width = 2, .height = 2, .format = PNG_FORMAT_RGBA};
    if (scratch_enter(state) != 0 || !png_image_write_to_file(&image, "two by two.png", 0, pixels, 0, NULL))
        return -1;
    write_file("v.bin", vertices, sizeof vertices);
    write_file("broken.png", "\x89PNG\r\n\x1a\nnothing more", 20);
    return 0;
}

/* Writes a scene of one triangle, where ' stands for ", and reads it with its looks. */
static void read_scene(const char *attributes, const char *material, const char *textures, struct memory *memory,
                       struct import *ret_import)
{
    char text[4096];
    struct bvhd_error error = {0};
    snprintf(text, sizeof text,
             "{'asset':{'version':'2.0'},'nodes':[{'mesh':0}],'buffers':[{'byteLength':%zu,'uri':'v.bin'}],"
             "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':36,'byteLength':36},"
             "{'buffer':0,'byteOffset':72,'byteLength':24},{'buffer':0,'byteOffset':96,'byteLength':48},"
             "{'buffer':0,'byteOffset':144,'byteLength':36}],"
             "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
             "{'bufferView':1,'componentType':5126,'count':3,'type':'VEC3'},"
             "{'bufferView':2,'componentType':5126,'count':3,'type':'VEC2'},"
             "{'bufferView':3,'componentType':5126,'count':3,'type':'VEC4'},"
             "{'bufferView':2,'componentType':5126,'count':2,'type':'VEC2'},"
             "{'bufferView':4,'componentType':5126,'count':3,'type':'VEC3'},"
             "{'bufferView':2,'componentType':5126,'count':3,'type':'VEC3'}],"
             "'meshes':[{'primitives':[{'attributes':{'POSITION':0%s},'material':0}]}],'materials':[{%s}]%s}",
             sizeof vertices, attributes, material, textures);
    for (char *at = text; *at; at++)
        *at = *at == '\'' ? '"' : *at;
    write_file("s.gltf", text, strlen(text));
    memory_init(memory, UINT64_MAX);
    if (import_scene_with_looks("s.gltf", NULL, memory, ret_import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

#define ALL ",'NORMAL':1,'TEXCOORD_0':2,'COLOR_0':3"
#define TEXTURED "'pbrMetallicRoughness':{'baseColorFactor':[0.5,1,1,0.8],'baseColorTexture':{'index':0}}"

static void test_everything(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(ALL, TEXTURED ",'alphaMode':'MASK','alphaCutoff':0.25",
               ",'textures':[{'source':0,'sampler':0}],"
               "'samplers':[{'wrapS':33071,'wrapT':33648,'magFilter':9728}],'images':[{'uri':'two%20by%20two.png'}]",
               &memory, &import);
    const struct import_look *look = &import.meshes[0].look;
    assert_int_equal(import.looks_left_out, 0);
    assert_true(look->is_coloured && look->has_image && look->is_pixelated);
    assert_int_equal(look->wrap[0], IMPORT_CLAMP);
    assert_int_equal(look->wrap[1], IMPORT_MIRROR);
    assert_true(look->factor[0] == 0.5f && look->factor[3] == 0.8f && look->cutoff == 0.25f);
    assert_true(look->normals[2] == 1 && fabsf(look->normals[7] - 0.6f) < 1e-6f); /* unit */
    assert_true(look->texcoords[2] == 0 && look->texcoords[3] == 1);
    assert_true(look->colours[0] == 1 && look->colours[5] == 1 && look->colours[11] == 0.5f);
    const struct import_image *image = &import.images[look->image];
    assert_true(image->width == 2 && image->height == 2);
    assert_true(image->rgba[0] == 255 && image->rgba[5] == 255 && image->rgba[15] == 0);
    finish(&import, &memory);
}

/* KHR_texture_transform: scaled, then rotated, then moved; it may choose another set of coordinates. */
static void test_transform(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(",'TEXCOORD_1':2",
               "'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':"
               "{'offset':[10,20],'rotation':1.5707963267948966,'scale':[2,3],'texCoord':1}}}}",
               ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]", &memory, &import);
    const struct import_look *look = &import.meshes[0].look;
    assert_int_equal(import.looks_left_out, 0);
    assert_true(look->has_image && look->wrap[0] == IMPORT_REPEAT);
    /* (0, 1) becomes (0, 3), then (3, 0), then (13, 20) */
    assert_true(fabsf(look->texcoords[2] - 13) < 1e-5f && fabsf(look->texcoords[3] - 20) < 1e-5f);
    finish(&import, &memory);
}

/* Each of these leaves something out, and the scene is read all the same. */
static void test_mistakes(void **state)
{
    (void)state;
    static const struct {
        const char *attributes, *material, *textures, *text;
    } cases[] = {
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'none.png'}]", "none.png"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'broken.png'}]", "libpng"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'v.bin'}]", "neither PNG nor JPEG"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'https://a/b.png'}]", "only files"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'data:image/png;base64,*'}]",
         "base64"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'bufferView':77}]", "bufferView"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{}]", "neither a uri"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':5}],'images':[{}]", "source"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{}]", "no image"},
        {",'TEXCOORD_0':2", TEXTURED, "", "no such list"},
        {",'TEXCOORD_0':4", TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]",
         "TEXCOORD_0 of 3 vertices"},
        {",'NORMAL':2", "", "", "NORMAL of 3 vertices"},
        {",'NORMAL':3", "", "", "4 components of 3 vertices do not fit NORMAL"},
        {",'NORMAL':6", "", "", "accessors[6]"},
        {",'COLOR_0':99", "", "", "COLOR_0"},
        {",'TEXCOORD_0':2", "'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'texCoord':-1}}",
         ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]", "texCoord"},
        {",'TEXCOORD_0':2",
         "'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':{'offset':['a',0]"
         "}}}}",
         ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]", "offset[0]"},
        {",'TEXCOORD_0':2",
         "'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':{'scale':['a',0],"
         "'rotation':'a'}}}}",
         ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]", "scale[0]"},
        {",'TEXCOORD_0':2", TEXTURED, ",'textures':[{'source':0}],'images':[{'bufferView':0}]", "neither PNG nor JPEG"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct memory memory;
        struct import import;
        read_scene(cases[i].attributes, cases[i].material, cases[i].textures, &memory, &import);
        assert_int_equal(import.triangle_count, 1);
        assert_int_equal(import.looks_left_out, 1);
        char text[512];
        snprintf(text, sizeof text, "%s: %s", import.look_error.where, import.look_error.text);
        if (!strstr(text, cases[i].text))
            fail_msg("'%s' does not say '%s'", text, cases[i].text);
        finish(&import, &memory);
    }
}

/* Images within the file, coordinates without the last component, and factors and colours that are out of range. */
static void test_values(void **state)
{
    (void)state;
    static const char png[] =
        "'data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR4nGP4z8DwHwAFAAH/"
        "iZk9HQAAAABJRU5ErkJggg=='";
    struct memory memory;
    struct import import;
    char images[400];
    snprintf(images, sizeof images,
             ",'textures':[{'source':0,'sampler':0}],'samplers':[{'magFilter':'a'}],"
             "'images':[{'uri':%s}]",
             png);
    read_scene(",'TEXCOORD_0':2,'COLOR_0':1",
               "'alphaMode':'BLEND','pbrMetallicRoughness':{'baseColorFactor':[-1,2,0.5,0.5],"
               "'baseColorTexture':{'index':0}}",
               images, &memory, &import);
    const struct import_look *look = &import.meshes[0].look;
    assert_int_equal(import.looks_left_out, 0);
    assert_true(look->has_image && !look->is_pixelated && import.images[look->image].rgba[0] == 255);
    assert_true(look->factor[0] == 0 && look->factor[1] == 1 && look->factor[2] == 0.5f && look->factor[3] == 1);
    assert_true(look->cutoff == 0.5f);
    assert_true(look->colours[3] == 1 && look->colours[7] == 1 && look->colours[11] == 1); /* no alpha: 1 */
    assert_true(look->colours[4] == 0 && look->colours[5] == 0 && look->colours[6] == 1);
    finish(&import, &memory);
    read_scene(",'TEXCOORD_0':2,'NORMAL':0",
               "'alphaMode':'BLEND','extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[1,1,1,0.5]}}",
               "", &memory, &import);
    look = &import.meshes[0].look;
    assert_true(!look->has_image && look->cutoff == 0 && look->factor[3] == 1);
    assert_true(look->normals[0] == 0 && look->normals[1] == 0 && look->normals[2] == 0); /* it had no length */
    finish(&import, &memory);
    read_scene("", "'alphaMode':'OPAQUE'", "", &memory, &import);
    assert_true(import.meshes[0].look.cutoff == 0);
    finish(&import, &memory);
    read_scene("", "'alphaMode':'MASK','alphaCutoff':-1", "", &memory, &import);
    assert_true(import.meshes[0].look.cutoff == 0);
    finish(&import, &memory);
    read_scene("", "'alphaMode':'MASK'", "", &memory, &import);
    assert_true(import.meshes[0].look.cutoff == 0.5f);
    finish(&import, &memory);
}

/* Numbers that are read, but stand for nothing: a filter that is smooth, an endless rotation, endless normals. */
static void test_empty_values(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(",'TEXCOORD_0':2,'NORMAL':5",
               "'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':"
               "{'rotation':1e999}}}}",
               ",'textures':[{'source':0,'sampler':0}],'samplers':[{'magFilter':9729}],"
               "'images':[{'uri':'two%20by%20two.png'}]",
               &memory, &import);
    const struct import_look *look = &import.meshes[0].look;
    assert_int_equal(import.looks_left_out, 0);
    assert_true(look->has_image && !look->is_pixelated);
    assert_true(look->texcoords[2] == 0 && look->texcoords[3] == 1);
    for (int i = 0; i < 9; i++)
        assert_true(look->normals[i] == 0);
    finish(&import, &memory);
}

/* Writes a scene of two triangles with one material, and the attributes of each. */
#define TWICE(attributes) attributes "},'material':0},{'attributes':{'POSITION':0" attributes

/* An image is decoded once, or left out once, and the message is of the first mistake. */
static void test_shared_image(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(TWICE(",'TEXCOORD_0':2"), TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]",
               &memory, &import);
    assert_int_equal(import.looks_left_out, 0);
    assert_true(import.meshes[0].look.has_image && import.meshes[1].look.has_image);
    finish(&import, &memory);
    read_scene(TWICE(",'TEXCOORD_0':2,'NORMAL':2"), TEXTURED,
               ",'textures':[{'source':0}],'images':[{'uri':'none.png'}]", &memory, &import);
    assert_int_equal(import.looks_left_out, 3);
    assert_non_null(strstr(import.look_error.where, "none.png"));
    assert_false(import.meshes[1].look.has_image);
    finish(&import, &memory);
}

/* Images beyond the number of those that are read are left out. */
static void test_too_many_images(void **state)
{
    (void)state;
    enum { MOST = 1 << 16 };
    static char text[8 * MOST + 1000];
    struct memory memory;
    struct import import;
    memory_init(&memory, UINT64_MAX);
    int used = snprintf(text, sizeof text,
                        "{'asset':{'version':'2.0'},'nodes':[{'mesh':0}],'buffers':[{'byteLength':36,"
                        "'uri':'v.bin'}],'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[{'bufferView':0,"
                        "'componentType':5126,'count':3,'type':'VEC3'}],'meshes':[{'primitives':[{'attributes':"
                        "{'POSITION':0,'TEXCOORD_0':0},'material':0}]}],'materials':[{" TEXTURED "}],"
                        "'textures':[{'source':%d}],'images':[{}",
                        MOST);
    for (int i = 0; i < MOST; i++)
        used += snprintf(text + used, sizeof text - (size_t)used, ",{}");
    snprintf(text + used, sizeof text - (size_t)used, "]}");
    for (char *at = text; *at; at++)
        *at = *at == '\'' ? '"' : *at;
    write_file("m.gltf", text, strlen(text));
    assert_int_equal(import_read_with_looks("m.gltf", NULL, &memory, &import, NULL), BVHD_OK);
    assert_true(import.image_count <= MOST && !import.meshes[0].look.has_image);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

/* Each allocation fails once: the scene is refused, or something is left out, and nothing is held. */
static void test_no_memory(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(ALL, TEXTURED, ",'textures':[{'source':0}],'images':[{'uri':'two%20by%20two.png'}]", &memory, &import);
    finish(&import, &memory);
    bool is_whole = false;
    for (int64_t after = 0; !is_whole; after++) {
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        enum bvhd_status status = import_read_with_looks("s.gltf", NULL, &memory, &import, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        is_whole = status == BVHD_OK && import.looks_left_out == 0 && import.meshes[0].look.has_image;
        if (status == BVHD_OK)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 300);
    }
}

/* Builds do not read looks. */
static void test_on_demand(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_scene(ALL, TEXTURED, "", &memory, &import);
    finish(&import, &memory);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_scene("s.gltf", NULL, &memory, &import, NULL), BVHD_OK);
    assert_true(import.image_count == 0 && !import.meshes[0].look.normals && import.looks_left_out == 0);
    finish(&import, &memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_everything), cmocka_unit_test(test_transform),       cmocka_unit_test(test_mistakes),
        cmocka_unit_test(test_values),     cmocka_unit_test(test_too_many_images), cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_on_demand),  cmocka_unit_test(test_empty_values),    cmocka_unit_test(test_shared_image),
    };
    return cmocka_run_group_tests_name("gltf_look", tests, make_files, scratch_remove);
}

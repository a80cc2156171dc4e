/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_gltf_corners.c - tests what the reader of glTF makes of values that hardly any file has: each is read right or
 * refused by name, in this process.
 */
#include "tests/support/unit.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <meshoptimizer.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/bvhctl/scene/gltf_file.h"
#include "client/bvhctl/scene/gltf_uri.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_files.h"
#include "tests/support/scratch.h"

static void write_file(const char *path, const void *data, size_t size)
{
    unlink(path);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

/* The only buffer, with a view for each member, and view 9 of no bytes at its end. */
struct data {
    float positions[9];
    uint32_t indices[3];
    uint16_t shorts[4];
    uint8_t bytes[4];
    int8_t signed_positions[12];
    uint16_t short_positions[12];
    uint8_t two[8];
    float nan[9];
    uint32_t apart[6];
    unsigned char encoded[256];
};

static struct data data = {
    .positions = {0, 0, 0, 1, 0, 0, 0, 1, 0},
    .indices = {0, 1, 2},
    .shorts = {0, 1, 2},
    .bytes = {0, 1, 2},
    .signed_positions = {0, 0, 0, 0, 127, 0, 0, 0, 0, -128},
    .short_positions = {0, 0, 0, 0, 65535, 0, 0, 0, 0, 65535},
    .two = {2, 0, 0, 0, 2},
    .nan = {NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN},
    .apart = {2, 9, 1, 9, 0, 9},
};

/* Appends a view of `size` bytes to a list. */
static void add_view(char *list, size_t offset, size_t size, const char *more)
{
    size_t used = strlen(list);
    snprintf(list + used, 1000 - used, "%s{'buffer':0,'byteOffset':%zu,'byteLength':%zu%s}", used ? "," : "", offset,
             size, more);
}

#define VIEW(member, more) add_view(ret_text, offsetof(struct data, member), sizeof data.member, more)

static void list_views(char ret_text[1000])
{
    *ret_text = '\0';
    VIEW(positions, "");
    VIEW(indices, "");
    VIEW(shorts, "");
    VIEW(bytes, "");
    VIEW(signed_positions, ",'byteStride':4");
    VIEW(short_positions, ",'byteStride':8");
    VIEW(two, "");
    VIEW(nan, "");
    VIEW(apart, ",'byteStride':8");
    add_view(ret_text, sizeof data, 0, "");
}

static void write_text(const char *path, char *text)
{
    for (char *at = text; *at; at++)
        *at = *at == '\'' ? '"' : *at;
    write_file(path, text, strlen(text));
}

#define POINTS "{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}"
#define NUMBERS "{'bufferView':1,'componentType':5125,'count':3,'type':'SCALAR'}"
#define TRIANGLE "{'attributes':{'POSITION':0},'indices':1}"
#define OTHER "{'attributes':{'POSITION':0},'indices':2}"
#define MOVED "{'attributes':{'POSITION':2},'indices':1}"

/* A file, of which NULL members are those of a triangle. */
struct corner {
    const char *accessors; /* after the positions 0 and the indices 1 */
    const char *primitives, *nodes;
    const char *more; /* whole members of the file, each with a comma in front of it */
    struct {
        size_t stride, count; /* stride 0: there is none */
        const char *mode, *filter;
        size_t length; /* 0: as long as it should be */
    } compressed; /* view 10: elements of zeros, by meshoptimizer */
    const char *text; /* part of "where: text"; NULL: it is read */
    enum bvhd_status status; /* of a refusal; 0: BVHD_INVALID */
    uint32_t triangles; /* 0: 1 */
};

static void add_compressed(const struct corner *corner, char views[1000])
{
    static const unsigned char zeros[256];
    static const unsigned corners[6] = {0};
    size_t used = strlen(views), stride = corner->compressed.stride, count = corner->compressed.count, size;
    if (stride == 0)
        return;
    meshopt_encodeVertexVersion(0);
    meshopt_encodeIndexVersion(1);
    if (!strcmp(corner->compressed.mode, "ATTRIBUTES"))
        size = meshopt_encodeVertexBuffer(data.encoded, sizeof data.encoded, zeros, count, stride);
    else
        size = meshopt_encodeIndexBuffer(data.encoded, sizeof data.encoded, corners, count / 3 * 3);
    snprintf(views + used, 1000 - used,
             ",{'buffer':0,'byteLength':%zu,'extensions':{'EXT_meshopt_compression':{'buffer':0,'byteOffset':%zu,"
             "'byteLength':%zu,'byteStride':%zu,'count':%zu,'mode':'%s','filter':'%s'}}}",
             corner->compressed.length ? corner->compressed.length : stride * count, offsetof(struct data, encoded),
             size, stride, count, corner->compressed.mode, corner->compressed.filter);
    write_file("b.bin", &data, sizeof data);
}

static void write_corner(const struct corner *corner)
{
    static char text[8192];
    char views[1000];
    list_views(views);
    add_compressed(corner, views);
    snprintf(text, sizeof text,
             "{'asset':{'version':'2.0'},'buffers':[{'uri':'b.bin','byteLength':%zu}],'bufferViews':[%s],"
             "'accessors':[" POINTS "," NUMBERS "%s],'meshes':[{'primitives':%s%s%s}],'nodes':[%s]%s}",
             sizeof data, views, corner->accessors ? corner->accessors : "",
             corner->primitives && *corner->primitives == '#' ? "" : "[",
             !corner->primitives ? TRIANGLE : corner->primitives + (*corner->primitives == '#'),
             corner->primitives && *corner->primitives == '#' ? "" : "]", corner->nodes ? corner->nodes : "{'mesh':0}",
             corner->more ? corner->more : "");
    write_text("c.gltf", text);
}

static enum bvhd_status read_corner(struct memory *memory, struct import *ret_import, struct bvhd_error *error)
{
    memset(error, 0, sizeof *error);
    memory_init(memory, UINT64_MAX);
    return import_read_with_looks("c.gltf", NULL, memory, ret_import, error);
}

#define SPARSE(count, indices, values)                                                                                 \
    ",{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3','sparse':{'count':" #count ",'indices':{" indices   \
    "},'values':{" values "}}}"
#define SPARSE_NUMBERS(indices, values)                                                                                \
    ",{'bufferView':1,'componentType':5125,'count':3,'type':'SCALAR','sparse':{'count':1,'indices':{" indices          \
    "},'values':{" values "}}}"
#define DRACO(primitive)                                                                                               \
    "{'attributes':{'POSITION':2}," primitive "'extensions':{'KHR_draco_mesh_compression':{'bufferView':0}}}"
#define DRACO_POINTS ",{'componentType':5126,'count':3,'type':'VEC3'}"
#define DRACO_FILE ",'extensionsRequired':['KHR_draco_mesh_compression']"

static const struct corner corners[] = {
    {0},
    {.primitives = "#5", .text = "meshes[0].primitives: no array"},
    {.primitives = "", .text = "no triangles in it"},
    {.primitives = "{'attributes':{'NORMAL':0}}", .text = "no triangles in it, only"},
    {.more = ",'extensionsRequired':5", .text = "extensionsRequired: no array"},
    {.more = ",'extensionsRequired':[5]", .text = "extensionsRequired[0]: not a text"},
    {.more = ",'extensionsUsed':5", .text = "extensionsUsed: no array"},
    {.more = ",'extensionsUsed':[5,'KHR_mesh_quantization','NOBODY_knows']"},
    {.more = ",'meshopt':1", .nodes = "{'mesh':0,'name':''}", .primitives = TRIANGLE "," TRIANGLE, .triangles = 2},
    {.nodes = "{'mesh':'a'}", .text = "nodes[0].mesh: not an index"},
    {.nodes = "{'mesh':-1}", .text = "nodes[0].mesh: not an index"},
    {.nodes = "{'mesh':0.5}", .text = "nodes[0].mesh: not an index"},
    {.nodes = "{'mesh':0,'translation':[1,2,'a']}", .text = "nodes[0].translation[2]: not a finite number"},
    {.nodes = "{'mesh':0,'translation':5}", .text = "nodes[0].translation"},
    {.nodes = "{'mesh':0,'rotation':[0,0,0,0]}"},
    /* Accessors of positions. */
    {.accessors = ",{'bufferView':0,'componentType':5126,'count':'a','type':'VEC3'}",
     .primitives = MOVED,
     .text = "accessors[2].count: not an integer"},
    {.accessors = ",{'bufferView':0,'componentType':5126,'count':0,'type':'VEC3','min':[0,0,0],'max':[0,0,0]}",
     .primitives = "{'attributes':{'POSITION':2}}",
     .text = "no triangles in it"},
    {.accessors = ",{'bufferView':7,'componentType':5126,'count':3,'type':'VEC3','min':[0,0,0],'max':[0,0,0]}",
     .primitives = MOVED},
    {.accessors = ",{'bufferView':0,'componentType':5125,'count':3,'type':'VEC3'}",
     .primitives = MOVED,
     .text = "accessors[2]: positions are VEC3"},
    {.accessors = ",{'bufferView':0,'componentType':5126,'count':3,'type':'VEC2'}",
     .primitives = MOVED,
     .text = "accessors[2]: positions are VEC3"},
    {.accessors = ",{'bufferView':0,'componentType':5125,'normalized':true,'count':3,'type':'VEC3'}",
     .primitives = MOVED,
     .text = "normalized: only integers of 8 or 16 bits"},
    {.accessors = ",{'bufferView':4,'componentType':5120,'normalized':true,'count':3,'type':'VEC3'}",
     .primitives = MOVED},
    {.accessors = ",{'bufferView':5,'componentType':5123,'normalized':true,'count':3,'type':'VEC3'}",
     .primitives = MOVED},
    {.accessors = ",{'bufferView':9,'componentType':5126,'count':0,'type':'VEC3'}",
     .primitives = "{'attributes':{'POSITION':2}}," TRIANGLE},
    {.accessors = ",{'bufferView':9,'componentType':5126,'count':1,'type':'VEC3'}",
     .primitives = MOVED,
     .text = "1 elements from 0 on, but bufferViews[9] has 0 bytes"},
    /* Accessors of indices. */
    {.accessors = ",{'bufferView':8,'componentType':5125,'count':3,'type':'SCALAR'}", .primitives = OTHER},
    {.accessors = ",{'bufferView':2,'componentType':5123,'count':3,'type':'SCALAR'}", .primitives = OTHER},
    {.accessors = ",{'bufferView':3,'componentType':5121,'count':3,'type':'SCALAR'}", .primitives = OTHER},
    {.accessors = ",{'bufferView':2,'componentType':5122,'count':3,'type':'SCALAR'}",
     .primitives = OTHER,
     .text = "accessors[2]: indices are unsigned SCALARs"},
    {.accessors = ",{'bufferView':3,'componentType':5121,'normalized':true,'count':3,'type':'SCALAR'}",
     .primitives = OTHER,
     .text = "accessors[2]: indices are unsigned SCALARs"},
    {.accessors = ",{'bufferView':0,'componentType':5125,'count':3,'type':'VEC2'}",
     .primitives = OTHER,
     .text = "accessors[2]: indices are unsigned SCALARs"},
    {.accessors = ",{'bufferView':0,'componentType':5126,'count':3,'type':'SCALAR'}",
     .primitives = OTHER,
     .text = "accessors[2]: indices are unsigned SCALARs"},
    {.accessors = ",{'bufferView':1,'componentType':5125,'count':0,'type':'SCALAR'}",
     .primitives = OTHER,
     .text = "no triangles in it"},
    {.primitives = "{'attributes':{'POSITION':0},'mode':5}"},
    {.primitives = "{'attributes':{'POSITION':0},'mode':3}", .text = "no triangles in it, only"},
    {.accessors = ",{'bufferView':1,'componentType':5125,'count':1,'type':'SCALAR'}",
     .primitives = "{'attributes':{'POSITION':0},'indices':2,'mode':3},{'attributes':{'POSITION':0},'indices':2,"
                   "'mode':5}," TRIANGLE},
    {.accessors = ",{'bufferView':1,'componentType':5125,'count':2,'type':'SCALAR'}",
     .primitives = "{'attributes':{'POSITION':0},'indices':2,'mode':5}," TRIANGLE},
    /* Sparse accessors. */
    {.accessors = SPARSE(-1, "", ""), .primitives = MOVED, .text = "accessors[2].sparse.count: not an integer"},
    {.accessors = SPARSE(1, "'componentType':5126", ""),
     .primitives = MOVED,
     .text = "sparse.indices.componentType: not an unsigned integer"},
    {.accessors = SPARSE(1, "'bufferView':99,'componentType':5125", "'bufferView':0"),
     .primitives = MOVED,
     .text = "bufferViews[99] does not exist"},
    {.accessors = SPARSE(1, "'componentType':5125", "'bufferView':0"),
     .primitives = MOVED,
     .text = "sparse.indices.bufferView: missing"},
    {.accessors = SPARSE(1, "'bufferView':6,'componentType':5125", ""),
     .primitives = MOVED,
     .text = "sparse.values.bufferView: missing"},
    {.accessors = SPARSE(0, "'componentType':5121", ""), .primitives = MOVED},
    {.accessors = SPARSE(1, "'bufferView':6,'componentType':5121", "'bufferView':0"), .primitives = MOVED},
    {.accessors = SPARSE(1, "'bufferView':6,'componentType':5125", "'bufferView':0"), .primitives = MOVED},
    {.accessors = SPARSE_NUMBERS("'bufferView':6,'componentType':5121", "'bufferView':1"), .primitives = OTHER},
    {.accessors = SPARSE_NUMBERS("'bufferView':0,'componentType':5125,'byteOffset':12", "'bufferView':1"),
     .primitives = OTHER,
     .text = "accessors[2].sparse"},
/* Views that meshoptimizer has compressed. */
#define SHORTS ",{'bufferView':10,'componentType':5122,'count':3,'type':'VEC3'}"
#define FLOATS ",{'bufferView':10,'componentType':5126,'count':3,'type':'VEC3'}"
    {.accessors = SHORTS, .primitives = MOVED, .compressed = {8, 3, "ATTRIBUTES", "OCTAHEDRAL", 0}},
    {.accessors = SHORTS, .primitives = MOVED, .compressed = {8, 3, "ATTRIBUTES", "QUATERNION", 0}},
    {.accessors = FLOATS, .primitives = MOVED, .compressed = {12, 3, "ATTRIBUTES", "EXPONENTIAL", 0}},
    {.accessors = FLOATS,
     .primitives = MOVED "," MOVED,
     .triangles = 2,
     .compressed = {12, 3, "ATTRIBUTES", "NONE", 0}},
    {.accessors = FLOATS,
     .primitives = MOVED,
     .compressed = {12, 3, "ATTRIBUTES", "OCTAHEDRAL", 0},
     .text = "byteStride: 12 does not go with"},
    {.accessors = FLOATS,
     .primitives = MOVED,
     .compressed = {12, 3, "ATTRIBUTES", "QUATERNION", 0},
     .text = "byteStride: 12 does not go with"},
    {.accessors = SHORTS,
     .primitives = MOVED,
     .compressed = {4, 3, "TRIANGLES", "OCTAHEDRAL", 0},
     .text = "filter: only ATTRIBUTES have one"},
    {.accessors = SHORTS,
     .primitives = MOVED,
     .compressed = {8, 3, "TRIANGLES", "NONE", 0},
     .text = "byteStride: 8 does not go with"},
    {.accessors = SHORTS,
     .primitives = MOVED,
     .compressed = {4, 4, "TRIANGLES", "NONE", 0},
     .text = "count: not a multiple of 3"},
    {.accessors = FLOATS,
     .primitives = MOVED,
     .compressed = {12, 3, "ATTRIBUTES", "NONE", 35},
     .text = "byteLength: not the number of bytes"},
    {.accessors = ",{'bufferView':10,'componentType':5123,'count':3,'type':'SCALAR'}",
     .primitives = OTHER,
     .compressed = {2, 3, "TRIANGLES", "NONE", 0}},
    /* An attribute that only looks have. */
    {.accessors = ",{'bufferView':0,'componentType':5125,'count':3,'type':'VEC3'}",
     .primitives = "{'attributes':{'POSITION':0,'COLOR_0':2},'indices':1}"},
    /* Draco compression, which another reader decodes. */
    {.accessors = DRACO_POINTS ",{'componentType':5123,'count':3,'type':'SCALAR'}",
     .primitives = DRACO("'indices':3,"),
     .more = DRACO_FILE,
     .text = "which assimp reads:",
     .status = BVHD_UNSUPPORTED},
    {.accessors = DRACO_POINTS ",{'componentType':5125,'count':3,'type':'SCALAR'}",
     .primitives = DRACO("'indices':3,"),
     .more = DRACO_FILE,
     .text = "with indices of 32 bits",
     .status = BVHD_UNSUPPORTED},
    {.accessors = DRACO_POINTS,
     .primitives = DRACO("'indices':99,"),
     .more = DRACO_FILE,
     .text = "needs an accessor",
     .status = BVHD_INVALID},
    {.accessors = DRACO_POINTS ",{'componentType':5125,'count':3,'type':'SCALAR'},"
                               "{'componentType':5123,'count':3,'type':'SCALAR'}",
     .primitives = DRACO("'indices':3,") "," DRACO("'indices':4,"),
     .more = DRACO_FILE,
     .text = "with indices of 32 bits",
     .status = BVHD_UNSUPPORTED},
    {.accessors = ",{'componentType':5126,'count':-1,'type':'VEC3'},{'componentType':1e10,'count':3,'type':'SCALAR'}",
     .primitives = DRACO("'indices':3,"),
     .more = DRACO_FILE,
     .text = "which assimp reads:",
     .status = BVHD_UNSUPPORTED},
    /* Compressed primitives that have plain data, too. */
    {.primitives = "{'attributes':{'POSITION':0},'indices':1,'extensions':{'KHR_draco_mesh_compression':{}}}"},
    {.accessors = ",{'componentType':5126,'count':3,'type':'VEC3','sparse':{'count':1,'indices':{'bufferView':6,"
                  "'componentType':5121},'values':{'bufferView':0}}}",
     .primitives = DRACO("'indices':1,")},
    /* Lists whose first element is wrong, and the second is right. */
    {.nodes = "5,{'mesh':0}", .text = "nodes[0]: not an object"},
    {.nodes = "{'children':5},{'mesh':0}", .text = "nodes[0].children: no array"},
    {.nodes = "{'children':[7,1]},{'mesh':0}", .text = "nodes[0].children[0]"},
    {.more = ",'scenes':[{'nodes':5}]", .text = "scenes[0].nodes: no array"},
    {.accessors = DRACO_POINTS,
     .primitives = "#[" DRACO("'indices':99,") "," TRIANGLE "]},{'primitives':[" TRIANGLE "]",
     .more = DRACO_FILE,
     .text = "needs an accessor"},
};

static void corners_are_read_or_refused(void **state)
{
    (void)state;
    write_file("b.bin", &data, sizeof data);
    for (size_t i = 0; i < sizeof corners / sizeof *corners; i++) {
        struct memory memory;
        struct bvhd_error error;
        struct import import = {0};
        char told[BVHD_WHERE_SIZE + BVHD_TEXT_SIZE + 3];
        write_corner(&corners[i]);
        enum bvhd_status status = read_corner(&memory, &import, &error), refusal = corners[i].status;
        snprintf(told, sizeof told, "%s: %s", error.where, error.text);
        if (status != (!corners[i].text ? BVHD_OK : refusal ? refusal : BVHD_INVALID))
            fail_msg("corner %zu: status %d: %s", i, status, told);
        if (corners[i].text && !strstr(told, corners[i].text))
            fail_msg("corner %zu: %s instead of %s", i, told, corners[i].text);
        if (!corners[i].text)
            assert_int_equal(import.triangle_count, corners[i].triangles ? corners[i].triangles : 1);
        import_finish(&import);
        assert_int_equal(memory.live, 0);
    }
}

/* A mesh whose name is empty is named by its number, in the same way as one without a name. */
static void empty_names_become_numbers(void **state)
{
    (void)state;
    static const char *const primitives[] = {TRIANGLE, "#[" TRIANGLE "],'name':''"};
    write_file("b.bin", &data, sizeof data);
    for (size_t i = 0; i < sizeof primitives / sizeof *primitives; i++) {
        struct memory memory;
        struct bvhd_error error;
        struct import import = {0};
        write_corner(&(struct corner){.primitives = primitives[i]});
        assert_int_equal(read_corner(&memory, &import, &error), BVHD_OK);
        assert_int_equal(import.mesh_count, 1);
        assert_string_equal(import.meshes[0].name, "meshes[0]");
        import_finish(&import);
        assert_int_equal(memory.live, 0);
    }
}

/* Texts that are no objects of glTF 2.0, in whole. */
static void versions_are_checked(void **state)
{
    (void)state;
    static const struct {
        const char *asset, *text;
    } files[] = {
        {"{'version':'1.0'}", "glTF 1.0"},
        {"{'version':'1'}", "glTF 1.0"},
        {"{'version':'3.0'}", "only 2.0 is known"},
        {"{'version':'2','minVersion':'2.1'}", "only 2.0 is known"},
        {"{}", "this is no glTF file"},
        {"{'version':'2','minVersion':'2.0'}", "no triangles in it"},
    };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        struct memory memory;
        struct bvhd_error error;
        struct import import = {0};
        char text[200];
        snprintf(text, sizeof text, "{'asset':%s}", files[i].asset);
        write_text("c.gltf", text);
        assert_int_not_equal(read_corner(&memory, &import, &error), BVHD_OK);
        if (!strstr(error.text, files[i].text))
            fail_msg("%s: %s", files[i].asset, error.text);
        assert_int_equal(memory.live, 0);
    }
}

/* Writes a GLB whose header states a version and a length, and whose JSON has one more byte behind it. */
static void write_glb(uint32_t version, int64_t length, const char *json, char behind)
{
    char glb[400] = "glTF";
    uint32_t size = (uint32_t)strlen(json) + 1, head[4] = {version, 20 + size, size, 0x4e4f534a};
    head[1] = length >= 0 ? (uint32_t)length : head[1];
    memcpy(glb + 4, head, sizeof head);
    memcpy(glb + 20, json, size);
    glb[20 + size - 1] = behind;
    write_file("c.gltf", glb, 20 + size);
}

static void headers_of_glb_are_checked(void **state)
{
    (void)state;
    static const char json[] = "{\"asset\":{\"version\":\"2.0\"}}";
    static const struct {
        uint32_t version;
        int64_t length;
        char behind;
        const char *text;
    } files[] = {
        {1, -1, ' ', "glTF 1.0"},
        {3, -1, ' ', "only 2 is known"},
        {2, 11, ' ', "the header says 11 bytes"},
        {2, 1000, ' ', "the header says 1000 bytes"},
        {2, -1, ' ', "no triangles in it"},
        {2, -1, '\t', "no triangles in it"},
        {2, -1, '\r', "no triangles in it"},
        {2, -1, '\n', "no triangles in it"},
        {2, -1, '\0', "no triangles in it"},
        {2, -1, 'x', ""},
    };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        struct memory memory;
        struct bvhd_error error;
        struct import import = {0};
        write_glb(files[i].version, files[i].length, json, files[i].behind);
        assert_int_not_equal(read_corner(&memory, &import, &error), BVHD_OK);
        if (!strstr(error.text, files[i].text))
            fail_msg("%zu: %s", i, error.text);
        assert_int_equal(memory.live, 0);
    }
}

static void a_directory_is_no_file(void **state)
{
    (void)state;
    struct memory memory;
    struct bvhd_error error = {0};
    struct import import = {0};
    assert_int_equal(mkdir("d.gltf", 0755), 0);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(import_read("d.gltf", NULL, &memory, &import, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.text, "not a file that can be read");
    assert_int_equal(memory.live, 0);
}

/* Memory outside of an arena, while arenas have none; NULL: they have. */
static const struct memory *outside;

void *__wrap_memory_alloc(struct memory *memory, uint64_t size);
void *__real_memory_alloc(struct memory *memory, uint64_t size);

void *__wrap_memory_alloc(struct memory *memory, uint64_t size)
{
    return outside && memory != outside ? NULL : __real_memory_alloc(memory, size);
}

static void an_arena_without_memory_fails(void **state)
{
    (void)state;
    static const char text[] = "[1,2,3]";
    struct gltf_arena arena = {0};
    const char *end = NULL;
    outside = &(struct memory){0};
    assert_null(gltf_arena_parse(&arena, text, sizeof text - 1, &end));
    assert_true(arena.failed);
    outside = NULL;
    gltf_arena_finish(&arena);
    arena = (struct gltf_arena){0};
    assert_non_null(gltf_arena_parse(&arena, text, UINT64_C(7), &end));
    assert_ptr_equal(end, text + 7);
    gltf_arena_finish(&arena);
}

/* What begins like a number, or has a number's place in no list, is no scene's number. */
static void scenes_are_chosen_by_number(void **state)
{
    (void)state;
    static const char *const wanted[] = {"!", "a", "0x", "1"};
    const struct corner corner = {.more = ",'scenes':[{'nodes':[0]}]"};
    struct memory memory;
    struct import import;
    write_file("b.bin", &data, sizeof data);
    write_corner(&corner);
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        struct bvhd_error error = {0};
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(import_read("c.gltf", wanted[i], &memory, &import, &error), BVHD_NOT_FOUND);
        assert_non_null(strstr(error.text, "it has no scene"));
    }
    assert_int_equal(import_read("c.gltf", "0", &memory, &import, NULL), BVHD_OK);
    assert_int_equal(import.triangle_count, 1);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

static void absolute_paths_have_no_folder(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    char *path = gltf_uri_path("folder/c.gltf", "/elsewhere/b.bin", &memory);
    assert_string_equal(path, "/elsewhere/b.bin");
    memory_free(&memory, path);
}

/* The JSON itself has no memory, and then the scene's name, primitives, and buffers in the file. */
static void files_without_memory(void **state)
{
    (void)state;
    char text[1000] =
        "{'asset':{'version':'2.0'},'buffers':[{'uri':'data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA',"
        "'byteLength':36}],'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[" POINTS
        "],'meshes':[{'primitives':[{'attributes':{'POSITION':0}},{'attributes':{'POSITION':0},'mode':3}]}],"
        "'nodes':[{'mesh':0}],'scenes':[{'nodes':[0],'name':'day'}]}";
    struct memory memory;
    struct import import;
    enum bvhd_status status = BVHD_NO_MEMORY;
    write_text("c.gltf", text);
    for (int64_t after = 0; status != BVHD_OK; after++) {
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = import_read_with_looks("c.gltf", "day", &memory, &import, NULL);
        assert_true((status == BVHD_OK || status == BVHD_NO_MEMORY) && after < 300);
        if (status == BVHD_OK)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
    }
    struct gltf_file file = {.path = "c.gltf"};
    struct import_files files;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    import_files_init(&files, &memory);
    file.memory = &memory;
    file.files = &files;
    file.error = &error;
    outside = &memory;
    status = gltf_file_open(&file);
    outside = NULL;
    gltf_file_close(&file);
    for (uint32_t i = 0; i < files.count; i++)
        memory_free(&memory, files.paths[i]);
    memory_free(&memory, files.paths);
    assert_int_equal(status, BVHD_NO_MEMORY);
    assert_int_equal(memory.live, 0);
}

/* cJSON takes memory from the reader's arena while it reads, and from malloc afterwards. */
static void other_json_is_not_in_the_arena(void **state)
{
    (void)state;
    struct memory memory;
    struct bvhd_error error;
    struct import import;
    write_file("b.bin", &data, sizeof data);
    write_corner(&corners[0]);
    assert_int_equal(read_corner(&memory, &import, &error), BVHD_OK);
    cJSON *json = cJSON_Parse("{\"a\":[1,2,3]}");
    assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(json, "a")), 3);
    cJSON_Delete(json);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corners_are_read_or_refused),    cmocka_unit_test(versions_are_checked),
        cmocka_unit_test(headers_of_glb_are_checked),     cmocka_unit_test(a_directory_is_no_file),
        cmocka_unit_test(other_json_is_not_in_the_arena), cmocka_unit_test(an_arena_without_memory_fails),
        cmocka_unit_test(files_without_memory),           cmocka_unit_test(scenes_are_chosen_by_number),
        cmocka_unit_test(absolute_paths_have_no_folder),  cmocka_unit_test(empty_names_become_numbers),
    };
    return cmocka_run_group_tests(tests, scratch_enter, scratch_remove);
}

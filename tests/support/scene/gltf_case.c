/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/gltf_case.h"

#include <math.h>
#include <meshoptimizer.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The BIN chunk, with a buffer view for each thing that is put into it. */
struct bin {
    uint8_t data[4096];
    size_t size;
    char views[8192];
    unsigned view_count;
};

static void put(struct bin *bin, const void *data, size_t size, const char *more)
{
    size_t used = strlen(bin->views);
    memcpy(bin->data + bin->size, data, size);
    snprintf(bin->views + used, sizeof bin->views - used, "%s{'buffer':0,'byteOffset':%zu,'byteLength':%zu%s}",
             bin->view_count++ ? "," : "", bin->size, size, more);
    bin->size = (bin->size + size + 3) & ~(size_t)3;
}

static void put_compressed(struct bin *bin, const void *data, size_t size, size_t count, size_t stride,
                           const char *name, const char *mode)
{
    size_t used = strlen(bin->views);
    memcpy(bin->data + bin->size, data, size);
    snprintf(bin->views + used, sizeof bin->views - used,
             ",{'buffer':1,'byteLength':%zu,'extensions':{'%s':{'buffer':0,'byteOffset':%zu,'byteLength':%zu,"
             "'count':%zu,'byteStride':%zu,%s}}}",
             count * stride, name, bin->size, size, count, stride, mode);
    bin->view_count++;
    bin->size = (bin->size + size + 3) & ~(size_t)3;
}

static const float quad[4][3] = {{0, 0, 0}, {2, 0, 0}, {2, 3, 0}, {0, 3, 0}};
static const uint32_t corners[6] = {0, 1, 2, 0, 2, 3};

/* Views 0 to 5: the quad as floats, its indices in each type, the quad in rows of 20 bytes, a strip. */
static void put_plain(struct bin *bin)
{
    static const uint16_t corners16[6] = {0, 1, 2, 0, 2, 3}, strip[4] = {0, 1, 3, 2};
    static const uint8_t corners8[6] = {0, 1, 2, 0, 2, 3};
    float rows[4][5];
    for (int i = 0; i < 4; i++) {
        rows[i][0] = rows[i][4] = 77;
        memcpy(rows[i] + 1, quad[i], sizeof quad[i]);
    }
    put(bin, quad, sizeof quad, "");
    put(bin, corners16, sizeof corners16, "");
    put(bin, corners8, sizeof corners8, "");
    put(bin, corners, sizeof corners, "");
    put(bin, rows, sizeof rows, ",'byteStride':20");
    put(bin, strip, sizeof strip, "");
}

/* Views 6 to 9: the quad as signed and unsigned integers of 8 and 16 bits, with 2 or 3 at the largest value. */
static void put_integers(struct bin *bin)
{
    static const int8_t bytes[4][4] = {{0, 0, 0, 9}, {2, 0, 0, 9}, {2, 3, 0, 9}, {0, 3, 0, 9}};
    static const uint8_t unsigned_bytes[4][4] = {{0, 0, 0, 9}, {255, 0, 0, 9}, {255, 255, 0, 9}, {0, 255, 0, 9}};
    static const int16_t shorts[4][4] = {{-32768, 0, 0, 9}, {32767, 0, 0, 9}, {32767, -32767, 0, 9}, {0, 0, 0, 9}};
    static const uint16_t unsigned_shorts[4][4] = {{0, 0, 0, 9}, {60000, 0, 0, 9}, {60000, 3, 0, 9}, {0, 3, 0, 9}};
    put(bin, bytes, sizeof bytes, ",'byteStride':4");
    put(bin, unsigned_bytes, sizeof unsigned_bytes, ",'byteStride':4");
    put(bin, shorts, sizeof shorts, ",'byteStride':8");
    put(bin, unsigned_shorts, sizeof unsigned_shorts, ",'byteStride':8");
}

/* Views 10 to 16: sparse indices and values, wrong indices, and the attributes of instances. */
static void put_others(struct bin *bin)
{
    static const uint16_t replaced[2] = {1, 2}, wrong[6] = {0, 1, 2, 0, 2, 9}, falling[2] = {2, 1};
    static const float values[2][3] = {{4, 0, 0}, {4, 5, 0}};
    static const float translations[3][3] = {{0, 0, 0}, {10, 0, 0}, {0, 0, -7}};
    static const int16_t rotations[3][4] = {{0, 0, 0, 32767}, {0, 0, 32767, 0}, {0, 0, 0, 32767}};
    const float scales[3][3] = {{1, 1, 1}, {1, 1, 1}, {NAN, 1, 1}};
    put(bin, replaced, sizeof replaced, "");
    put(bin, values, sizeof values, "");
    put(bin, wrong, sizeof wrong, "");
    put(bin, falling, sizeof falling, "");
    put(bin, translations, sizeof translations, "");
    put(bin, rotations, sizeof rotations, "");
    put(bin, scales, sizeof scales, "");
}

/*
 * Views 17 to 22: the quad, its indices and a strip by meshoptimizer; broken bytes; too many elements; a version of the
 * codec that does not exist yet.
 */
static void put_meshopt(struct bin *bin)
{
    static const unsigned char broken[40] = {0xa0, 1, 2, 3}, later[40] = {0xa2, 1, 2, 3};
    static const uint32_t strip[4] = {0, 1, 3, 2};
    unsigned char data[512];
    static const char ext[] = "EXT_meshopt_compression", khr[] = "KHR_meshopt_compression";
    meshopt_encodeVertexVersion(0);
    meshopt_encodeIndexVersion(1);
    size_t size = meshopt_encodeVertexBuffer(data, sizeof data, quad, 4, 12);
    put_compressed(bin, data, size, 4, 12, ext, "'mode':'ATTRIBUTES'");
    size = meshopt_encodeIndexBuffer(data, sizeof data, corners, 6);
    put_compressed(bin, data, size, 6, 4, khr, "'mode':'TRIANGLES','filter':'NONE'");
    size = meshopt_encodeIndexSequence(data, sizeof data, strip, 4);
    put_compressed(bin, data, size, 4, 2, ext, "'mode':'INDICES'");
    put_compressed(bin, broken, sizeof broken, 4, 12, ext, "'mode':'ATTRIBUTES'");
    put_compressed(bin, broken, sizeof broken, 1 << 20, 12, ext, "'mode':'ATTRIBUTES'");
    put_compressed(bin, later, sizeof later, 4, 12, ext, "'mode':'ATTRIBUTES'");
}

/*
 * Views 23 to 34: times; values of translations, rotations, rotations as integers, a cubic spline that is the square of
 * the time, weights; displacements; an index and a value of sparse ones; joints, weights, inverse bind matrices.
 */
static void put_animation(struct bin *bin)
{
    static const float times[3] = {0, 1, 3}, translations[3][3] = {{0, 0, 0}, {10, 0, 0}, {10, 0, -6}};
    static const float half = 0.70710678f, weights[3][2] = {{0, 0}, {1, 0}, {0.5f, 2}};
    const float rotations[3][4] = {{0, 0, 0, 1}, {0, 0, half, half}, {0, 0, 1, 0}};
    static const int16_t integers[3][4] = {{0, 0, 0, 32767}, {0, 0, 23170, 23170}, {0, 0, 32767, 0}};
    static const float spline[9][3] = {
        [4] = {1, 0, 0}, [3] = {2, 0, 0}, [5] = {2, 0, 0}, [6] = {6, 0, 0}, [7] = {9, 0, 0}};
    static const float lifts[4][3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}}, sparse[3] = {4, 5, 0};
    static const uint16_t sparse_index[1] = {2};
    static const uint8_t joints[4][4] = {{0}, {0}, {1}, {0, 1}};
    static const float shares[4][4] = {{1}, {1}, {1}, {0.25f, 0.25f}};
    static const float binds[2][16] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
                                       {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -3, 0, 1}};
    put(bin, times, sizeof times, "");
    put(bin, translations, sizeof translations, "");
    put(bin, rotations, sizeof rotations, "");
    put(bin, integers, sizeof integers, "");
    put(bin, spline, sizeof spline, "");
    put(bin, weights, sizeof weights, "");
    put(bin, lifts, sizeof lifts, "");
    put(bin, sparse_index, sizeof sparse_index, "");
    put(bin, sparse, sizeof sparse, "");
    put(bin, joints, sizeof joints, "");
    put(bin, shares, sizeof shares, "");
    put(bin, binds, sizeof binds, "");
}

/*
 * Views 35 to 43, each with a mistake: times that stand still, that are no numbers, that are negative; a joint that is
 * not there; weights that are all zero, or negative; weights as integers, without one; a value that is infinite; a
 * matrix that is not affine.
 */
static void put_mistakes(struct bin *bin)
{
    static const float equal[3] = {0, 1, 1}, negative[3] = {-1, 0, 1}, matrix[32] = {[3] = 1};
    const float nan[3] = {0, NAN, 2}, infinite[3][3] = {{0, 0, 0}, {0, INFINITY, 0}, {0, 0, 0}};
    static const uint8_t beyond[4][4] = {{0}, {0}, {1}, {0, 2}}, integers[4][4] = {{255}, {255}, {255}, {100, 100}};
    static const float zero[4][4] = {{1}, {0}, {1}, {1}}, below[4][4] = {{1}, {1}, {1}, {2, -1}};
    put(bin, equal, sizeof equal, "");
    put(bin, nan, sizeof nan, "");
    put(bin, negative, sizeof negative, "");
    put(bin, beyond, sizeof beyond, "");
    put(bin, zero, sizeof zero, "");
    put(bin, below, sizeof below, "");
    put(bin, integers, sizeof integers, "");
    put(bin, infinite, sizeof infinite, "");
    put(bin, matrix, sizeof matrix, "");
}

/* The accessors 10 to 30 of cases with animations: the views 23 to 43 in their order, 30 and 31 together. */
static const char animation_accessors[] =
    ",{'bufferView':23,'componentType':5126,'count':3,'type':'SCALAR'}"
    ",{'bufferView':24,'componentType':5126,'count':3,'type':'VEC3'}"
    ",{'bufferView':25,'componentType':5126,'count':3,'type':'VEC4'}"
    ",{'bufferView':26,'componentType':5122,'normalized':true,'count':3,'type':'VEC4'}"
    ",{'bufferView':27,'componentType':5126,'count':9,'type':'VEC3'}"
    ",{'bufferView':28,'componentType':5126,'count':6,'type':'SCALAR'}"
    ",{'bufferView':29,'componentType':5126,'count':4,'type':'VEC3'}"
    ",{'componentType':5126,'count':4,'type':'VEC3','sparse':{'count':1,"
    "'indices':{'bufferView':30,'componentType':5123},'values':{'bufferView':31}}}"
    ",{'bufferView':32,'componentType':5121,'count':4,'type':'VEC4'}"
    ",{'bufferView':33,'componentType':5126,'count':4,'type':'VEC4'}"
    ",{'bufferView':34,'componentType':5126,'count':2,'type':'MAT4'}"
    ",{'bufferView':35,'componentType':5126,'count':3,'type':'SCALAR'}"
    ",{'bufferView':36,'componentType':5126,'count':3,'type':'SCALAR'}"
    ",{'bufferView':37,'componentType':5126,'count':3,'type':'SCALAR'}"
    ",{'bufferView':38,'componentType':5121,'count':4,'type':'VEC4'}"
    ",{'bufferView':39,'componentType':5126,'count':4,'type':'VEC4'}"
    ",{'bufferView':40,'componentType':5126,'count':4,'type':'VEC4'}"
    ",{'bufferView':41,'componentType':5121,'normalized':true,'count':4,'type':'VEC4'}"
    ",{'bufferView':42,'componentType':5126,'count':3,'type':'VEC3'}"
    ",{'bufferView':43,'componentType':5126,'count':2,'type':'MAT4'}"
    ",{'bufferView':34,'componentType':5126,'count':1,'type':'MAT4'}";

/* The accessors that all cases have. 0 to 3: the quad and its indices. 4: rows. 5: a strip. 6 to 9: integers. */
static const char accessors[] =
    "{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3','min':[0,0,0],'max':[2,3,0]},"
    "{'bufferView':1,'componentType':5123,'count':6,'type':'SCALAR'},"
    "{'bufferView':2,'componentType':5121,'count':6,'type':'SCALAR'},"
    "{'bufferView':3,'componentType':5125,'count':6,'type':'SCALAR'},"
    "{'bufferView':4,'byteOffset':4,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':5,'componentType':5123,'count':4,'type':'SCALAR'},"
    "{'bufferView':6,'componentType':5120,'count':4,'type':'VEC3','min':[0,0,0],'max':[2,3,0]},"
    "{'bufferView':7,'componentType':5121,'normalized':true,'count':4,'type':'VEC3','min':[0,0,0],'max':[255,255,0]},"
    "{'bufferView':8,'componentType':5122,'normalized':true,'count':4,'type':'VEC3'},"
    "{'bufferView':9,'componentType':5123,'count':4,'type':'VEC3','min':[0,0,0],'max':[60000,3,0]}";

static void quote(char *text)
{
    for (; *text; text++)
        *text = *text == '\'' ? '"' : *text;
}

static void put32(uint8_t *at, size_t value)
{
    uint32_t word = (uint32_t)value;
    memcpy(at, &word, sizeof word);
}

size_t gltf_case_pack(const char *json, const uint8_t *bin, size_t bin_size, uint8_t ret_bytes[GLTF_CASE_ROOM])
{
    size_t length = strlen(json), padded = (length + 3) & ~(size_t)3, bin_padded = (bin_size + 3) & ~(size_t)3;
    size_t size = 12 + 8 + padded + (bin_size ? 8 + bin_padded : 0);
    if (size > GLTF_CASE_ROOM)
        abort();
    memset(ret_bytes, ' ', size);
    memcpy(ret_bytes, "glTF\2\0\0", 8);
    put32(ret_bytes + 8, size);
    put32(ret_bytes + 12, padded);
    memcpy(ret_bytes + 16, "JSON", 4);
    snprintf((char *)ret_bytes + 20, length + 1, "%s", json);
    quote((char *)ret_bytes + 20);
    ret_bytes[20 + length] = padded > length || bin_size ? ' ' : ret_bytes[20 + length];
    if (bin_size) {
        put32(ret_bytes + 20 + padded, bin_padded);
        memcpy(ret_bytes + 24 + padded, "BIN", 4);
        memcpy(ret_bytes + 28 + padded, bin, bin_size);
    }
    return size;
}

static const char * or (const char *text, const char *fallback)
{
    return text ? text : fallback;
}

size_t gltf_case_make(const struct gltf_case *gltf_case, uint8_t ret_bytes[GLTF_CASE_ROOM])
{
    struct bin bin = {0};
    char json[GLTF_CASE_ROOM];
    put_plain(&bin);
    put_integers(&bin);
    put_others(&bin);
    put_meshopt(&bin);
    if (gltf_case->is_animated) {
        put_animation(&bin);
        put_mistakes(&bin);
    }
    snprintf(json, sizeof json,
             "{'asset':{'version':'2.0'},%s%s'nodes':[%s],'meshes':[{'name':'mesh','primitives':[%s]}],"
             "'buffers':[{'byteLength':%zu},{'byteLength':999999}],'bufferViews':[%s%s],'accessors':[%s%s%s]}",
             or (gltf_case->scenes, "'scene':0,'scenes':[{'nodes':[0]}],"), or (gltf_case->more, ""),
             or (gltf_case->nodes, "{'mesh':0}"),
             or (gltf_case->primitives, "{'attributes':{'POSITION':0},'indices':1}"), bin.size, bin.views,
             or (gltf_case->views, ""), accessors, gltf_case->is_animated ? animation_accessors : "",
             or (gltf_case->accessors, ""));
    return gltf_case_pack(json, bin.data, bin.size, ret_bytes);
}

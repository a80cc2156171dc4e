// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_structure.glsl - reads portable structures in a shader: their sections and rows. FORMATS.md, chapter 2,
 * describes the bytes.
 *
 * The including shader declares where structures are, before it includes this:
 *
 *   BVHD_BUFFER_ADDRESS    if defined, they are found by device addresses. That needs the extensions
 *                          GL_EXT_buffer_reference and GL_EXT_buffer_reference_uvec2, and bufferDeviceAddress enabled.
 *   otherwise              the whole scene is one storage buffer, which is declared twice at the same set and binding:
 *     BVHD_STORAGE_ROWS    a readonly array of uvec4 over it
 *     BVHD_STORAGE_WORDS   a readonly array of uint over it
 *
 *     layout(set = 0, binding = 0, std430) readonly buffer SceneRows { uvec4 scene_rows[]; };
 *     layout(set = 0, binding = 0, std430) readonly buffer SceneWords { uint scene_words[]; };
 *     #define BVHD_STORAGE_ROWS scene_rows
 *     #define BVHD_STORAGE_WORDS scene_words
 *
 * A location is 64 bits in a uvec2, low half first: the device address of a structure's body, or the byte offset of the
 * body in the buffer. An instance's record contains the location of its bottom level, which the loader has written; all
 * ones mean that there is none.
 */
#ifndef BVHD_STRUCTURE_GLSL
#define BVHD_STRUCTURE_GLSL

const uint BVHD_CONTENT_INDEXED_TRIANGLES = 0u;
const uint BVHD_CONTENT_TRIANGLES = 1u;
const uint BVHD_CONTENT_AABBS = 2u;
const uint BVHD_CONTENT_INSTANCES = 3u;
const uint BVHD_CONTENT_SPHERES = 4u;
const uint BVHD_CONTENT_SWEPT_SPHERES = 5u;
const uint BVHD_CONTENT_MOVING_TRIANGLES = 6u;
const uint BVHD_CONTENT_MOVING_INSTANCES = 7u;

const uvec2 BVHD_NO_LOCATION = uvec2(0xffffffffu);

const uint BVHD_ID_MASK = 0x1fffffffu; // the bits of a record's id that are the flat primitive index
const uint BVHD_ID_OPAQUE = 0x80000000u;

// How many rows a node of a body has, and the body at a location as a query sees it, at its time.
#ifdef BVHD_MOTION
#define BVHD_NODE_ROWS(body) (body.moves ? 8u : 5u)
#define BVHD_BODY_SEEN(query, location, extent) bvhdBodyAtTime(location, query.time, extent)
#else
#define BVHD_NODE_ROWS(body) 5u
#define BVHD_BODY_SEEN(query, location, extent) bvhdBodyOpen(location, extent)
#endif

// Rows have 16 bytes. Sections are given in rows, from `base` (addresses) or from the buffer's start.
#ifdef BVHD_BUFFER_ADDRESS
#define BvhdBase uvec2
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer BvhdRows {
    uvec4 row[];
};
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer BvhdWords {
    uint word[];
};
#else
#define BvhdBase uint
#endif

uvec4 bvhdRow(BvhdBase base, uint row)
{
#ifdef BVHD_BUFFER_ADDRESS
    return BvhdRows(base).row[row];
#else
    return BVHD_STORAGE_ROWS[row];
#endif
}

uint bvhdWord(BvhdBase base, uint word)
{
#ifdef BVHD_BUFFER_ADDRESS
    return BvhdWords(base).word[word];
#else
    return BVHD_STORAGE_WORDS[word];
#endif
}

uint bvhdRowOfOffset(uvec2 offset)
{
    return offset.x >> 4 | offset.y << 28;
}

// The fields of a structure's header that traversal uses.
struct BvhdBody {
    BvhdBase base;
    uint content;
    uint nodes; // rows
    uint records; // rows
    uint vertices; // words
#ifdef BVHD_MOTION
    /*
     * Of a structure that moves, `content` is that of its kind that does not: indexed triangles or instances. The
     * functions below show it as it is at `time`.
     */
    bool moves;
    float time;
#endif
};

// The fields that are used only when a ray enters the structure.
struct BvhdExtent {
    vec3 lowest, highest;
    bool isEmpty;
};

#ifdef BVHD_BUFFER_ADDRESS
BvhdBase bvhdBase(uvec2 location)
{
    return location;
}
uint bvhdFirstRow(BvhdBase base)
{
    return 0u;
}
#else
BvhdBase bvhdBase(uvec2 location)
{
    return bvhdRowOfOffset(location);
}
uint bvhdFirstRow(BvhdBase base)
{
    return base;
}
#endif

BvhdBody bvhdBodyOpen(uvec2 location, out BvhdExtent extent)
{
    BvhdBody body;
    body.base = bvhdBase(location);
    uint first = bvhdFirstRow(body.base);
    uvec4 bounds = bvhdRow(body.base, first + 1u), counts = bvhdRow(body.base, first + 2u);
    uvec4 sections = bvhdRow(body.base, first + 4u);
    body.content = bvhdRow(body.base, first).z;
    body.nodes = first + bvhdRowOfOffset(sections.xy);
    body.records = first + bvhdRowOfOffset(sections.zw);
    body.vertices = (first + bvhdRowOfOffset(bvhdRow(body.base, first + 5u).xy)) << 2;
    extent.lowest = uintBitsToFloat(bounds.xyz);
    extent.highest = uintBitsToFloat(uvec3(bounds.w, counts.xy));
    extent.isEmpty = counts.w == 0u;
#ifdef BVHD_MOTION
    body.moves = body.content >= BVHD_CONTENT_MOVING_TRIANGLES;
    body.time = 0.0;
    if (body.moves)
        body.content =
            body.content == BVHD_CONTENT_MOVING_TRIANGLES ? BVHD_CONTENT_INDEXED_TRIANGLES : BVHD_CONTENT_INSTANCES;
#endif
    return body;
}

#ifdef BVHD_MOTION
BvhdBody bvhdBodyAtTime(uvec2 location, float time, out BvhdExtent extent)
{
    BvhdBody body = bvhdBodyOpen(location, extent);
    body.time = time;
    return body;
}

// Numbers between those at t = 0 and at t = 1. Each operation is rounded once, so that all who compute them agree.
vec4 bvhdAtTime(vec4 start, vec4 end, float time)
{
    precise float rest = 1.0 - time;
    precise vec4 first = start * rest;
    precise vec4 second = end * time;
    precise vec4 sum = first + second;
    return sum;
}

// The vertex of motion triangles at the body's time. A vertex has two places.
vec3 bvhdMovingVertex(BvhdBody body, uint vertex)
{
    uint word = body.vertices + 6u * vertex;
    uvec3 start = uvec3(bvhdWord(body.base, word), bvhdWord(body.base, word + 1u), bvhdWord(body.base, word + 2u));
    uvec3 end = uvec3(bvhdWord(body.base, word + 3u), bvhdWord(body.base, word + 4u), bvhdWord(body.base, word + 5u));
    return bvhdAtTime(vec4(uintBitsToFloat(start), 0.0), vec4(uintBitsToFloat(end), 0.0), body.time).xyz;
}
#endif

vec3 bvhdVertex(BvhdBody body, uint vertex)
{
#ifdef BVHD_MOTION
    if (body.moves)
        return bvhdMovingVertex(body, vertex);
#endif
    uint word = body.vertices + 3u * vertex;
    return uintBitsToFloat(
        uvec3(bvhdWord(body.base, word), bvhdWord(body.base, word + 1u), bvhdWord(body.base, word + 2u)));
}

// The exact corners of a triangle record. Returns its id.
uint bvhdCorners(BvhdBody body, uint record, out vec3 v0, out vec3 v1, out vec3 v2)
{
    if (body.content == BVHD_CONTENT_INDEXED_TRIANGLES) {
        uvec4 row = bvhdRow(body.base, body.records + record);
        v0 = bvhdVertex(body, row.x);
        v1 = bvhdVertex(body, row.y);
        v2 = bvhdVertex(body, row.z);
        return row.w;
    }
    uint row = body.records + 3u * record;
    uvec4 first = bvhdRow(body.base, row);
    v0 = uintBitsToFloat(first.xyz);
    v1 = uintBitsToFloat(bvhdRow(body.base, row + 1u).xyz);
    v2 = uintBitsToFloat(bvhdRow(body.base, row + 2u).xyz);
    return first.w;
}

// The box of an AABB record. Returns its id.
uint bvhdAabb(BvhdBody body, uint record, out vec3 lowest, out vec3 highest)
{
    uint row = body.records + 2u * record;
    uvec4 first = bvhdRow(body.base, row);
    lowest = uintBitsToFloat(first.xyz);
    highest = uintBitsToFloat(bvhdRow(body.base, row + 1u).xyz);
    return first.w;
}

#ifdef BVHD_ROUND
const uint BVHD_ID_CAP_FIRST = 0x20000000u; // a linear swept sphere's first end has a cap
const uint BVHD_ID_CAP_SECOND = 0x40000000u;

bool bvhdIsRound(BvhdBody body)
{
    return body.content == BVHD_CONTENT_SPHERES || body.content == BVHD_CONTENT_SWEPT_SPHERES;
}

// The ends of a record of a sphere, whose two ends are the same, or of a linear swept sphere: a centre, and the radius
// in w. Returns its id.
uint bvhdEnds(BvhdBody body, uint record, out vec4 ends[2])
{
    uint word = (body.records << 2) + 2u * record, first = (body.vertices >> 2) + bvhdWord(body.base, word);
    ends[0] = uintBitsToFloat(bvhdRow(body.base, first));
    ends[1] = ends[0];
    if (body.content == BVHD_CONTENT_SWEPT_SPHERES)
        ends[1] = uintBitsToFloat(bvhdRow(body.base, first + 1u));
    return bvhdWord(body.base, word + 1u);
}
#endif

// The id of a record of primitives.
uint bvhdId(BvhdBody body, uint record)
{
#ifdef BVHD_ROUND
    if (bvhdIsRound(body))
        return bvhdWord(body.base, (body.records << 2) + 2u * record + 1u);
#endif
    uint rows = body.content == BVHD_CONTENT_AABBS ? 2u : body.content == BVHD_CONTENT_TRIANGLES ? 3u : 1u;
    return bvhdRow(body.base, body.records + rows * record).w;
}

struct BvhdInstance {
    uint customIndex, mask, sbtOffset, flags; // flags: VkGeometryInstanceFlagsKHR
    uint index; // position in the request
    uvec2 bottom; // location
};

BvhdInstance bvhdInstance(BvhdBody top, uint record)
{
#ifdef BVHD_MOTION
    uint row = top.records + (top.moves ? 10u : 8u) * record;
    uvec4 words = bvhdRow(top.base, top.moves ? row : row + 6u);
    words = top.moves ? words.yzwx : words;
#else
    uint row = top.records + 8u * record;
    uvec4 words = bvhdRow(top.base, row + 6u);
#endif
    BvhdInstance instance;
    instance.customIndex = words.x & 0xffffffu;
    instance.mask = words.x >> 24;
    instance.sbtOffset = words.y & 0xffffffu;
    instance.flags = words.y >> 24;
    instance.index = words.z;
#ifdef BVHD_MOTION
    instance.bottom = top.moves ? bvhdRow(top.base, row + 1u).zw : bvhdRow(top.base, row + 7u).xy;
#else
    instance.bottom = bvhdRow(top.base, row + 7u).xy;
#endif
    return instance;
}

// A row-major 3x4 matrix as three rows: object to world (first = 0), or world to object (first = 3). Motion instances
// have no such rows: bvhd_motion.glsl computes their matrices.
void bvhdMatrix(BvhdBody top, uint record, uint first, out vec4 x, out vec4 y, out vec4 z)
{
    uint row = top.records + 8u * record + first;
    x = uintBitsToFloat(bvhdRow(top.base, row));
    y = uintBitsToFloat(bvhdRow(top.base, row + 1u));
    z = uintBitsToFloat(bvhdRow(top.base, row + 2u));
}

// Returns (geometry, primitive index in it) of a flat primitive index: the last row whose first primitive is not above
// it.
uvec2 bvhdGeometryOf(BvhdBody body, uint flatIndex)
{
    uint header = bvhdFirstRow(body.base);
    uint geometries = header + bvhdRowOfOffset(bvhdRow(body.base, header + 5u).zw), low = 0u,
         high = bvhdRow(body.base, header + 3u).z;
    while (high - low > 1u) {
        uint middle = (low + high) >> 1;
        if (bvhdRow(body.base, geometries + middle).y <= flatIndex)
            low = middle;
        else
            high = middle;
    }
    return uvec2(low, flatIndex - bvhdRow(body.base, geometries + low).y);
}

#endif

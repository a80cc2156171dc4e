/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/scene_case.h"

/* clang-format off */
#define TRIANGLE_BYTES "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\200\77\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\100\0\0\0\0"
#define BASE64 "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"
#define GEOMETRY "'nodes':[{'mesh':0}],'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}]," \
    "'bufferViews':[{'buffer':0,'byteLength':36}]," \
    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}]"
#define GLTF(uri) "{'asset':{'version':'2.0'}," GEOMETRY ",'buffers':[{'byteLength':36,'uri':'" uri "'}]}"
#define ONE .triangles = 1, .high = {1, 2, 0}
#define DRACO(type) "{'asset':{'version':'2.0'},'extensionsUsed':['KHR_draco_mesh_compression'],'nodes':[{'mesh':0}]," \
    "'scene':0,'scenes':[{'nodes':[0]}],'meshes':[{'primitives':[{'attributes':{'POSITION':0},'indices':1," \
    "'extensions':{'KHR_draco_mesh_compression':{'bufferView':0,'attributes':{'POSITION':0}}}}]}]," \
    "'bufferViews':[{'buffer':0,'byteLength':82}]," \
    "'accessors':[{'componentType':5126,'count':4,'type':'VEC3','min':[0,0,0],'max':[2,3,0]}," \
    "{'componentType':" type ",'count':6,'type':'SCALAR'}]," \
    "'buffers':[{'byteLength':82,'uri':'data:application/octet-stream;base64,RFJBQ08CAgEBAAAABAIAAgAAAR//AREB/" \
    "wAAAQAJAwAAAAAAAAAAAAAAAAAAAAAAAEAAAEBAAAAAAAAAAAAAAEBAAAAAAAAAAEAAAAAAAAAAAA=='}]}"

#define HEAD "ply\nformat ascii 1.0\n"
#define POINTS "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
#define FACES "element face 2\nproperty list uchar int vertex_indices\n"
#define END "end_header\n"
#define ROWS "0 0 0\n1 0 0\n0 2 0\n"
#define BROKEN(name_, text_, error_) \
    {.format = "PLY", .name = name_, .file = "case.ply", .text = text_, .status = BVHD_INVALID, .error = error_}
#define UNSUPPORTED(name_, text_, error_) \
    {.format = "PLY", .name = name_, .file = "case.ply", .text = text_, .status = BVHD_UNSUPPORTED, .error = error_}
#define QUAD "v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\n"
#define FACET(a, b, c) "facet normal 0 0 1\nouter loop\nvertex " a "\nvertex " b "\nvertex " c "\nendloop\nendfacet\n"

const struct scene_text scene_texts[] = {
    /* glTF as text, and what surrounds it. */
    {.format = "glTF", .name = "data: URI, base64", .file = "case.gltf", .text = GLTF("data:;base64," BASE64), ONE},
    {.format = "glTF", .name = "data: URI with a type", .file = "case.gltf",
     .text = GLTF("data:application/octet-stream;base64," BASE64), ONE},
    {.format = "glTF", .name = "data: URI, percent-encoded", .file = "case.gltf",
     .text = GLTF("data:,%00%00%00%00%00%00%00%00%00%00%00%00%00%00%80%3f%00%00%00%00%00%00%00%00%00%00%00%00%00%00%00@"
                  "%00%00%00%00"), ONE},
    {.format = "glTF", .name = "data: URI that is no base64", .file = "case.gltf", .text = GLTF("data:;base64,????"),
     .status = BVHD_INVALID, .error = "buffers[0].uri: not a data: URI"},
    {.format = "glTF", .name = "buffer in a file", .file = "case.gltf", .text = GLTF("case.bin"), .second = "case.bin",
     .second_bytes = TRIANGLE_BYTES, .second_size = 36, ONE},
    {.format = "glTF", .name = "percent-encoded file name", .file = "case.gltf", .text = GLTF("a%20b%25.bin"),
     .second = "a b%.bin", .second_bytes = TRIANGLE_BYTES, .second_size = 36, ONE},
    {.format = "glTF", .name = "file that is too short", .file = "case.gltf", .text = GLTF("case.bin"),
     .second = "case.bin", .second_bytes = TRIANGLE_BYTES, .second_size = 20, .status = BVHD_INVALID,
     .error = "buffers[0].byteLength: 36 bytes, but only 20 are there"},
    {.format = "glTF", .name = "file that is missing", .file = "case.gltf", .text = GLTF("none.bin"),
     .status = BVHD_NOT_FOUND, .error = "none.bin"},
    {.format = "glTF", .name = "URI of another machine", .file = "case.gltf", .text = GLTF("https://example.org/a.bin"),
     .status = BVHD_UNSUPPORTED, .error = "buffers[0].uri: only files and data: URIs"},
    {.format = "glTF", .name = "material of a colour", .file = "case.gltf", ONE,
     .text = "{'asset':{'version':'2.0'},'materials':[{'pbrMetallicRoughness':{'baseColorFactor':[1,0.5,0,1]}}],"
     "'nodes':[{'mesh':0}],'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}],"
     "'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[{'bufferView':0,'componentType':5126,'count':3,"
     "'type':'VEC3'}],'buffers':[{'byteLength':36,'uri':'data:;base64," BASE64 "'}]}"},
    {.format = "glTF", .name = "Draco, indices of 8 bits", .file = "case.gltf", .text = DRACO("5121"), .triangles = 2,
     .high = {2, 3, 0}},
    {.format = "glTF", .name = "Draco, indices of 16 bits", .file = "case.gltf", .text = DRACO("5123"), .triangles = 2,
     .high = {2, 3, 0}},
    {.format = "glTF", .name = "Draco, indices of 32 bits", .file = "case.gltf", .text = DRACO("5125"),
     .status = BVHD_UNSUPPORTED, .error = "KHR_draco_mesh_compression with indices of 32 bits, which assimp does not"},
    {.format = "glTF", .name = "version 1, by assimp", .file = "case.gltf", ONE,
     .text = "{'asset':{'version':'1.0'},'scene':'s','scenes':{'s':{'nodes':['n']}},'nodes':{'n':{'meshes':['m']}},"
     "'meshes':{'m':{'primitives':[{'attributes':{'POSITION':'a'},'indices':'i','mode':4}]}},'accessors':{"
     "'a':{'bufferView':'v','byteOffset':0,'byteStride':0,'componentType':5126,'count':3,'type':'VEC3'},"
     "'i':{'bufferView':'w','byteOffset':0,'byteStride':0,'componentType':5123,'count':3,'type':'SCALAR'}},"
     "'bufferViews':{'v':{'buffer':'b','byteOffset':0,'byteLength':36},'w':{'buffer':'b','byteOffset':36,"
     "'byteLength':6}},'buffers':{'b':{'byteLength':44,'type':'arraybuffer',"
     "'uri':'data:application/octet-stream;base64," BASE64 "AAABAAIAAAA='}}}"},
    {.format = "glTF", .name = "version 3", .file = "case.gltf", .text = "{'asset':{'version':'3.0'}}",
     .status = BVHD_UNSUPPORTED, .error = "asset.version: '3.0', but only 2.0"},
    {.format = "glTF", .name = "no version", .file = "case.gltf", .text = "{'meshes':[]}", .status = BVHD_UNSUPPORTED,
     .error = "asset.version: missing"},
    {.format = "glTF", .name = "text that is cut off", .file = "case.gltf", .text = "{'asset':{'version':'2.0'},",
     .status = BVHD_UNSUPPORTED, .error = "JSON"},
    {.format = "glTF", .name = "no JSON", .file = "case.gltf", .text = "solid x", .status = BVHD_UNSUPPORTED,
     .error = "the JSON is not complete"},
    {.format = "glTF", .name = "GLB that is cut off", .file = "case.glb", .text = "glTF\2\0\0\0\24\0\0\0", .size = 12,
     .status = BVHD_UNSUPPORTED, .error = "GLB: the header says 20 bytes, the file has 12"},

    /* PLY that is not as it should be. */
    {.format = "PLY", .name = "NaN and infinity", .file = "case.ply", .triangles = 2, .high = {1, 2, 0},
     .text = HEAD "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n" FACES END ROWS
     "nan 0 0\n0 -inf 0\n3 0 1 2\n3 0 1 2\n"},
    {.format = "PLY", .name = "polygon that crosses itself", .file = "case.ply", .triangles = 5, .high = {4, 4, 0},
     .text = HEAD "element vertex 7\nproperty float x\nproperty float y\nproperty float z\n"
     "element face 1\nproperty list uchar int vertex_indices\n" END
     "0 0 0\n4 0 0\n4 4 0\n0 4 0\n2 1 0\n1 3 0\n3 2 0\n7 0 2 3 6 5 4 1\n",
     .counts = {.fanned = 1}},
    {.format = "PLY", .name = "bytes after the data", .file = "case.ply", ONE,
     .text = HEAD POINTS "element face 1\nproperty list uchar int vertex_indices\n" END ROWS "3 0 1 2\nmore",
     .counts = {.extra_bytes = 4}},
    {.format = "PLY", .name = "unknown line of the header", .file = "case.ply", ONE,
     .text = HEAD "made by hand\n" POINTS "element face 1\nproperty list uchar int vertex_indices\n" END ROWS
     "3 0 1 2\n",
     .counts = {.unknown_lines = 1}},
    BROKEN("point cloud", HEAD POINTS END ROWS, "point cloud of 3 vertices"),
    BROKEN("point cloud with radii", HEAD POINTS "property float radius\n" END "0 0 0 1\n1 0 0 0\n0 1 0 2\n",
           "point cloud of 3 vertices"),
    BROKEN("only lines", HEAD POINTS FACES END ROWS "2 0 1\n0\n", "only 0 points, 1 lines and 1 empty faces"),
    BROKEN("corner beyond the vertices", HEAD POINTS FACES END ROWS "3 0 1 2\n3 0 1 3\n",
           "corner 2 of face 1 is vertex 3, but there are only 3"),
    BROKEN("negative corner", HEAD POINTS FACES END ROWS "3 0 -1 2\n3 0 1 2\n", "corner 1 of face 0 is vertex -1"),
    BROKEN("corner that is no number", HEAD POINTS FACES END ROWS "3 0 x 2\n3 0 1 2\n", "in line 13, has a value that"),
    BROKEN("list that is too long", HEAD POINTS FACES END ROWS "200 0 1 2\n3 0 1 2\n", "of 200 values"),
    BROKEN("row with too many values", HEAD POINTS FACES END ROWS "3 0 1 2 7\n3 0 1 2\n", "line 13, has more values"),
    BROKEN("row with too few values", HEAD POINTS FACES END "0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n", "has more values"),
    BROKEN("data that are cut off", HEAD POINTS FACES END ROWS "3 0 1 2\n", "cut off in face 1 of 2"),
    BROKEN("header that is cut off", HEAD POINTS FACES "end_heade", "cut off in the header, in line 9"),
    BROKEN("number of rows that is a lie",
           HEAD "element vertex 9999999\nproperty int x\nproperty int y\nproperty int z\n" FACES END ROWS,
           "9999999 rows of 'vertex', but the file has room for 3 at most"),
    BROKEN("no coordinate z", HEAD "element vertex 1\nproperty int x\nproperty int y\n" FACES END,
           "its vertices have no 'z'"),
    BROKEN("two elements of one name", HEAD POINTS POINTS END, "element 'vertex' is in the header twice"),
    BROKEN("no format", "ply\n" POINTS FACES END, "has no format"),
    UNSUPPORTED("unknown format", "ply\nformat binary_middle_endian 1.0\n" END, "no format 'binary_middle_endian'"),
    UNSUPPORTED("unknown version", "ply\nformat ascii 2.0\n" END, "version 2.0"),
    UNSUPPORTED("unknown type", HEAD POINTS "property quad w\n" END, "no type 'quad'"),
    UNSUPPORTED("faces without vertices", HEAD POINTS "element face 1\nproperty list uchar int corners\n" END,
                "'vertex_indices'"),

    /* Files that assimp reads. */
    {.format = "OBJ", .name = "quad", .file = "case.obj", .text = QUAD "f 1 2 3 4\n", .triangles = 2,
     .high = {2, 3, 0}},
    {.format = "OBJ", .name = "concave polygon", .file = "case.obj", .triangles = 3, .high = {4, 4, 0},
     .text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\n"},
    {.format = "OBJ", .name = "polygon that crosses itself", .file = "case.obj", .triangles = 3, .may_lose = true,
     .text = "v 0 0 0\nv 4 4 0\nv 4 0 0\nv 0 4 0\nv 2 1 0\nf 1 2 3 4 5\n", .high = {4, 4, 0}},
    {.format = "OBJ", .name = "indices from the end", .file = "case.obj", .text = QUAD "f -4 -3 -2\n", .triangles = 1,
     .high = {2, 3, 0}},
    {.format = "OBJ", .name = "points and lines", .file = "case.obj", .text = QUAD "f 1 2 3\nl 1 2\np 4\n",
     .triangles = 1, .high = {2, 3, 0}, .counts = {.points = 1, .lines = 1}},
    {.format = "OBJ", .name = "normals and texture coordinates", .file = "case.obj", .triangles = 2, .high = {2, 3, 0},
     .text = QUAD "vt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\nf 1/2/1 3/2/1 4/1/1\n"},
    {.format = "OBJ", .name = "two objects", .file = "case.obj", .triangles = 2, .instances = 2, .high = {9, 3, 0},
     .text = "o a\n" QUAD "f 1 2 3\no b\nv 9 0 0\nf 1 2 5\n"},
    {.format = "OBJ", .name = "nothing but points and lines", .file = "case.obj", .text = QUAD "p 1\np 2\nl 1 2\n",
     .status = BVHD_INVALID, .error = "no triangles in it, only 2 points, 1 lines"},
    {.format = "OBJ", .name = "index beyond the vertices", .file = "case.obj", .text = QUAD "f 1 2 9\n",
     .status = BVHD_UNSUPPORTED, .error = "vertex index out of range"},
    {.format = "OFF", .name = "triangle and pentagon", .file = "case.off", .triangles = 4, .high = {4, 5, 0},
     .text = "OFF\n5 2 0\n0 0 0\n4 0 0\n4 4 0\n2 5 0\n0 4 0\n3 0 1 2\n5 0 1 2 3 4\n"},
    {.format = "STL", .name = "text", .file = "case.stl", .triangles = 2, .high = {2, 3, 0},
     .text = "solid x\n" FACET("0 0 0", "2 0 0", "2 3 0") FACET("0 0 0", "2 3 0", "0 3 0") "endsolid x\n"},
    {.format = "STL", .name = "no bytes", .file = "case.stl", .text = "", .status = BVHD_UNSUPPORTED, .error = ""},
    {.format = "BVH", .name = "bones without a mesh", .file = "case.bvh", .status = BVHD_INVALID,
     .error = "no triangles in it",
     .text = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\nEnd Site\n{\nOFFSET 0 5 "
     "0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"},
    {.format = "SMD", .name = "16 bytes that keep assimp 5.2 busy", .file = "case.smd", .text = "version 1\n\nnodes",
     .status = BVHD_UNSUPPORTED, .error = "", .is_endless = true},
    {.format = "?", .name = "unknown ending", .file = "case.unknown", .text = "???", .status = BVHD_UNSUPPORTED,
     .error = ""},
};
const uint32_t scene_text_count = sizeof scene_texts / sizeof *scene_texts;
/* clang-format on */

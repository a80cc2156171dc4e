/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import.h - reads a scene file, as the input of builds: PLY and glTF by readers of our own (ply.h, gltf.h), other
 * formats with assimp.
 *
 * Faces are triangulated. Axes and units stay, nothing is dropped, and NaN and degenerate triangles survive. Vertices
 * of what assimp reads are welded (weld.h); those of PLY and glTF stay as they are. What is left out is counted
 * (import_counts.h). There is one bottom level for each distinct list of meshes that some node has, with one geometry
 * for each mesh. If some of these meshes are of points or lines, there is one for each shape, because Vulkan wants
 * geometries of one type in a bottom level. Nodes with meshes become instances, in depth-first order, one for each of
 * these bottom levels.
 */
#ifndef BVHCTL_IMPORT_H
#define BVHCTL_IMPORT_H

#include "proto/base/memory.h"
#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/scene/import_counts.h"
#include "client/bvhctl/scene/import_look.h"
#include "client/bvhctl/scene/import_names.h"
#include "proto/base/status.h"

/* What the primitives of a mesh are. Points become spheres, and lines become linear swept spheres. */
enum import_shape { IMPORT_TRIANGLES, IMPORT_POINTS, IMPORT_LINES, IMPORT_SHAPES };

enum { IMPORT_CAP_FIRST = 1, IMPORT_CAP_SECOND = 2 };

struct import_mesh {
    char *name, *material; /* may be "" */
    enum import_shape shape;
    bool has_colour;
    float colour[3]; /* the base colour of the material, linear, 0 to 1 */
    float *positions; /* xyz each; never NULL; of a shutter interval at its beginning */
    float *end_positions; /* of motion triangles: xyz each, at the end of the interval; else NULL */
    float *radii; /* of points and lines: one for each vertex, finite and not negative; else NULL */
    uint8_t *caps; /* of lines: the ends of each that have a cap, IMPORT_CAP_; else NULL */
    /*
     * three a triangle, two a line, one a point; each < vertex_count; never NULL. Point i is vertex i, and a line is
     * from a vertex to the next one, as import_round.h has ordered them
     */
    uint32_t *indices;
    uint32_t vertex_count, primitive_count;
    struct import_look look; /* all zero, unless it was asked for */
    struct import_counts counts; /* of its faces, bones and morph targets */
};

struct import_bottom {
    char *name; /* that of its mesh if it has only one, else that of the first node that has it; may be "" */
    uint32_t *meshes; /* all of one shape */
    uint32_t mesh_count;
};

struct import_instance {
    uint32_t bottom;
    uint32_t name; /* of its node, among node_names */
    /*
     * row-major 3x4, object to world; products of the nodes' matrices in double, rounded once. Of a shutter interval it
     * is that of its beginning
     */
    float transform[12];
    /*
     * its matrix has no inverse, which breaks a rule of Vulkan (VUID-VkTransformMatrixKHR-matrix-03799). The instance
     * keeps its position and is inactive
     */
    bool skipped;
    uint32_t motion; /* its motion over the shutter interval among `motions` + 1; 0: it stands still */
};

/* How an instance moves between both ends of a shutter interval. Each of the numbers moves in a straight line. */
struct import_motion {
    enum oracle_motion kind; /* ORACLE_MATRIX: 12 numbers count, or ORACLE_SRT: 16, those of VkSRTDataNV */
    float start[16], end[16];
};

/* The greatest distance of a point of a scene from where its animation has it. */
struct import_deviation {
    double distance; /* 0: there is none */
    double time; /* when, in seconds */
    uint32_t which; /* the name of its node, among node_names, or its mesh */
};

/* The reader that has read a file. */
enum import_reader { IMPORT_BY_ASSIMP, IMPORT_BY_PLY, IMPORT_BY_GLTF };

struct import {
    char *name; /* the file's name without directory and extension */
    struct import_mesh *meshes;
    struct import_bottom *bottoms;
    struct import_instance *instances;
    struct import_names node_names;
    char **files; /* all files that were read, in order */
    uint32_t mesh_count, bottom_count, instance_count, file_count;
    uint64_t skipped_instances;
    uint64_t triangle_count, point_count, line_count; /* over all meshes; points and lines that are read */
    struct import_counts counts; /* those of all meshes, and those of the file */
    bool wants_looks; /* the looks of meshes and the images are read, too: */
    struct import_image *images;
    uint32_t image_count;
    uint64_t looks_left_out; /* images and attributes that could not be read */
    struct bvhd_error look_error; /* why the first of them could not; its status is BVHD_OK if there is none */
    bool has_source; /* it is one chosen scene of the file: */
    uint32_t source_number; /* its number, from 0 */
    char *source_name; /* and its name, which may be ""; may be NULL without has_source */
    bool has_moment; /* it is at a moment of an animation: */
    double time; /* in seconds */
    bool is_shutter; /* the moment is the beginning of a shutter interval: */
    double end_time; /* in seconds */
    struct import_motion *motions;
    uint32_t motion_count;
    uint32_t moving_meshes; /* those with end_positions */
    /* how far motion in straight lines is off: instances in the world, vertices in the space of their mesh */
    struct import_deviation instance_deviation, vertex_deviation;
    bool has_animation; /* the file has one: */
    uint32_t animation; /* its number, from 0 */
    float point_radius, line_radius; /* those of the wish */
    bool has_second_reader; /* import_scene_by_assimp reads the same of this file, if neither reader is wrong */
    void *block; /* everything else points into this one block from memory; NULL: each array is a block of its own */
    enum import_reader reader;
    struct memory *memory;
};

/* A moment of an animation of a glTF file, or a shutter interval, from one moment to another. */
struct import_moment {
    double time; /* in seconds, finite; before the first key and after the last one the values of these hold */
    const char *animation; /* its name, or else its number from 0; NULL: the first one, if the file has any */
    bool is_shutter; /* it is an interval: */
    double end; /* in seconds, finite, after `time` */
    /* what the animation moves at any time is built as what moves, so that updates to other intervals find it so */
    bool is_for_updates;
};

/* What is read of a scene file. */
struct import_wish {
    const char *scene; /* as in import_scene */
    /*
     * NULL: everything is at rest. Otherwise nodes are where the animation has them, and skins and morph targets are
     * applied: each node that has a skin or weights of its own gets a bottom level of its own, whose vertices are, for
     * a skin, in world space. Over a shutter interval everything is as at its beginning, and what is elsewhere at its
     * end moves there: instances by `motions`, and vertices of triangles to `end_positions`. Points and lines whose
     * vertices move stay, and are counted
     */
    const struct import_moment *moment;
    bool wants_looks; /* what meshes look like is read, too; only the reader of glTF does it */
    /*
     * 0: points, or lines, are left out, and counted. Otherwise they are read, and this is the radius of those for
     * which the file has none; it is finite and positive
     */
    float point_radius, line_radius;
};

/*
 * Reads a scene file, which is hostile. BVHD_NOT_FOUND: there is no such file, or no such scene in it;
 * BVHD_UNSUPPORTED: no reader reads it; BVHD_INVALID: it breaks a rule of its format, or has nothing to build. End with
 * import_finish.
 *
 * `scene` chooses one of the scenes of a glTF file, by name or else by number from 0. NULL takes all; files of other
 * formats have nothing to choose from.
 *
 * Assimp reads the file in a child process, because broken files make some of its importers abort, run for ever, take
 * all memory, or return what lies beside their arrays. The result is BVHD_UNSUPPORTED then. To find the last of these,
 * a second child reads the file with its memory laid out and filled in another way; both must find the same scene.
 * import_process.c describes the limits.
 */
enum bvhd_status import_scene(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                              struct bvhd_error *error);

/* Does the same for any wish. BVHD_NOT_FOUND also when a file that is not glTF 2.0 is to be read at a moment. */
enum bvhd_status import_scene_as(const char *path, const struct import_wish *wish, struct memory *memory,
                                 struct import *ret_import, struct bvhd_error *error);

/* Does the same, and reads what the meshes look like. */
enum bvhd_status import_scene_with_looks(const char *path, const char *scene, struct memory *memory,
                                         struct import *ret_import, struct bvhd_error *error);

/*
 * Reads a file with assimp, also if there is a better reader, to compare. It is read in a child process, too. Not all
 * features of all formats are read right so.
 */
enum bvhd_status import_scene_by_assimp(const char *path, struct memory *memory, struct import *ret_import,
                                        struct bvhd_error *error);

/*
 * Does the same as import_scene in this process, which a broken file can crash. Vertices of what assimp reads are not
 * welded (weld.h).
 */
enum bvhd_status import_read(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                             struct bvhd_error *error);

/* Does the same as import_scene_as in this process. */
enum bvhd_status import_read_as(const char *path, const struct import_wish *wish, struct memory *memory,
                                struct import *ret_import, struct bvhd_error *error);

/* Does the same as import_scene_with_looks in this process. */
enum bvhd_status import_read_with_looks(const char *path, const char *scene, struct memory *memory,
                                        struct import *ret_import, struct bvhd_error *error);

/* Does the same as import_scene_by_assimp in this process. Of the wish, only the radii count. */
enum bvhd_status import_read_by_assimp(const char *path, const struct import_wish *wish, struct memory *memory,
                                       struct import *ret_import, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void import_finish(struct import *import);

/*
 * Returns the name of a scene, which is that of its file without directory and extension. The caller frees it with
 * memory_free. NULL when there is no memory.
 */
char *import_name(const char *path, struct memory *memory);

/* Returns how many of the motions are of kind ORACLE_SRT. */
uint32_t import_turning_count(const struct import *import);

/*
 * Lists the triangles for the oracle. With a top level there is one oracle_mesh for each mesh of each instance that is
 * not skipped, with the numbers that traversal reports; without one, there are the meshes of bottom level 0. They point
 * into the import. The caller frees *ret_meshes, with memory_free of import->memory.
 */
enum bvhd_status import_oracle_meshes(const struct import *import, bool has_top, struct oracle_mesh **ret_meshes,
                                      uint32_t *ret_count, struct bvhd_error *error);

#endif

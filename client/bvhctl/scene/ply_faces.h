/* SPDX-License-Identifier: Apache-2.0 */
/* ply_faces.h - reads the faces and triangle strips of a PLY file. Internal to ply.h. */
#ifndef BVHCTL_PLY_FACES_H
#define BVHCTL_PLY_FACES_H

#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/ply_header.h"
#include "client/bvhctl/scene/polygon.h"

/* The points or lines among the faces of a file: their vertices, one or two each. */
struct ply_round {
    bool is_wanted; /* else they are counted */
    uint32_t *indices;
    uint64_t count, capacity; /* of indices */
};

/* The triangles of a file while they are read. */
struct ply_faces {
    struct ply_source *source;
    const char *path;
    struct import_mesh *mesh; /* has all its vertices; gets triangles and counts */
    struct memory *memory;
    struct bvhd_error *error;
    uint64_t capacity; /* triangles that mesh->indices has room for */
    uint32_t *corners; /* of the row that is read */
    uint64_t corner_capacity;
    struct polygon_cutter cutter;
    struct ply_round rounds[IMPORT_SHAPES]; /* those of points and lines are used */
    bool has_polygons; /* so far: the corners of triangles are rotated (ply_faces.c) */
    uint32_t first_face; /* the first triangle of the element that is read */
    uint32_t last_corner; /* the first corner of the triangle before, if has_polygons */
};

/* Prepares reading into a mesh. End with ply_faces_finish. */
void ply_faces_init(struct ply_faces *faces, struct ply_source *source, const char *path, struct memory *memory,
                    struct import_mesh *mesh, struct bvhd_error *error);

/* Returns the property of `face` or `tristrips` that has the vertices, or NULL after an error. */
const struct ply_property *ply_faces_list(const struct ply_element *element, const char *path,
                                          struct bvhd_error *error);

/* Reads all rows of `face` or `tristrips`, which has a list. Its number of rows was compared with the file. */
enum bvhd_status ply_faces_read(struct ply_faces *faces, const struct ply_element *element);

/* Frees what was used for reading, and the points and lines that nobody has taken. The mesh keeps its triangles. */
void ply_faces_finish(struct ply_faces *faces);

/* Describes why a value of row `row` could not be read. */
enum bvhd_status ply_row_failure(const struct ply_source *source, const struct ply_element *element, uint64_t row,
                                 const char *path, struct bvhd_error *error);

/* Reads the length of a list and compares it with what the file still has. Returns false after an error. */
enum bvhd_status ply_list_length(struct ply_source *source, const struct ply_element *element,
                                 const struct ply_property *property, uint64_t row, const char *path,
                                 uint64_t *ret_length, struct bvhd_error *error);

#endif

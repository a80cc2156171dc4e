/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ply.h - reads PLY files: ASCII and binary in both byte orders, all types, elements and properties in any order.
 *
 * Of `vertex` x, y and z are read, in any type, and vertices keep the file's order. Of `face` the list `vertex_indices`
 * or `vertex_index` is read: triangles stay as they are, polygons are cut (polygon.h). `tristrips` are strips in which
 * -1 starts a new one. Other properties are attributes and are skipped; the rows of other elements are skipped and
 * counted. The result is one mesh and one instance of it.
 *
 * A file without faces is a point cloud. If the wish has a radius for points, all vertices are points, with the radii
 * of the property `radius` if the file has it.
 *
 * Files are hostile. Memory is bounded by the size of the file, whatever its header says.
 */
#ifndef BVHCTL_PLY_H
#define BVHCTL_PLY_H

#include <stdio.h>

#include "client/bvhctl/scene/import.h"

/* Returns whether this reader is the one for a file: it is regular, and begins with "ply" or has that extension. */
bool ply_is_file(const char *path);

/*
 * Reads a file; the import is as that of import_scene_as (import.h). BVHD_INVALID: the file is broken, or has no
 * triangles; BVHD_UNSUPPORTED: it has something that this reader does not know.
 */
enum bvhd_status ply_import(const char *path, const struct import_wish *wish, struct memory *memory,
                            struct import *ret_import, struct bvhd_error *error);

/* Does the same with an open file of `size` bytes, which the caller closes. `path` is for names and messages. */
enum bvhd_status ply_import_stream(FILE *file, uint64_t size, const char *path, const struct import_wish *wish,
                                   struct memory *memory, struct import *ret_import, struct bvhd_error *error);

#endif

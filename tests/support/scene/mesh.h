/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mesh.h - a growing mesh of triangles, of lines or of points, and the shapes that generated scenes are made of.
 *
 * For test programs only: without memory they print a message and end. All angles are in radians; y is up.
 */
#ifndef BVHD_MESH_H
#define BVHD_MESH_H

#include <stdint.h>

struct mesh {
    float (*vertices)[3];
    float *radii; /* one for each vertex of a mesh of lines or points, else NULL */
    uint32_t (*triangles)[3];
    uint32_t (*lines)[2]; /* the vertices of their ends; a mesh with radii and without lines has points */
    uint32_t vertex_count, vertex_capacity, radius_capacity;
    uint32_t triangle_count, triangle_capacity;
    uint32_t line_count, line_capacity;
};

/* Frees a mesh. A zeroed mesh is an empty one. Accepts NULL, and a mesh that is finished already. */
void mesh_finish(struct mesh *mesh);

/* Returns the index of the new vertex. */
uint32_t mesh_add_vertex(struct mesh *mesh, double x, double y, double z);
/* Does the same for a mesh whose vertices have radii. */
uint32_t mesh_add_round_vertex(struct mesh *mesh, const double centre[3], double radius);
void mesh_add_line(struct mesh *mesh, uint32_t a, uint32_t b);
void mesh_add_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c);
/* Adds two triangles. The corners are in order around the quad. */
void mesh_add_quad(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d);
/* Adds a triangle with three vertices of its own. */
void mesh_add_loose_triangle(struct mesh *mesh, const double a[3], const double b[3], const double c[3]);

/*
 * Adds triangles between rows of equally many vertices, which are in the mesh one after the other, starting with
 * `first`; `closed` joins the ends of each row. Faces point away from the axis when rows run counterclockwise, seen
 * from above, and are in order from the bottom up.
 */
void mesh_add_rows(struct mesh *mesh, uint32_t first, uint32_t rows, uint32_t columns, int closed);

/*
 * Adds a surface of revolution around the y axis: profile[i] = {radius, height}, from the bottom up, with `sides`
 * vertices in each ring.
 */
void mesh_add_lathe(struct mesh *mesh, const double (*profile)[2], uint32_t profile_count, uint32_t sides);

/* Adds a closed tube with a tapering radius from one point to another. */
void mesh_add_tube(struct mesh *mesh, const double from[3], const double to[3], double from_radius, double to_radius,
                   uint32_t sides);

/*
 * Adds a sphere of 20 * 4^level triangles around `centre`, with each vertex moved along its direction d by bumps(d,
 * context) * radius; bumps may be NULL.
 */
void mesh_add_sphere(struct mesh *mesh, const double centre[3], double radius, uint32_t level,
                     double (*bumps)(const double direction[3], const void *context), const void *context);

/*
 * Writes a binary little-endian PLY with a comment line: vertices, with their radii if they have any, and triangles, if
 * there are any. Returns 0, or -1 with errno set.
 */
int mesh_write_ply(const struct mesh *mesh, const char *comment, const char *path);

#endif

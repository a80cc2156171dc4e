/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_moment.h - a mesh as it is at a time: its vertices, and the transform of its instance.
 *
 * Vertices at a time, and the numbers of matrices, are floats that bvhd defines to the bit, so that they are known. A
 * matrix that is composed of a scale, a rotation and a translation is known up to what a double rounds.
 */
#ifndef BVHD_ORACLE_MOMENT_H
#define BVHD_ORACLE_MOMENT_H

#include "client/bvhctl/oracle/oracle_radial.h"

struct oracle_mesh;

struct oracle_moment {
    const struct oracle_mesh *mesh;
    float time;
    bool has_matrix;
    bool mirrored; /* the matrix reverses the winding of triangles */
    /*
     * The mesh moves, or is of a round shape, and moves of the matrix may make it singular, so that nothing is certain.
     */
    bool vague;
    struct radial matrix[12]; /* row-major 3x4, object to world */
    struct radial inverse[3][3]; /* of the matrix without its translation; if the mesh moves, or is of a round shape */
};

/* Returns false if the mesh is not there at that time, because its transform is singular or no number. */
bool oracle_moment_make(const struct oracle_mesh *mesh, float time, struct oracle_moment *ret_moment);

/* Gives the place of a vertex, which may be no number. */
void oracle_moment_vertex(const struct oracle_moment *moment, uint64_t vertex, float ret_position[3]);

/* Returns whether anything of these meshes moves, so that the time of rays matters. */
bool oracle_moves(const struct oracle_mesh *meshes, uint32_t mesh_count);

#endif

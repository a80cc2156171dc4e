/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_meshes.h - the primitives of portable structures, as the double reference takes them. For test programs only.
 */
#ifndef BVHD_SHADER_MESHES_H
#define BVHD_SHADER_MESHES_H

#include "client/bvhctl/oracle/oracle.h"
#include "tests/support/shader/shader_bed.h"

/* The properties that a group of rays shares. */
struct shader_case {
    uint32_t flags; /* RAY_ */
    uint8_t cull_mask;
    enum shader_policy policy;
};

/*
 * The primitives of a scene that rays of a case can hit, except AABBs. Without a case (NULL): all of them, and a
 * triangle for each box, to aim at. They have no indices.
 */
struct shader_meshes {
    struct oracle_mesh *meshes;
    uint32_t count;
    void **blocks; /* the arrays that `meshes` point to */
    uint32_t block_count;
};

void shader_meshes_make(const struct scene *scene, const struct shader_case *rays, struct shader_meshes *ret_meshes);
void shader_meshes_finish(struct shader_meshes *meshes);

/* How many vertices a primitive has. */
uint32_t shader_meshes_vertices(enum oracle_shape shape);

/* Makes a mesh of one of the primitives of a mesh. */
struct oracle_mesh shader_meshes_one(const struct oracle_mesh *mesh, uint32_t primitive);

/* Copies both ends of a sphere, which are equal, or of a linear swept sphere: a centre and a radius each. */
void shader_meshes_ends(const struct portable_view *view, uint32_t record, float ret_ends[2][4]);

#endif

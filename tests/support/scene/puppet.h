/* SPDX-License-Identifier: Apache-2.0 */
/*
 * puppet.h - random animated glTF files with a skin, morph targets and a chain of nodes, and where their animation has
 * everything, evaluated without matrices. For test programs only.
 */
#ifndef BVHD_PUPPET_H
#define BVHD_PUPPET_H

#include <stdbool.h>

#include "tests/support/random.h"
#include "tests/support/scene/gltf_case.h"

enum { PUPPET_JOINTS = 4, PUPPET_VERTICES = 12, PUPPET_TARGETS = 2, PUPPET_KEYS = 4, PUPPET_SETS = 2 };

/* One property over time, with tangents as glTF stores them. */
struct puppet_track {
    int interpolation; /* of enum gltf_interpolation */
    int width;
    float times[PUPPET_KEYS], values[3 * PUPPET_KEYS][4];
};

/* A mesh with two morph targets on a chain of joints, of which everything moves. */
struct puppet {
    struct puppet_track moves[PUPPET_JOINTS], turns[PUPPET_JOINTS], scales[PUPPET_JOINTS], weights;
    float positions[PUPPET_VERTICES][3], targets[PUPPET_TARGETS][PUPPET_VERTICES][3];
    uint8_t joints[PUPPET_SETS][PUPPET_VERTICES][4];
    float shares[PUPPET_SETS][PUPPET_VERTICES][4];
    float binds[PUPPET_JOINTS][16]; /* columns */
};

void puppet_make(struct random *random, struct puppet *puppet);

/*
 * Writes a GLB. Node 0 has the mesh, nodes 1 and following are the chain of joints. Without `is_skinned` the mesh has
 * no skin and no weights, and node 0 is below the last joint, at it.
 */
size_t puppet_write(const struct puppet *puppet, bool is_skinned, uint8_t ret_bytes[GLTF_CASE_ROOM]);

/* Moves a point from the space of a joint to the world, joint by joint. */
void puppet_carry(const struct puppet *puppet, int joint, double time, double point[3]);

/* Returns where a vertex of the skinned puppet is. */
void puppet_vertex(const struct puppet *puppet, int vertex, double time, double ret[3]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * unpack.h - extracts the exact primitives from opened structures for the oracle, so that a picture can be checked
 * without the scene file.
 */
#ifndef BVHCTL_UNPACK_H
#define BVHCTL_UNPACK_H

#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/scene/structures.h"

struct target_reader;

/* The primitives of a bottom level, by their flat numbers. All NULL: it has none. */
struct unpacked_bottom {
    float *positions; /* of their vertices, at time 0; NaN for primitives that are not in the structure */
    float *end_positions; /* of those that move, at time 1, else NULL */
    float *radii; /* of the vertices of round ones, else NULL */
    uint8_t *caps; /* of linear swept spheres, else NULL */
};

struct unpacked {
    struct oracle_mesh *meshes; /* one for each geometry of each instance */
    uint32_t mesh_count;
    uint64_t primitive_count; /* over all meshes */
    struct unpacked_bottom *bottoms;
    uint32_t bottom_count;
    struct structure_instance *instances; /* the transforms of the meshes point into them */
    uint32_t instance_count;
    struct memory *memory;
};

/* Extracts the primitives; those of AABBs are left out. BVHD_NO_MEMORY. End with unpack_finish. */
enum bvhd_status unpack_structures(const struct structures *structures, struct memory *memory,
                                   struct unpacked *ret_unpacked, struct bvhd_error *error);

/*
 * Moves every instance to where the driver of a native target places it: the driver transforms rays by an inverse of
 * the instance's matrix that it computes in float (reader->invert), and here the matrix becomes the inverse of that
 * inverse. The triangles of an instance whose matrix has no inverse lose their area.
 */
void unpack_follow_inverses(struct unpacked *unpacked, const struct target_reader *reader);

/* NULL-safe, idempotent. */
void unpack_finish(struct unpacked *unpacked);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* structure.h - opens one built file and reads what commands need of it, whatever its target. */
#ifndef BVHCTL_STRUCTURE_H
#define BVHCTL_STRUCTURE_H

#include "proto/base/geometry.h"
#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"

/* The kind of primitives. It is unknown for an empty structure of a native layout. */
enum structure_content {
    CONTENT_UNKNOWN,
    CONTENT_TRIANGLES,
    CONTENT_AABBS,
    CONTENT_INSTANCES,
    CONTENT_SPHERES,
    CONTENT_SWEPT_SPHERES
};

/* The primitives of one geometry. Flat numbers run through the primitives of all geometries. */
struct structure_geometry {
    uint32_t geometry; /* its index */
    uint32_t flags; /* GEOMETRY_, as far as the layout keeps them */
    uint32_t first_primitive, primitive_count; /* a range of flat numbers */
};

struct structure {
    struct bytes blob; /* the bytes of the file, which must outlive the structure */
    enum target target;
    enum structure_content content;
    bool moves; /* it is of motion triangles or of motion instances; only portable ones are */
    uint32_t primitive_count; /* with those that are not in the tree; of a native top level: leaves in the file */
    uint32_t record_count; /* records that the functions below can read, by their row from 0 */
    struct structure_geometry *geometries; /* of a bottom level, by ascending index */
    uint32_t geometry_count;
    /*
     * of a native top level, by row: the number of a leaf in the file; only leaves that the tree refers to have a row
     */
    uint32_t *instance_rows;
    union {
        struct portable_view portable;
        struct lavapipe_view lavapipe;
    } view; /* by target */
    struct memory *memory;
};

/*
 * Opens a hostile blob, which is aligned to 16 bytes; its header says which target it is of. BVHD_CORRUPT or
 * BVHD_INCOMPATIBLE with the place; BVHD_NO_MEMORY. End with structure_close.
 */
enum bvhd_status structure_open(struct bytes blob, struct memory *memory, struct structure *ret_structure,
                                struct bvhd_error *error);
/* NULL-safe, idempotent. It does not free the blob. */
void structure_close(struct structure *structure);

/* Gives the bounds of everything that can be hit, at any time: min xyz, max xyz. They are zeros for an empty one. */
void structure_bounds(const struct structure *structure, float ret_bounds[6]);

/*
 * Returns the number of rows of triangles, 0 for other contents. A triangle that was split has several rows; an
 * inactive one may have none.
 */
uint32_t structure_triangle_count(const struct structure *structure);
/*
 * Gives the exact corners of a triangle at a time from 0 to 1, which matters only if it moves, and its flat primitive
 * number. Those of times 0 and 1 are those that were built, where they are finite.
 */
void structure_triangle(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3],
                        uint32_t *ret_primitive);

/* A sphere or a linear swept sphere, exactly as built. */
struct structure_round {
    float ends[2][4]; /* centre and radius; those of a sphere are equal */
    unsigned caps; /* of a linear swept sphere, the ends that have one: 1 the first, 2 the second */
    uint32_t primitive; /* its flat number */
};

/* Returns the number of rows of spheres and linear swept spheres, 0 for other contents. */
uint32_t structure_round_count(const struct structure *structure);
struct structure_round structure_round(const struct structure *structure, uint32_t row);

struct structure_instance {
    uint32_t motion; /* MOTION_: how it moves; MOTION_STATIC in structures that do not move */
    /* its row-major 3x4 matrices at times 0 and 1, which are equal if it stands still; of MOTION_SRT, VkSRTDataNV */
    float start[PORTABLE_SRT], end[PORTABLE_SRT];
    uint32_t instance; /* position in the request */
    uint32_t bottom; /* the bottom level, as a row of the request's references */
};

uint32_t structure_instance_count(const struct structure *structure);
struct structure_instance structure_instance(const struct structure *structure, uint32_t row);

/*
 * Gives the matrix of an instance at a time from 0 to 1, as rays are transformed by it: row-major 3x4, object to world.
 * It is zero if there is none at that time, because the quaternion of a rotation is zero then.
 */
void structure_instance_matrix(const struct structure_instance *instance, float time, float ret_matrix[12]);

#endif

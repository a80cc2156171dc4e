/* SPDX-License-Identifier: Apache-2.0 */
/* structure.h - one built file, opened: what commands ask of it, whatever its target. */
#ifndef BVHCTL_STRUCTURE_H
#define BVHCTL_STRUCTURE_H

#include "proto/base/geometry.h"
#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"

/* What it is made of. A native layout does not tell what a structure was that nothing is in. */
enum structure_content { CONTENT_UNKNOWN, CONTENT_TRIANGLES, CONTENT_AABBS, CONTENT_INSTANCES };

/* The primitives of one geometry. Flat numbers count the primitives of all geometries through. */
struct structure_geometry {
    uint32_t geometry; /* its index */
    uint32_t flags; /* GEOMETRY_, as far as the layout keeps them */
    uint32_t first_primitive, primitive_count; /* flat */
};

struct structure {
    struct bytes blob; /* the bytes of the file, which outlive this */
    enum target target;
    enum structure_content content;
    uint32_t primitive_count; /* those left out of the tree included; native tops: those that the file has */
    uint32_t record_count; /* rows of structure_triangle and structure_instance */
    struct structure_geometry *geometries; /* of a bottom level, by rising index */
    uint32_t geometry_count;
    uint32_t *instance_rows; /* of a native top level: the leaves that its tree refers to */
    union {
        struct portable_view portable;
        struct lavapipe_view lavapipe;
    } view; /* by target */
    struct memory *memory;
};

/*
 * Opens a hostile blob, 16-byte aligned, of whatever target its first bytes are. BVHD_CORRUPT, BVHD_INCOMPATIBLE, with
 * the place. End with structure_close.
 */
enum bvhd_status structure_open(struct bytes blob, struct memory *memory, struct structure *ret_structure,
                                struct bvhd_error *error);
/* NULL-safe, idempotent. The blob is the caller's. */
void structure_close(struct structure *structure);

/* Of all that can be hit: min xyz, max xyz; an empty structure has zeros. */
void structure_bounds(const struct structure *structure, float ret_bounds[6]);

/* Rows of triangles, of which a split or shared one may have several, or none. */
uint32_t structure_triangle_count(const struct structure *structure);
/* The exact corners of one; *ret_primitive: its flat number. */
void structure_triangle(const struct structure *structure, uint32_t row, float ret_corners[3][3],
                        uint32_t *ret_primitive);

struct structure_instance {
    float object_to_world[12]; /* row-major 3x4 */
    uint32_t instance; /* position in the request */
    uint32_t bottom; /* the bottom level: row of the request's references */
};

uint32_t structure_instance_count(const struct structure *structure);
struct structure_instance structure_instance(const struct structure *structure, uint32_t row);

#endif

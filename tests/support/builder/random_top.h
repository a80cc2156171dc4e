/* SPDX-License-Identifier: Apache-2.0 */
/* random_top.h - a random top level over random bottom levels, with instances of every kind. For test programs only. */
#ifndef BVHD_RANDOM_TOP_H
#define BVHD_RANDOM_TOP_H

#include "builder/format/portable.h"
#include "client/bvhctl/oracle/oracle.h"
#include "tests/support/builder/random_input.h"
#include "tests/support/builder/random_motion.h"

enum { RANDOM_TOP_BOTTOMS = 4, RANDOM_TOP_INSTANCES = 60 };

struct random_instance {
    float transform[12];
    struct random_motion motion; /* of motion instances, which have no transform else */
    uint32_t custom_index, mask, sbt_offset, flags;
    int bottom; /* -1: inactive */
};

struct random_top {
    struct build_input input;
    enum random_choice choice; /* of the kinds of the bottom levels */
    bool moves; /* it is of motion instances */
    struct geometry geometry;
    /* The caller sets keys and bounds once the bottom levels are built. */
    struct reference references[RANDOM_TOP_BOTTOMS];
    struct random_input bottoms[RANDOM_TOP_BOTTOMS];
    uint32_t bottom_count, built; /* `built` is set by the caller: how many bottom levels it has built so far */
    struct random_instance instances[RANDOM_TOP_INSTANCES];
    uint32_t instance_count;
    bool culling_disabled; /* for at least one instance */
    unsigned char *records; /* of exactly the size that the request reaches */
    struct oracle_mesh *meshes; /* made by random_top_mean */
    uint32_t mesh_count;
    /* corners with reversed winding, for meshes of instances that flip their facing; NULL: not made yet */
    float *flipped[RANDOM_TOP_BOTTOMS][RANDOM_INPUT_GEOMETRIES];
    float *end_flipped[RANDOM_TOP_BOTTOMS][RANDOM_INPUT_GEOMETRIES]; /* the same at time 1 */
};

/*
 * Makes the bottom levels, of these kinds and with 0 .. `most` primitives each, and the top level over them. *ret_top
 * must not be copied.
 */
void random_top_init_of(struct random_top *ret_top, struct random *random, uint32_t most, enum random_choice choice);
/* Does the same, with flat kinds. */
void random_top_init(struct random_top *ret_top, struct random *random, uint32_t most);
void random_top_finish(struct random_top *top);

/*
 * Gives active instances other transforms, masks, numbers, flags and bottom levels, as an update may. The meanings of
 * the bottom levels may have moved, too. `request` is a struct random_top.
 */
void random_top_move(void *request, struct random *random);

/*
 * Makes top->meshes, the meaning of the request for the oracle: the primitives, except boxes, of all instances that the
 * cull mask selects. The winding of triangles is reversed for instances that flip their facing.
 */
void random_top_mean(struct random_top *top, uint32_t cull_mask);

/*
 * views[i] is bottom level i. Fills ret_bottoms by rows of the reference table, in the order of first use; returns
 * their number.
 */
uint32_t random_top_rows(const struct random_top *top, const struct portable_view *views,
                         const struct portable_view *ret_bottoms[RANDOM_TOP_BOTTOMS]);

/*
 * Makes an invertible matrix: rotated, skewed, scaled, often mirroring, sometimes the identity. Those for flat kinds
 * scale by more than others, because at a distance a float does not tell what is round and small from its silhouette.
 */
void random_top_transform(enum random_choice choice, struct random *random, float ret_matrix[12]);

/* Makes the matrix of an instance at a time. Returns false if it is singular, or nearly. */
bool random_top_matrix(const struct random_top *top, uint32_t instance, float time, float ret_matrix[12]);

/* Writes the 64 bytes of a Vulkan instance record that names `handle`. */
void random_top_record(const struct random_instance *instance, uint64_t handle, unsigned char *ret_record);

#endif

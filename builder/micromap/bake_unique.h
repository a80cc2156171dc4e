/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bake_unique.h - finds the triangles of a bake that are different, and after it the states that are.
 *
 * Meshes use the same texture coordinates again and again: each leaf of a tree is the same card. Those are baked once.
 * Both searches look at most at SHARE_PROBES_MAX entries of a table for each triangle, so that no input takes longer;
 * after so many entries with other contents a triangle counts as different.
 */
#ifndef BVHD_BAKE_UNIQUE_H
#define BVHD_BAKE_UNIQUE_H

#include "builder/micromap/bake.h"

enum { SHARE_PROBES_MAX = 256 };

/* A triangle that is baked. */
struct bake_unique {
    float coordinates[3][2];
    double weight; /* of all triangles of the mesh that are like it */
    uint64_t hash; /* of its states */
    uint64_t offset; /* of its states in the data */
    uint32_t uses; /* such triangles of the mesh */
    uint32_t counts[MICRO_STATES]; /* states */
    int32_t index; /* of its micromap triangle, or special */
    unsigned char level;
};

/* The triangles to bake, in the order in which the mesh has them first. */
struct bake_uniques {
    struct bake_unique *items;
    uint32_t *of; /* for each triangle of the mesh, the item that is like it */
    uint32_t count;
};

/*
 * Reads the texture coordinates of a request once, and checks the indices. Fails with BVHD_INVALID, BVHD_NO_MEMORY or
 * BVHD_CANCELLED.
 */
enum bvhd_status bake_unique_gather(const struct bake_request *request, const struct build_context *context,
                                    struct bake_uniques *ret_uniques, struct bvhd_error *error);

/*
 * Moves the states of all items without special index together in the data, which has them in the order of items, equal
 * ones once, and sets their offsets and indices. *ret_size is the size that is left and *ret_count the number of
 * different ones. Fails as above.
 */
enum bvhd_status bake_unique_share(struct bake_uniques *uniques, enum micro_format format, unsigned char *data,
                                   const struct build_context *context, uint64_t *ret_size, uint32_t *ret_count,
                                   struct bvhd_error *error);

/* Returns a hash of bytes, the same on every machine. */
uint64_t bake_unique_hash(const void *bytes, uint64_t size);

/* Frees the items. */
void bake_unique_finish(struct bake_uniques *uniques, struct memory *memory);

#endif

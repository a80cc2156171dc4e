/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree.h - the only door to Embree (3.13 and 4.x): one piece of refs in, one ir out.
 *
 * Embree aborts on boxes that are not finite, cannot be stopped, and may return nothing: callers pass finite boxes and pieces of bounded size,
 * and have another way when BVHD_UNSUPPORTED comes back. Its device is made with one thread; parallelism comes from calling it with several
 * pieces at once.
 */
#ifndef BVHD_EMBREE_H
#define BVHD_EMBREE_H

#include "ir.h"
#include "primitive.h"

struct embree;

/* One device for the life of the process that builds. Thread-safe to use afterwards. */
enum bvhd_status embree_create(struct embree **ret_embree, struct bvhd_error *error);
void embree_destroy(struct embree *embree);

/* Its number, 31305 for 3.13.5: part of the keys of what it builds, since other versions may build other trees. */
uint32_t embree_version(void);

struct embree_request {
    struct primitive_ref *refs; /* 32-byte aligned; permuted */
    uint32_t count; /* >= 1 */
    uint32_t leaf_max; /* 1 .. 31: so few refs are a leaf, more are not */
};

/*
 * Builds with Embree's LOW, which sorts Morton codes, into *ret_ir, made by ir_init from `memory`; the root is node 0; leaves of at most leaf_max refs. BVHD_UNSUPPORTED:
 * Embree gave up, or called back from other threads (as it does while the process has another Embree device with more than one thread); refs hold
 * the same set in any order.
 */
enum bvhd_status embree_build(struct embree *embree, const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error);

#endif

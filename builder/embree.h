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

enum embree_quality { EMBREE_LOW, EMBREE_MEDIUM, EMBREE_HIGH };

/* Cuts the part of a primitive's box that lies in [box] along `axis` at `position` into two tight boxes. For spatial splits. */
typedef void (*embree_split_function)(const void *context, const struct primitive_ref *ref, unsigned axis, float position,
                                      struct box *ret_left, struct box *ret_right);

struct embree_request {
    struct primitive_ref *refs; /* 32-byte aligned; permuted; with splits, changed */
    uint32_t count; /* >= 1 */
    uint32_t capacity; /* refs that fit there; > count leaves room for splits */
    enum embree_quality quality;
    uint32_t leaf_min, leaf_max; /* 1 .. 31: so few refs are a leaf, more are not */
    embree_split_function split; /* with EMBREE_HIGH; NULL: no splits */
    const void *split_context;
};

/*
 * Builds into *ret_ir, made by ir_init from `memory`; the root is node 0; leaves of at most leaf_max refs. Where a primitive was split, its id
 * appears in several leaves. BVHD_UNSUPPORTED: Embree gave up, or called back from other threads (as it does while the process has another
 * Embree device with more than one thread); refs hold the same set in any order, but for splits.
 */
enum bvhd_status embree_build(struct embree *embree, const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error);

#endif

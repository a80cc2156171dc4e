/* SPDX-License-Identifier: Apache-2.0 */
/*
 * primitive.h - from a canonical copy to the boxes that builders sort: one 32-byte ref for each primitive that can be
 * hit.
 *
 * Left out are inactive primitives (row F12: a triangle or an AABB with a NaN in any component, an instance without a
 * reference or with a transform that leads nowhere, a NaN) and, unless the build says ALLOW_UPDATE, degenerate ones
 * (row F13: triangles of zero area, instances of an empty structure), triangles with infinite corners and instances
 * moved to infinity, which no ray can meet. Point AABBs stay. What is kept and infinite is clamped to the largest
 * float.
 *
 * Boxes are exact for triangles and AABBs. Instances: the box of the reference's bounds through the transform, cut to
 * what its slabs leave of them (outline.h), in double, rounded outward; of an empty structure, the transform's
 * translation.
 */
#ifndef BVHD_PRIMITIVE_H
#define BVHD_PRIMITIVE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/kernel/primitive_ref.h"

struct leaves_options;

/* Places of a block of refs. */
enum { PRIMITIVE_BLOCK = 8192 };

struct primitive_refs {
    struct primitive_ref *refs; /* 64-byte aligned; in order of ids */
    /* NULL, or how many refs each block of places has, which stand at its begin: there may be gaps between blocks */
    uint32_t *blocks;
    uint32_t block_count;
    uint32_t count;
    uint32_t primitives; /* of all refs */
    struct box bounds; /* of all refs */
    struct box centroids; /* of min + max of all refs: twice the centres */
    uint64_t inactive; /* primitives */
    uint64_t degenerate; /* active, of zero area or extent, or instances of an empty structure, whether kept or not */
    uint64_t skipped; /* active, but left out: degenerate or infinite */
};

/* The box of primitive `index` of `geometry`, or an empty box when it is left out. */
struct box primitive_box(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index);

/*
 * On success the caller frees ret_refs->refs and ret_refs->blocks, of context->memory (NULL when count is 0). There may
 * be gaps between blocks, for those who read refs block by block: closing them takes another pass. The same for any
 * number of threads. BVHD_NO_MEMORY, BVHD_CANCELLED.
 *
 * With refs of runs, unless `runs` is NULL: up to runs->leaf_max primitives (LEAVES_REFS_MAX at most) that follow each
 * other in the request, where these are so near each other that they would share a leaf (leaves.h).
 */
enum bvhd_status primitive_collect_blocks(const struct canonical *canonical, const struct leaves_options *runs,
                                          const struct build_context *context, struct primitive_refs *ret_refs,
                                          struct bvhd_error *error);

/* Closes the gaps between blocks, and frees `blocks`. False when cancelled: both are the caller's still. */
bool primitive_close_gaps(struct primitive_refs *refs, const struct build_context *context);

#endif

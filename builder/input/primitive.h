/* SPDX-License-Identifier: Apache-2.0 */
/*
 * primitive.h - turns a canonical copy into the refs that builders sort: a box and a number, 32 bytes, for each
 * primitive that can be hit.
 *
 * Inactive primitives get no ref: a triangle, an AABB, a sphere or a linear swept sphere with a NaN in any component,
 * radii included, an instance without a reference or with a NaN in its transform (Vulkan specification, Inactive
 * Primitives and Instances. The specification names only the x of a triangle's vertices, the minimum x of an AABB, and
 * references that are 0.). Unless the build says ALLOW_UPDATE, these get none either, because no ray can meet them:
 * degenerate primitives (triangles of zero area, spheres without a radius, linear swept spheres without one or of which
 * an end without a cap swallows the rest, instances of an empty structure), triangles with infinite corners, spheres
 * and linear swept spheres with infinite centres or radii, and instances with an infinite transform. AABBs that are
 * points stay. Infinite coordinates that are kept are clamped to the largest float. What moves is treated so if one of
 * both ends is so; but motion triangles are degenerate only where rounding cannot give them an area between the ends:
 * two corners are one at both, or all are on a line along an axis.
 *
 * Boxes of triangles and AABBs are exact, those of spheres and linear swept spheres are in swept_shape.h. The box of an
 * instance is the box of its reference's bounds under the transform, cut to the transformed slabs (outline.h), computed
 * in double and rounded outward; for an empty structure it is the point that the transform's translation gives. What
 * moves has a box at each end, between which that of another time is interpolated: exact ones of motion triangles, and
 * of motion instances boxes that are larger by what rounding may take (srt_bounds.h says how SRTs are bounded). Its ref
 * has the box of both.
 */
#ifndef BVHD_PRIMITIVE_H
#define BVHD_PRIMITIVE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/kernel/primitive_ref.h"

struct input_kind;
struct leaves_options;
struct vec4_box;

/*
 * Returns the number of primitives in a block, of a structure with that many in all. Each task makes the refs of one
 * block, and writes them from the array element on that has the number of the block's first primitive. Blocks are
 * smaller where there would be too few of them for many threads; results do not depend on it.
 */
uint32_t primitive_block(uint32_t primitives);

struct primitive_refs {
    struct primitive_ref *refs; /* 64-byte aligned; in the order of primitive numbers */
    /*
     * Number of refs in each block. The refs of block b start at refs[b * block_size], so there are gaps behind blocks
     * that are not full. NULL when there are no gaps.
     */
    uint32_t *blocks;
    uint32_t block_count, block_size;
    uint32_t count;
    uint32_t primitives; /* number of primitives that the refs stand for; larger than `count` when some refs are runs */
    struct box bounds; /* union of all refs' boxes */
    struct box centroids; /* bounds of min + max of all refs, which is twice their centres */
    uint64_t inactive; /* number of inactive primitives */
    /* active primitives of zero area or extent, or instances of an empty structure, whether kept or not */
    uint64_t degenerate;
    uint64_t skipped; /* active primitives without a ref, because they are degenerate or infinite */
};

/* Returns the box of primitive `index` of `geometry`; an empty box for a primitive that gets no ref. */
struct box primitive_box(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index);

/*
 * Finds its boxes at t = 0 and at t = 1; that of any other time is between them. Both are that of primitive_box for a
 * primitive that does not move; else primitive_box returns the box of both.
 */
void primitive_key_boxes(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index,
                         struct box ret_boxes[2]);

/* Where the following functions found their last primitive; all but `canonical` are zero before the first call. */
struct primitive_finder {
    const struct canonical *canonical;
    const struct canonical_geometry *geometry;
    const struct input_kind *kind;
};

/*
 * Grows boxes at t = 0 and at t = 1 by those of primitive_key_boxes, of `count` primitives with these flat ids, which
 * have refs. The sign of zeros may differ.
 */
void primitive_grow_keys(struct primitive_finder *finder, const uint32_t *ids, uint32_t count, struct vec4_box *boxes);

/* Fetches what primitive_grow_keys will read into the cache, in two steps (input_kind.h). */
void primitive_prefetch_keys(struct primitive_finder *finder, const uint32_t *ids, uint32_t count, int step);

/*
 * Makes the refs of all primitives. On success the caller frees ret_refs->refs and ret_refs->blocks from
 * context->memory (both are NULL when count is 0). Gaps between blocks stay, because closing them takes another pass
 * and some callers read block by block; primitive_close_gaps closes them. The result is the same for any number of
 * threads. Returns BVHD_NO_MEMORY or BVHD_CANCELLED.
 *
 * Unless `runs` is NULL, one ref may stand for a run of up to runs->leaf_max primitives (LEAVES_REFS_MAX at most) that
 * follow each other in the request and are so near each other that they would share a leaf (leaves.h).
 */
enum bvhd_status primitive_collect_blocks(const struct canonical *canonical, const struct leaves_options *runs,
                                          const struct build_context *context, struct primitive_refs *ret_refs,
                                          struct bvhd_error *error);

/*
 * Closes the gaps between blocks, and frees `blocks`. Returns false when cancelled; then the caller still owns both
 * arrays.
 */
bool primitive_close_gaps(struct primitive_refs *refs, const struct build_context *context);

#endif

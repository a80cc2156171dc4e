/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit.h - updates a structure: keeps its tree, and gives every box in it the size of the moved geometry (mode UPDATE
 * of vkBuildAccelerationStructuresKHR).
 *
 * Nodes, leaves, slots and their order stay byte for byte; positions, instances, boxes and bounds are new. Boxes are
 * made from the leaves up, in the reverse of the nodes' depth-first order. Subtrees are tasks of context->parallel, and
 * the nodes above them follow. Such a tree serves rays worse the more its geometry has moved, which the decay tells.
 *
 * The cost of a tree is its expected cost for a ray by the surface area heuristic, with boxes as stored: the sum over
 * all children of nodes of their area, times the number and the price of primitives for a leaf, over the root's area.
 */
#ifndef BVHD_REFIT_H
#define BVHD_REFIT_H

#include "builder/build.h"
#include "builder/update/record.h"

/* The input of refit(), which only reads it, and `record`, which it completes. */
struct refit_request {
    struct bytes source; /* the blob of the source, 16-byte aligned; it must not change during the call */
    const struct record *source_record;
    const struct canonical *canonical; /* the new geometry */
    struct record *record; /* of `canonical`, which update_rules_check has compared with source_record; completed */
};

struct refit_result {
    double decay; /* cost of the tree over its cost when it was last built; 1 where either is 0 */
    uint32_t refits; /* updates since the last build, this one included */
};

/*
 * Completes the record of a structure that build() has just made, of which `stats` tells: measures the cost of its
 * tree. `record` comes from record_make. Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or BVHD_CORRUPT for a blob that
 * build() did not make.
 */
enum bvhd_status refit_measure(struct bytes blob, const struct build_stats *stats, const struct build_context *context,
                               struct record *record, struct bvhd_error *error);

/*
 * Updates. The blob is the same for any number of threads, compiler and instruction set. *ret_blob: stats->sizes.total
 * bytes, 64-byte aligned, from context->output, or, when that is NULL, from context->memory, and the caller frees them.
 * *ret_stats is what build() says about a build, with the method "refit", the quality of the last build, and the cost
 * of the tree as its sah; degenerate primitives are not counted, and the depth is 0, for not known. On success
 * *request->record is complete: it is the source record of the next update.
 *
 * The source may be any bytes: reads never leave them. BVHD_CORRUPT names what does not fit the record or the layout,
 * and BVHD_INCOMPATIBLE a layout that is another one. Returns BVHD_UNSUPPORTED where an inactive instance of a native
 * structure gets a reference, or loses it; BVHD_NO_MEMORY; BVHD_CANCELLED within a few milliseconds after the flag is
 * set. On failure nothing is held.
 */
enum bvhd_status refit(const struct refit_request *request, const struct build_context *context,
                       unsigned char **ret_blob, struct build_stats *ret_stats, struct refit_result *ret_result,
                       struct bvhd_error *error);

#endif

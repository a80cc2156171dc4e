/* SPDX-License-Identifier: Apache-2.0 */
/*
 * build.h - the second step of a build: turns a canonical copy into a serialized structure (the first step, prepare.h,
 * makes the copy).
 *
 * Stages: primitive boxes -> a split into pieces at the top -> a tree for each piece, one thread each -> one joined
 * binary tree (ir) -> passes over it -> collapse into 8-wide nodes -> layout, which writes the blob. Where something
 * moves, trees are built over boxes that hold each primitive at all times, and get those of t = 0 and t = 1 before they
 * are joined (top/restore.h); what crosses is divided by those of both ends (top/moving_split.h). With quality fast,
 * pieces are collapsed one by one and joined as wide trees (wide_pieces.h). Stages run on context->parallel; the cancel
 * flag is checked between pieces and stages.
 */
#ifndef BVHD_BUILD_H
#define BVHD_BUILD_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/format/layout.h"

/* Part of every key: changes whenever the same request would give other bytes. */
enum { BUILD_VERSION = 6 };

/* Part of the keys of updates: changes whenever the same update of the same structure would give other bytes. */
enum { REFIT_VERSION = 1 };

/*
 * Wall time of each stage in milliseconds. A tree that becomes wide piece by piece, as nearly all of quality fast do,
 * is collapsed within `pieces` and `join`; its `collapse` is 0.
 */
struct build_times {
    double boxes, split, pieces, join, depth, collapse, write;
};

struct build_stats {
    uint64_t primitives, triangles, instances; /* as in the request */
    uint64_t inactive, degenerate, skipped; /* counts of primitives; primitive.h defines the three */
    uint64_t refs; /* references in leaves; more than the primitives in the tree when some are split */
    uint32_t depth; /* levels of the binary tree, after the depth pass */
    double sah; /* SAH cost of the binary tree (ir_sah); 0 when it is empty */
    /*
     * "ploc", "binned" or "spatial"; by Embree "embree-low", "embree-medium" or "embree-high"; "none" when there are no
     * refs; a static string
     */
    const char *method;
    enum build_quality quality; /* the quality that was built: FAST, BALANCED or HIGH (tier.h) */
    struct box bounds; /* of the whole structure */
    struct slabs slabs; /* extents of a bottom level along fixed directions (k-DOP) */
    struct build_times ms;
    struct layout_sizes sizes;
};

/* Returns a static string, "unknown" for values outside the enum. */
const char *build_quality_name(enum build_quality quality);

/*
 * Returns "own" or "embree" as a static string, "unknown" for values outside the enum; and finds the value by the name.
 */
const char *build_builder_name(enum build_builder builder);
bool build_builder_from_name(const char *name, enum build_builder *ret_builder);

/*
 * Builds the structure. `canonical` comes from prepare or prepare_open, which have checked it. The blob is the same,
 * byte by byte, for any number of threads, compiler and instruction set.
 *
 * *ret_blob: stats->sizes.total bytes, 64-byte aligned. They come from context->output, or, when that is NULL, from
 * context->memory, and the caller frees them. On failure nothing is held.
 *
 * Returns BVHD_UNSUPPORTED for a builder, target, layout flag or device variant that does not exist, BVHD_NO_MEMORY,
 * BVHD_TOO_LARGE, or BVHD_CANCELLED within a few milliseconds after the flag is set.
 */
enum bvhd_status build(const struct canonical *canonical, const struct build_options *options,
                       const struct build_context *context, unsigned char **ret_blob, struct build_stats *ret_stats,
                       struct bvhd_error *error);

/*
 * Runs the first half of build(), for benchmarks and tests: up to the binary tree after its passes, with leaves as
 * options->target needs them. Errors are those of build(). The caller ends *ret_ir with ir_finish.
 */
enum bvhd_status build_ir(const struct canonical *canonical, const struct build_options *options,
                          const struct build_context *context, struct ir *ret_ir, struct build_stats *ret_stats,
                          struct bvhd_error *error);

#endif

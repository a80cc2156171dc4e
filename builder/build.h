/* SPDX-License-Identifier: Apache-2.0 */
/*
 * build.h - the second step: a canonical copy to a serialized structure.
 *
 * primitive boxes -> our own top-level split into pieces -> a builder for each piece -> one ir -> passes -> collapse ->
 * layout; with quality fast pieces are collapsed one by one and joined as wide trees (wide_pieces.h). Stages run on the
 * caller's struct parallel; cancellation is looked at between pieces and stages.
 */
#ifndef BVHD_BUILD_H
#define BVHD_BUILD_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/format/layout.h"

enum { BUILD_VERSION = 6 }; /* changes whenever the same request would give other bytes: part of every key */

/*
 * Wall time of the stages, in milliseconds. What becomes wide piece by piece, as nearly all of quality fast, is
 * collapsed in `pieces` and `join`: `collapse` is 0 then.
 */
struct build_times {
    double boxes, split, pieces, join, depth, collapse, write;
};

struct build_stats {
    uint64_t primitives, triangles, instances; /* as asked */
    uint64_t inactive, degenerate, skipped; /* primitive.h */
    uint64_t refs; /* in leaves; more than the primitives in the tree when split */
    uint32_t depth; /* levels of the 2-wide ir, after the depth pass */
    double sah; /* of the 2-wide ir; 0 when empty */
    const char *method; /* "ploc", "binned", "spatial", "none" without refs; static */
    enum build_quality quality; /* that was built: never UNSPECIFIED or AUTO (tier.h) */
    struct box bounds; /* of the whole structure */
    struct slabs slabs; /* likewise, of a bottom level */
    struct build_times ms;
    struct layout_sizes sizes;
};

const char *build_quality_name(enum build_quality quality);

/*
 * *ret_blob: from context->output, or when that is NULL from context->memory: 64-byte aligned, the caller frees it. On
 * failure nothing is held. BVHD_CANCELLED soon after the flag is set. `canonical` comes from prepare (checked). The
 * same bytes for any number of threads, compiler and instruction set.
 */
enum bvhd_status build(const struct canonical *canonical, const struct build_options *options,
                       const struct build_context *context, unsigned char **ret_blob, struct build_stats *ret_stats,
                       struct bvhd_error *error);

/*
 * The first half of build(), for benchmarks and tests: the ir after its passes, with leaves as options->target wants
 * them. The caller ends it with ir_finish.
 */
enum bvhd_status build_ir(const struct canonical *canonical, const struct build_options *options,
                          const struct build_context *context, struct ir *ret_ir, struct build_stats *ret_stats,
                          struct bvhd_error *error);

#endif

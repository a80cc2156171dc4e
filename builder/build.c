/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/build.h"

#include <string.h>

#include "builder/kernel/clip.h"
#include "proto/base/clock.h"
#include "builder/wide/collapse.h"
#include "builder/depth.h"
#include "builder/format/record_kind.h"
#include "builder/kernel/leaves.h"
#include "builder/input/outline.h"
#include "builder/method.h"
#include "builder/top/crossing.h"
#include "builder/top/moving_split.h"
#include "builder/top/pieces.h"
#include "builder/input/primitive.h"
#include "builder/rescale.h"
#include "proto/base/kind.h"
#include "builder/top/scatter.h"
#include "builder/piece/spatial.h"
#include "builder/top/spatial_split.h"
#include "builder/top/split.h"
#include "builder/tier.h"
#include "builder/write_micromap.h"

/*
 * Binary trees up to this depth are left alone until their wide form is known: eight-wide nodes need about a third of
 * the levels.
 */
enum { BINARY_DEPTH_LIMIT = 64 };

/* The state of one build, which its stages share. */
struct construction {
    const struct canonical *canonical; /* points to `view` */
    struct canonical view;
    const struct layout *layout;
    const struct record_kind *record; /* of the portable layout; all layouts take their prices from it */
    const struct build_context *context;
    enum build_quality quality;
    enum pieces_method method;
    struct primitive_refs refs;
    struct primitive_ref *scratch;
    uint32_t capacity; /* refs that fit into each of the two arrays */
    float price; /* cost of a split, from spatial_split to the pieces */
    struct split_tree tree;
    bool rescaled;
    bool moves; /* refs have boxes that hold each primitive at all times, until the tree is there */
    bool crosses; /* so does much of what is near in these boxes: it is divided by the boxes of both ends */
    bool needs_binary; /* the caller wants the binary tree, or has to change it before it is made wide */
    bool is_second; /* this is the second attempt (make_shallow_tree); the first one has already reported progress */
    struct ir ir; /* when `wide` was joined from pieces, only the boxes and refs that layouts read */
    struct wide wide;
    struct build_stats stats;
    double clock; /* clock_ms() when the running stage began */
    struct bvhd_error *error;
};

static enum bvhd_status cancelled(const struct construction *construction)
{
    return bvhd_error_set(construction->error, BVHD_CANCELLED, "", "cancelled");
}

/* Ends a stage: adds its time to *ms and checks the cancel flag. */
static enum bvhd_status stage_end(struct construction *construction, double *ms)
{
    double now = clock_ms();
    *ms += now - construction->clock;
    construction->clock = now;
    return context_cancelled(construction->context) ? cancelled(construction) : BVHD_OK;
}

static void count_primitives(const struct canonical *canonical, struct build_stats *stats)
{
    stats->primitives = canonical->primitive_count;
    for (uint32_t i = 0; i < canonical->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        const uint32_t type = kind_find(geometry->type)->vulkan_type;
        stats->triangles += type == GEOMETRY_TRIANGLES ? geometry->primitive_count : 0;
        stats->instances += type == GEOMETRY_INSTANCES ? geometry->primitive_count : 0;
    }
}

/* Returns how many primitives may share a leaf before the collapse, which knows the boxes of both ends. */
static uint32_t leaf_max(const struct construction *construction)
{
    if (construction->crosses)
        return 1;
    const uint32_t most = construction->layout->leaf_max, first = construction->record->first_leaf;
    return first < most ? first : most;
}

/*
 * Cost of a cut between two leaves, relative to a node (leaves.h). For fast it is above 1: larger leaves save more
 * build time than they cost the rays. For balanced it is below 1: only primitives that clearly belong together share a
 * leaf from the beginning, which saves a fifth of the time.
 */
static const float fast_cut = 4, balanced_cut = 0.85f;

/* Runs of primitives share a ref from the start, unless the method or the split looks at each of them. */
static struct leaves_options runs_for(const struct construction *construction)
{
    const bool are_runs = method_takes_runs(construction->method) && !construction->crosses;
    return (struct leaves_options){are_runs ? leaf_max(construction) : 1,
                                   construction->quality == QUALITY_FAST ? fast_cut : balanced_cut};
}

/* Primitives whose paths cross are divided until a part has at most this many refs, which move nearly alike. */
enum { CROSSING_PIECE = 64 };

static uint32_t piece_size(const struct construction *construction)
{
    return construction->crosses ? CROSSING_PIECE : method_piece_size(construction->method, construction->refs.count);
}

/*
 * Such refs are cut by a sample (scatter.h), which reads them block by block; all other methods need refs without gaps
 * between blocks.
 */
static bool is_scattered(const struct construction *construction)
{
    return !method_is_spatial(construction->method) && construction->refs.count > piece_size(construction) &&
           !construction->rescaled && !construction->crosses;
}

static void free_refs(struct construction *construction)
{
    struct memory *memory = construction->context->memory;
    memory_free(memory, construction->refs.refs);
    memory_free(memory, construction->refs.blocks);
    memory_free(memory, construction->scratch);
    construction->refs.refs = construction->scratch = NULL;
    construction->refs.blocks = NULL;
}

static enum bvhd_status collect_refs(struct construction *construction)
{
    const struct leaves_options runs = runs_for(construction);
    enum bvhd_status status = primitive_collect_blocks(construction->canonical, &runs, construction->context,
                                                       &construction->refs, construction->error);
    if (status == BVHD_OK)
        construction->rescaled = rescale_is_needed(&construction->refs.bounds);
    return status;
}

/*
 * Finds out whether what moves crosses. Then each primitive has a ref, and the pieces are so small that only simple
 * methods are worth their preparation; Embree's builder makes its own trees.
 */
static enum bvhd_status look_at_motion(struct construction *construction)
{
    struct memory *memory = construction->context->memory;
    if (!construction->moves || construction->rescaled || method_is_embree(construction->method))
        return BVHD_OK;
    if (crossing_find(construction->canonical, &construction->refs, memory, &construction->crosses) != BVHD_OK)
        return bvhd_error_no_memory(construction->error, "", "no memory to look at the motion of primitives");
    if (!construction->crosses)
        return BVHD_OK;
    if (construction->method != PIECES_PLOC)
        construction->method = PIECES_BINNED;
    free_refs(construction);
    return collect_refs(construction);
}

static enum bvhd_status collect(struct construction *construction)
{
    const struct canonical *canonical = construction->canonical;
    const struct build_context *context = construction->context;
    struct build_stats *stats = &construction->stats;
    struct primitive_refs *refs = &construction->refs;
    enum bvhd_status status = collect_refs(construction);
    if (status == BVHD_OK)
        status = look_at_motion(construction);
    if (status != BVHD_OK)
        return status;
    count_primitives(canonical, stats);
    stats->inactive = refs->inactive;
    stats->degenerate = refs->degenerate;
    stats->skipped = refs->skipped;
    stats->bounds = refs->bounds;
    if (refs->count > 0 && canonical->type == STRUCTURE_BOTTOM && !outline_find(canonical, context, &stats->slabs))
        return cancelled(construction);
    if (!(is_scattered(construction) || primitive_close_gaps(refs, context)))
        return cancelled(construction);
    if (construction->rescaled && !rescale_refs(refs, context))
        return cancelled(construction);
    return stage_end(construction, &stats->ms.boxes);
}

/* A binary layout of n levels holds at most 2^(n - 1) leaves; a wide layout has room for as many as ids can name. */
static bool split_refs_fit(const struct construction *construction)
{
    const struct layout *layout = construction->layout;
    return layout->arity != 2 || layout->depth_limit > 32 ||
           spatial_capacity(construction->refs.count) >> (layout->depth_limit - 1) == 0;
}

/*
 * Rescaling and updates replace boxes by those of whole primitives, which would lose the splits; so would the two keys
 * of what moves, which clip_allowed refuses. Embree calls back for
 * each split, which is written for triangles.
 */
static bool may_split(const struct construction *construction)
{
    const struct canonical *canonical = construction->canonical;
    const bool cuts = construction->method != PIECES_EMBREE_HIGH || construction->record->type == GEOMETRY_TRIANGLES;
    const bool splits = cuts && !construction->rescaled && split_refs_fit(construction);
    return splits && !(canonical->flags & (BUILD_LOW_MEMORY | BUILD_ALLOW_UPDATE)) && clip_allowed(canonical);
}

/* Cuts the refs by a sample, or by both ends; the result lies in the other array, so the two are swapped. */
static enum bvhd_status scatter(struct construction *construction, const struct split_request *request)
{
    const struct build_context *context = construction->context;
    enum bvhd_status status =
        construction->crosses
            ? moving_split(request, construction->canonical, context->memory, context->parallel, &construction->tree,
                           construction->error)
            : scatter_refs(request, context->memory, context->parallel, &construction->tree, construction->error);
    construction->refs.refs = request->scratch;
    construction->scratch = request->refs;
    return status;
}

/* Allocates the second array of refs, and grows the first one where splits will add refs. */
static bool make_room(struct construction *construction)
{
    struct memory *memory = construction->context->memory;
    struct primitive_refs *refs = &construction->refs;
    bool more = method_is_spatial(construction->method) && may_split(construction);
    construction->capacity = more ? spatial_capacity(refs->count) : refs->count;
    if (construction->capacity > refs->count) {
        struct primitive_ref *room = memory_resize(memory, refs->refs, (uint64_t)construction->capacity * sizeof *room);
        if (!room)
            return false;
        refs->refs = room;
    }
    construction->scratch = memory_array(memory, construction->capacity, sizeof *construction->scratch);
    return construction->scratch != NULL;
}

static enum bvhd_status split_spatially(struct construction *construction)
{
    const struct build_context *context = construction->context;
    const struct primitive_refs *refs = &construction->refs;
    struct spatial_split_request request = {
        .canonical = construction->canonical,
        .refs = refs->refs,
        .scratch = construction->scratch,
        .count = refs->count,
        .capacity = construction->capacity,
        .piece_size = piece_size(construction),
        .bounds = refs->bounds,
        .centroids = refs->centroids,
        .cancel = context->cancel,
    };
    return spatial_split(&request, context->memory, context->parallel, &construction->tree, &construction->price,
                         construction->error);
}

static enum bvhd_status split(struct construction *construction)
{
    const struct build_context *context = construction->context;
    const struct primitive_refs *refs = &construction->refs;
    if (!make_room(construction))
        return bvhd_error_no_memory(construction->error, "", "no memory to build over %u primitives",
                                    construction->canonical->primitive_count);
    struct split_request request = {
        .refs = refs->refs,
        .scratch = construction->scratch,
        .blocks = refs->blocks,
        .block_count = refs->block_count,
        .block_size = refs->block_size,
        .count = refs->count,
        .piece_size = piece_size(construction),
        .bounds = refs->bounds,
        .centroids = refs->centroids,
        .cancel = context->cancel,
    };
    enum bvhd_status status;
    if (method_is_spatial(construction->method))
        status = split_spatially(construction);
    else if (refs->count <= request.piece_size)
        status = split_refs(&request, context->memory, context->parallel, &construction->tree, construction->error);
    else
        status = scatter(construction, &request);
    return status == BVHD_OK ? stage_end(construction, &construction->stats.ms.split) : status;
}

/* Counts primitives, or refs where splits make more of those. */
static uint64_t progress_total(const struct primitive_refs *refs)
{
    return refs->count > refs->primitives ? refs->count : refs->primitives;
}

/* Returns whether the tree is built over boxes that are not those of its primitives. */
static bool must_restore(const struct construction *construction)
{
    return construction->rescaled || construction->moves;
}

static struct pieces_request pieces_wanted(const struct construction *construction)
{
    const struct build_context *context = construction->context;
    return (struct pieces_request){
        .tree = &construction->tree,
        .refs = construction->refs.refs,
        .scratch = construction->scratch,
        .capacity = construction->capacity,
        .method = construction->method,
        .leaf_max = leaf_max(construction),
        .cut_cost = runs_for(construction).cut_cost,
        .canonical = construction->canonical,
        .must_restore = must_restore(construction),
        .price = construction->price,
        .cancel = context->cancel,
        .progress = construction->is_second ? NULL : context->progress,
        .progress_context = context->progress_context,
        .progress_total = progress_total(&construction->refs),
    };
}

static void free_split(struct construction *construction)
{
    free_refs(construction);
    memory_free(construction->context->memory, construction->tree.nodes);
    construction->tree.nodes = NULL;
}

/*
 * Joins the pieces into one tree in the memory of the refs; the arrays that are left over go back to the construction.
 */
static enum bvhd_status join_pieces(struct construction *construction, const struct pieces *pieces, double *ret_cost)
{
    struct pieces_spare spare = {construction->refs.refs, construction->scratch, construction->capacity};
    enum bvhd_status status = pieces_join(pieces, &spare, construction->context->parallel, &construction->ir,
                                          &construction->stats.depth, ret_cost, construction->error);
    construction->refs.refs = spare.refs;
    construction->scratch = spare.scratch;
    return status;
}

/* The refs are no longer read, and a joined wide tree does not reuse their memory. */
static enum bvhd_status join_wide_pieces(struct construction *construction, const struct pieces *pieces,
                                         double *ret_cost)
{
    free_refs(construction);
    return pieces_join_wide(pieces, construction->context->parallel, &construction->ir, &construction->wide,
                            &construction->stats.depth, ret_cost, construction->error);
}

static struct collapse_options collapse_wanted(const struct construction *construction)
{
    return (struct collapse_options){construction->layout->leaf_max, construction->record->cost,
                                     construction->context->cancel, construction->quality == QUALITY_FAST};
}

/*
 * Pieces are collapsed one by one, while each is in the cache, unless the binary tree is needed or changed before. The
 * roots of pieces then are wide nodes, whether that suits the levels above or not: this saves a tenth of the build time
 * and costs 3 % more nodes for each ray, which pays for fast only.
 */
static bool collapses_at_once(const struct construction *construction)
{
    return construction->method == PIECES_PLOC && !construction->needs_binary && !construction->rescaled &&
           !construction->crosses && !construction->layout->inflate_boxes && construction->layout->arity != 2 &&
           construction->tree.piece_count > 1;
}

static enum bvhd_status build_pieces(struct construction *construction)
{
    const struct build_context *context = construction->context;
    struct build_stats *stats = &construction->stats;
    struct pieces pieces;
    double cost;
    struct pieces_request request = pieces_wanted(construction);
    const struct collapse_options options = collapse_wanted(construction);
    request.collapse_at_once = collapses_at_once(construction) ? &options : NULL;
    enum bvhd_status status = pieces_build(&request, context->memory, context->parallel, &pieces, construction->error);
    if (status != BVHD_OK)
        return status;
    stats->method = method_name(construction->method, may_split(construction));
    status = stage_end(construction, &stats->ms.pieces);
    if (status == BVHD_OK && request.collapse_at_once)
        status = join_wide_pieces(construction, &pieces, &cost);
    else if (status == BVHD_OK)
        status = join_pieces(construction, &pieces, &cost);
    pieces_finish(&pieces);
    if (status != BVHD_OK)
        return status;
    free_split(construction);
    stats->sah = ir_sah_from(&construction->ir, cost);
    return stage_end(construction, &stats->ms.join);
}

static enum bvhd_status limit_depth(struct construction *construction, uint32_t limit)
{
    struct ir *ir = &construction->ir;
    if (construction->stats.depth > limit) {
        enum bvhd_status status =
            depth_limit(ir, limit, construction->context->cancel, &construction->stats.depth, construction->error);
        if (status != BVHD_OK)
            return status;
        construction->stats.sah = ir_sah(ir);
    }
    return stage_end(construction, &construction->stats.ms.depth);
}

static enum bvhd_status inflate_boxes(struct construction *construction)
{
    const struct canonical *canonical = construction->canonical;
    const struct build_context *context = construction->context;
    bool is_needed = canonical->type == STRUCTURE_TOP || construction->ir.ref_count > construction->refs.primitives;
    if (!construction->layout->inflate_boxes || !is_needed)
        return BVHD_OK;
    if (!construction->layout->inflate_boxes(canonical, context->parallel, context->cancel, &construction->ir))
        return cancelled(construction);
    construction->stats.sah = ir_sah(&construction->ir);
    return stage_end(construction, &construction->stats.ms.depth);
}

/*
 * Returns whether the joined 8-wide tree has too many levels: the tree must then be built again through the binary
 * tree, whose depth can be limited.
 */
static bool is_too_deep(const struct construction *construction)
{
    return construction->wide.nodes && (construction->stats.depth > BINARY_DEPTH_LIMIT ||
                                        construction->wide.depth > construction->layout->depth_limit);
}

static enum bvhd_status make_tree(struct construction *construction)
{
    enum bvhd_status status = collect(construction);
    construction->stats.method = "none";
    if (status != BVHD_OK || construction->refs.count == 0)
        return status == BVHD_OK ? ir_init(&construction->ir, construction->context->memory, 0, 0, construction->error)
                                 : status;
    status = split(construction);
    if (status == BVHD_OK)
        status = build_pieces(construction);
    uint32_t limit = construction->layout->arity == 2 ? construction->layout->depth_limit : BINARY_DEPTH_LIMIT;
    if (status == BVHD_OK && !construction->wide.nodes)
        status = limit_depth(construction, limit);
    construction->stats.refs = construction->ir.ref_count;
    return status == BVHD_OK ? inflate_boxes(construction) : status;
}

static enum bvhd_status collapse_once(struct construction *construction)
{
    const struct build_context *context = construction->context;
    const struct collapse_options options = collapse_wanted(construction);
    enum bvhd_status status = collapse(&construction->ir, &options, context->memory, context->parallel,
                                       &construction->wide, construction->error);
    return status == BVHD_OK ? stage_end(construction, &construction->stats.ms.collapse) : status;
}

/* A wide tree is never deeper than the binary tree, so limiting the binary tree limits the wide one. */
static enum bvhd_status make_wide(struct construction *construction)
{
    if (construction->layout->arity == 2 || construction->wide.nodes)
        return BVHD_OK;
    enum bvhd_status status = collapse_once(construction);
    if (status != BVHD_OK || construction->wide.depth <= construction->layout->depth_limit)
        return status;
    wide_finish(&construction->wide);
    status = limit_depth(construction, construction->layout->depth_limit);
    return status == BVHD_OK ? collapse_once(construction) : status;
}

static enum bvhd_status write_blob(struct construction *construction, const struct build_options *options,
                                   unsigned char **ret_blob)
{
    const struct build_context *context = construction->context;
    struct layout_input input = {
        .canonical = construction->canonical,
        .ir = &construction->ir,
        .wide = construction->layout->arity == 2 ? NULL : &construction->wide,
        .complete = construction->refs.primitives == construction->canonical->primitive_count,
        .layout_flags = options->layout_flags,
        .device = &options->device,
        .memory = context->memory,
        .parallel = context->parallel,
        .cancel = context->cancel,
        .output = context->output,
    };
    unsigned char *blob;
    enum bvhd_status status =
        construction->layout->write(&input, &blob, &construction->stats.sizes, construction->error);
    if (status != BVHD_OK)
        return status;
    status = stage_end(construction, &construction->stats.ms.write);
    if (status != BVHD_OK) {
        output_discard(context->output, context->memory, blob);
        return status;
    }
    *ret_blob = blob;
    return BVHD_OK;
}

static enum bvhd_status construction_init(struct construction *construction, const struct canonical *canonical,
                                          const struct build_options *options, const struct build_context *context,
                                          struct bvhd_error *error)
{
    *construction = (struct construction){.view = *canonical, .context = context, .error = error, .clock = clock_ms()};
    construction->canonical = &construction->view;
    construction->record = record_kind_of(record_content_of(canonical, options->layout_flags));
    construction->moves = canonical_moves(canonical);
    construction->quality = tier_resolve(canonical, options);
    construction->stats.quality = construction->quality;
    construction->method = method_choose(canonical, options->builder, construction->quality);
    if (options->builder != BUILDER_OWN && options->builder != BUILDER_EMBREE)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "build.builder", "there is no builder %d",
                              (int)options->builder);
    construction->layout = layout_find(options->target);
    if (!construction->layout)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.target", "unknown target %d", (int)options->target);
    if (options->layout_flags & ~construction->layout->flags)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.layoutFlags", "flags 0x%x are unknown to the %s layout",
                              options->layout_flags & ~construction->layout->flags, construction->layout->name);
    construction->view.ignores_slabs = construction->layout->inflate_boxes != NULL;
    const uint32_t variants = construction->layout->variants, variant = options->device.variant;
    if (variants > 0 && (variant == 0 || variant > variants))
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.device", "the %s layout has no variant %u",
                              construction->layout->name, variant);
    return BVHD_OK;
}

static void construction_finish(struct construction *construction)
{
    free_split(construction);
    wide_finish(&construction->wide);
    ir_finish(&construction->ir);
}

/* Builds again from the start by way of the binary tree, whose depth can be limited. Few structures need it. */
static enum bvhd_status make_shallow_tree(struct construction *construction, const struct build_options *options)
{
    const struct canonical *canonical = construction->canonical;
    const struct build_context *context = construction->context;
    struct bvhd_error *error = construction->error;
    const struct build_times before = construction->stats.ms;
    construction_finish(construction);
    enum bvhd_status status = construction_init(construction, canonical, options, context, error);
    construction->needs_binary = construction->is_second = true;
    construction->stats.ms = before;
    return status == BVHD_OK ? make_tree(construction) : status;
}

static enum bvhd_status make_structure(struct construction *construction, const struct build_options *options,
                                       unsigned char **ret_blob)
{
    enum bvhd_status status = make_tree(construction);
    if (status == BVHD_OK && is_too_deep(construction))
        status = make_shallow_tree(construction, options);
    if (status == BVHD_OK)
        status = make_wide(construction);
    return status == BVHD_OK ? write_blob(construction, options, ret_blob) : status;
}

enum bvhd_status build(const struct canonical *canonical, const struct build_options *options,
                       const struct build_context *context, unsigned char **ret_blob, struct build_stats *ret_stats,
                       struct bvhd_error *error)
{
    struct construction construction;
    enum bvhd_status status = construction_init(&construction, canonical, options, context, error);
    if (status == BVHD_OK)
        status = canonical->type == STRUCTURE_MICROMAP
                     ? write_micromap(canonical, construction.layout, context, ret_blob, &construction.stats, error)
                     : make_structure(&construction, options, ret_blob);
    construction_finish(&construction);
    if (status != BVHD_OK)
        return status;
    if (context->progress)
        context->progress(context->progress_context, progress_total(&construction.refs),
                          progress_total(&construction.refs));
    *ret_stats = construction.stats;
    return BVHD_OK;
}

enum bvhd_status build_ir(const struct canonical *canonical, const struct build_options *options,
                          const struct build_context *context, struct ir *ret_ir, struct build_stats *ret_stats,
                          struct bvhd_error *error)
{
    struct construction construction;
    enum bvhd_status status = construction_init(&construction, canonical, options, context, error);
    construction.needs_binary = true;
    if (status == BVHD_OK)
        status = make_tree(&construction);
    if (status == BVHD_OK) {
        *ret_ir = construction.ir;
        *ret_stats = construction.stats;
        memset(&construction.ir, 0, sizeof construction.ir);
    }
    construction_finish(&construction);
    return status;
}

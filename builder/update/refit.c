/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/refit.h"

#include <inttypes.h>
#include <math.h>

#include "builder/input/outline.h"
#include "builder/update/refit_internal.h"
#include "proto/base/clock.h"
#include "proto/base/kind.h"

static enum bvhd_status unknown_target(uint32_t target, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.target", "unknown target %" PRIu32, target);
}

enum bvhd_status refit_measure(struct bytes blob, const struct build_stats *stats, const struct build_context *context,
                               struct record *record, struct bvhd_error *error)
{
    struct record_header *header = record->owned;
    enum bvhd_status status;
    double cost = 0;
    if (header->target == TARGET_PORTABLE)
        status = refit_portable_cost(blob, context, &cost, error);
    else if (header->target == TARGET_LAVAPIPE)
        status = refit_lavapipe_cost(blob, &header->device, context, &cost, error);
    else
        return unknown_target(header->target, error);
    if (status != BVHD_OK)
        return status;
    if (!(cost >= 0 && isfinite(cost)))
        return bvhd_error_set(error, BVHD_CORRUPT, "nodes", "the cost of the tree is negative or not finite");
    header->cost = cost;
    header->quality = stats->quality;
    header->refits = 0;
    return BVHD_OK;
}

static enum bvhd_status refit_blob(const struct refit_request *request, const struct build_context *context,
                                   struct refit_output *ret_output, struct bvhd_error *error)
{
    const uint32_t target = request->record->header->target;
    if (target == TARGET_PORTABLE)
        return refit_portable(request, context, ret_output, error);
    return target == TARGET_LAVAPIPE ? refit_lavapipe(request, context, ret_output, error)
                                     : unknown_target(target, error);
}

static struct build_stats stats_of(const struct refit_request *request, const struct refit_output *output)
{
    const struct record_header *header = request->record->header;
    struct build_stats stats = {
        .primitives = header->primitive_count,
        .inactive = header->inactive_count,
        .refs = header->primitive_count - header->inactive_count,
        .sah = output->cost,
        .method = "refit",
        .quality = (enum build_quality)request->source_record->header->quality,
        .bounds = output->bounds,
        .sizes = output->sizes,
    };
    if (kind_find(record_type_of(request->record))->vulkan_type == GEOMETRY_TRIANGLES)
        stats.triangles = header->primitive_count;
    stats.instances = header->type == STRUCTURE_TOP ? header->primitive_count : 0;
    return stats;
}

static void complete(const struct refit_request *request, const struct refit_output *output,
                     struct refit_result *ret_result)
{
    const struct record_header *source = request->source_record->header;
    struct record_header *header = request->record->owned;
    header->cost = source->cost;
    header->quality = source->quality;
    header->refits = source->refits < UINT32_MAX ? source->refits + 1 : source->refits;
    bool known = output->cost > 0 && source->cost > 0;
    *ret_result = (struct refit_result){known ? output->cost / source->cost : 1, header->refits};
}

enum bvhd_status refit(const struct refit_request *request, const struct build_context *context,
                       unsigned char **ret_blob, struct build_stats *ret_stats, struct refit_result *ret_result,
                       struct bvhd_error *error)
{
    struct refit_output output;
    const double begin = clock_ms();
    enum bvhd_status status = refit_blob(request, context, &output, error);
    if (status != BVHD_OK)
        return status;
    struct build_stats stats = stats_of(request, &output);
    const double written = clock_ms();
    stats.ms.write = written - begin;
    if (stats.refs > 0 && request->canonical->type == STRUCTURE_BOTTOM &&
        !outline_find(request->canonical, context, &stats.slabs)) {
        output_discard(context->output, context->memory, output.blob);
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    }
    stats.ms.boxes = clock_ms() - written;
    complete(request, &output, ret_result);
    *ret_blob = output.blob;
    *ret_stats = stats;
    return BVHD_OK;
}

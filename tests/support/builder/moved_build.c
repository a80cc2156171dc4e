/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/moved_build.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "builder/input/prepare.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"

/* Exchanges the axes of a point, and stretches one. */
static void move_point(float point[3])
{
    const float x = point[0];
    point[0] = 3 * point[1];
    point[1] = point[2];
    point[2] = x;
}

static void move_geometry(unsigned char *block, const struct form_geometry *row)
{
    float *data = (float *)(void *)(block + row->data_offset);
    for (uint32_t i = 0; row->type == GEOMETRY_TRIANGLES && i < row->vertex_count; i++)
        move_point(data + 3 * (size_t)i);
    for (uint32_t i = 0; row->type == GEOMETRY_AABBS && i < row->primitive_count; i++) {
        if (isnan(data[6 * (size_t)i]))
            continue; /* the canonical form of an inactive box */
        move_point(data + 6 * (size_t)i);
        move_point(data + 6 * (size_t)i + 3);
    }
    for (uint32_t i = 0; row->type == GEOMETRY_INSTANCES && i < row->primitive_count; i++)
        for (int axis = 0; axis < 3; axis++)
            data[16 * (size_t)i + 4 * (size_t)axis + 3] *= (float)(axis - 2);
}

/* Says what a request with ALLOW_UPDATE would have said. */
static void make_updatable(const struct canonical *canonical, struct form_geometry *row)
{
    if (canonical->flags & BUILD_ALLOW_UPDATE || row->type != GEOMETRY_TRIANGLES)
        return;
    row->update = FORM_UPDATE_RECORDED;
    row->vertex_format = 106; /* R32G32B32_SFLOAT */
    row->max_vertex = row->vertex_count > 0 ? row->vertex_count - 1 : 0;
    row->index_type = row->indexed ? INDEX_UINT32 : INDEX_NONE;
}

/* Opens a copy of the canonical copy with ALLOW_UPDATE. */
static enum bvhd_status copy(const struct canonical *canonical, bool moves, struct memory *memory,
                             struct canonical *ret_copy, struct bvhd_error *error)
{
    unsigned char *block = memory_alloc(memory, canonical->size);
    if (!block)
        return bvhd_error_no_memory(error, "copy", "no memory");
    memcpy(block, canonical->bytes, canonical->size);
    struct form_header *header = (void *)block;
    struct form_geometry *rows = (void *)(block + sizeof *header);
    header->flags |= BUILD_ALLOW_UPDATE;
    for (uint32_t g = 0; g < header->geometry_count; g++) {
        make_updatable(canonical, &rows[g]);
        if (moves)
            move_geometry(block, &rows[g]);
    }
    enum bvhd_status status = prepare_open((struct bytes){block, canonical->size}, memory, ret_copy, error);
    if (status == BVHD_OK)
        ret_copy->owned = block;
    else
        memory_free(memory, block);
    return status;
}

/* What exists after the first step. */
struct source {
    struct canonical before, after;
    unsigned char *blob;
    struct build_stats stats;
    struct record record, updated;
};

static enum bvhd_status build_source(const struct canonical *canonical, const struct build_options *options,
                                     const struct build_context *context, struct source *source,
                                     struct bvhd_error *error)
{
    enum bvhd_status status = copy(canonical, true, context->memory, &source->before, error);
    if (status == BVHD_OK)
        status = copy(canonical, false, context->memory, &source->after, error);
    if (status == BVHD_OK)
        status = record_make(&source->before, options, context, &source->record, error);
    if (status == BVHD_OK)
        status = record_make(&source->after, options, context, &source->updated, error);
    if (status == BVHD_OK)
        status = update_rules_check(&source->record, &source->updated, 0, error);
    if (status == BVHD_OK)
        status = build(&source->before, options, context, &source->blob, &source->stats, error);
    const struct bytes blob = {source->blob, source->stats.sizes.total};
    return status == BVHD_OK ? refit_measure(blob, &source->stats, context, &source->record, error) : status;
}

enum bvhd_status moved_build(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, unsigned char **ret_blob,
                             struct build_stats *ret_stats, struct bvhd_error *error)
{
    struct source source = {0};
    struct refit_result result;
    enum bvhd_status status = build_source(canonical, options, context, &source, error);
    const struct refit_request request = {
        {source.blob, source.stats.sizes.total}, &source.record, &source.after, &source.updated};
    if (status == BVHD_OK)
        status = refit(&request, context, ret_blob, ret_stats, &result, error);
    record_finish(&source.record, context->memory);
    record_finish(&source.updated, context->memory);
    prepare_finish(&source.before, context->memory);
    prepare_finish(&source.after, context->memory);
    memory_free(context->memory, source.blob);
    return status;
}

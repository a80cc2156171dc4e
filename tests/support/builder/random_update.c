/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_update.h"

#include <math.h>

#include "builder/input/prepare.h"
#include "builder/update/update_rules.h"
#include "tests/support/builder/random_input.h"

/* Makes the record of an item that has just been built. */
static enum bvhd_status begin(const struct build_input *input, const struct batch_item *item,
                              const struct build_context *context, struct record *ret_record, struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    const struct bytes blob = {item->blob, item->size};
    struct canonical canonical;
    enum bvhd_status status = prepare(input, 0, &limits, context, &canonical, error);
    if (status != BVHD_OK)
        return status;
    status = record_make(&canonical, &input->options, context, ret_record, error);
    prepare_finish(&canonical, context->memory);
    if (status != BVHD_OK)
        return status;
    const struct build_stats stats = {.quality = (enum build_quality)item->summary.quality};
    status = refit_measure(blob, &stats, context, ret_record, error);
    if (status != BVHD_OK)
        record_finish(ret_record, context->memory);
    return status;
}

static enum bvhd_status replace(const struct refit_request *request, const struct build_context *context,
                                struct batch_item *item, struct refit_result *ret_result, struct bvhd_error *error)
{
    struct build_stats stats;
    unsigned char *blob;
    enum bvhd_status status = update_rules_check(request->source_record, request->record, 0, error);
    if (status == BVHD_OK)
        status = refit(request, context, &blob, &stats, ret_result, error);
    if (status != BVHD_OK)
        return status;
    memory_free(context->memory, item->blob);
    item->blob = blob;
    item->size = stats.sizes.total;
    item->summary = summary_of(&stats, (enum target)item->summary.target);
    return BVHD_OK;
}

/* When it fails, nothing changes. */
static enum bvhd_status step(const struct build_input *input, const struct build_context *context,
                             struct batch_item *item, struct record *record, struct refit_result *ret_result,
                             struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct record source, now;
    enum bvhd_status status = record_open(record->bytes, &source, error);
    if (status != BVHD_OK)
        return status;
    status = prepare(input, 0, &limits, context, &canonical, error);
    if (status != BVHD_OK)
        return status;
    status = record_make(&canonical, &input->options, context, &now, error);
    if (status == BVHD_OK) {
        const struct refit_request request = {{item->blob, item->size}, &source, &canonical, &now};
        status = replace(&request, context, item, ret_result, error);
        record_finish(status == BVHD_OK ? record : &now, context->memory);
        if (status == BVHD_OK)
            *record = now;
    }
    prepare_finish(&canonical, context->memory);
    return status;
}

enum bvhd_status random_update_run(const struct random_update *update, struct random *random, struct batch_item *item,
                                   uint64_t *updates, struct bvhd_error *error)
{
    struct record record;
    enum bvhd_status status = begin(update->input, item, update->context, &record, error);
    if (status != BVHD_OK)
        return status;
    for (uint32_t left = random_below(random, update->most + 1); status == BVHD_OK && left > 0; left--) {
        struct refit_result result = {0};
        update->move(update->request, random);
        status = step(update->input, update->context, item, &record, &result, error);
        if (status == BVHD_OK && !(result.decay > 0 && isfinite(result.decay)))
            status = bvhd_error_set(error, BVHD_INTERNAL, "decay", "%g", result.decay);
        *updates += status == BVHD_OK;
    }
    record_finish(&record, update->context->memory);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/build_entry.h"

#include "builder/content_key.h"
#include "builder/input/prepare.h"
#include "builder/tier.h"
#include "builder/update/update_rules.h"
#include "proto/base/place.h"

/* The state of one call of build_entry_prepare. */
struct preparing {
    const struct build_input *input;
    uint32_t index;
    const struct build_entry_source *source;
    const struct build_context *context;
    struct build_entry *entry;
    struct bvhd_error *error;
};

static enum bvhd_status lost(const struct preparing *preparing)
{
    return build_entry_source_lost(&preparing->input->source_key, preparing->index, "the structure is not there",
                                   preparing->error);
}

static enum bvhd_status check_rules(const struct preparing *preparing)
{
    struct record source;
    if (!preparing->source)
        return lost(preparing);
    if (preparing->source->record.size == 0)
        return update_rules_not_updatable(preparing->index, preparing->error);
    enum bvhd_status status = record_open(preparing->source->record, &source, preparing->error);
    return status == BVHD_OK
               ? update_rules_check(&source, &preparing->entry->record, preparing->index, preparing->error)
               : status;
}

static enum bvhd_status find_key(const struct preparing *preparing)
{
    struct build_entry *entry = preparing->entry;
    const struct build_input *input = preparing->input;
    if (entry->is_update)
        return content_key_update(&entry->canonical, &entry->options, &input->source_key, preparing->context,
                                  &entry->key, preparing->error);
    entry->options.quality = tier_resolve(&entry->canonical, &input->options);
    return content_key(&entry->canonical, &entry->options, preparing->context, &entry->key, preparing->error);
}

/* An update without ALLOW_UPDATE gets a record, too, because that is what shows the difference to its source. */
static enum bvhd_status describe(const struct preparing *preparing)
{
    struct build_entry *entry = preparing->entry;
    const bool has_record = entry->is_update || entry->canonical.flags & BUILD_ALLOW_UPDATE;
    enum bvhd_status status = BVHD_OK;
    if (has_record)
        status = record_make(&entry->canonical, &entry->options, preparing->context, &entry->record, preparing->error);
    if (status == BVHD_OK && entry->is_update)
        status = check_rules(preparing);
    return status == BVHD_OK ? find_key(preparing) : status;
}

enum bvhd_status build_entry_prepare(const struct build_input *input, uint32_t index, const struct limits *limits,
                                     const struct build_entry_source *source, const struct build_context *context,
                                     struct build_entry *ret_entry, struct bvhd_error *error)
{
    struct build_entry entry = {.options = input->options, .is_update = input->mode == MODE_UPDATE};
    const struct preparing preparing = {input, index, source, context, &entry, error};
    enum bvhd_status status = prepare(input, index, limits, context, &entry.canonical, error);
    if (status != BVHD_OK)
        return status;
    status = describe(&preparing);
    if (status == BVHD_OK)
        *ret_entry = entry;
    else
        build_entry_finish(&entry, context->memory);
    return status;
}

static void describe_made(const struct build_entry *entry, const struct build_context *context,
                          const struct build_stats *stats, unsigned char *blob, struct build_made *ret_made)
{
    *ret_made = (struct build_made){blob, stats->sizes.total, summary_of(stats, entry->options.target)};
    ret_made->summary.peak_bytes = atomic_load_explicit(&context->memory->peak, memory_order_relaxed);
}

static enum bvhd_status make_build(struct build_entry *entry, const struct build_context *context,
                                   struct build_made *ret_made, struct bvhd_error *error)
{
    struct build_stats stats;
    unsigned char *blob;
    enum bvhd_status status = build(&entry->canonical, &entry->options, context, &blob, &stats, error);
    if (status != BVHD_OK)
        return status;
    if (entry->record.header)
        status = refit_measure((struct bytes){blob, stats.sizes.total}, &stats, context, &entry->record, error);
    if (status == BVHD_OK)
        describe_made(entry, context, &stats, blob, ret_made);
    else
        output_discard(context->output, context->memory, blob);
    return status;
}

static enum bvhd_status make_update(struct build_entry *entry, const struct build_entry_source *source,
                                    const struct build_context *context, struct build_made *ret_made,
                                    struct bvhd_error *error)
{
    struct record source_record;
    struct build_stats stats;
    struct refit_result result;
    unsigned char *blob;
    enum bvhd_status status = record_open(source->record, &source_record, error);
    if (status != BVHD_OK)
        return status;
    const struct refit_request request = {source->blob, &source_record, &entry->canonical, &entry->record};
    status = refit(&request, context, &blob, &stats, &result, error);
    if (status != BVHD_OK)
        return status;
    describe_made(entry, context, &stats, blob, ret_made);
    ret_made->summary.decay = result.decay;
    ret_made->summary.refits = result.refits;
    return BVHD_OK;
}

enum bvhd_status build_entry_make(struct build_entry *entry, const struct build_entry_source *source,
                                  const struct build_context *context, struct build_made *ret_made,
                                  struct bvhd_error *error)
{
    return entry->is_update ? make_update(entry, source, context, ret_made, error)
                            : make_build(entry, context, ret_made, error);
}

enum bvhd_status build_entry_source_lost(const struct key *key, uint32_t index, const char *what,
                                         struct bvhd_error *error)
{
    char text[KEY_TEXT_SIZE];
    key_to_text(key, text);
    return bvhd_error_set(error, BVHD_SOURCE_LOST, place("infos[%u].srcAccelerationStructure", index).text,
                          "%s: build it again; its key is %s", what, text);
}

void build_entry_finish(struct build_entry *entry, struct memory *memory)
{
    if (!entry)
        return;
    record_finish(&entry->record, memory);
    prepare_finish(&entry->canonical, memory);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The control messages that report outcomes: ERROR and RESULT. */
#include "proto/wire/control_codec.h"

#include "proto/wire/bvhd.pb-c.h"

enum bvhd_status control_pack_error(const struct bvhd_error *from, struct memory *memory, struct bytes *ret_bytes,
                                    struct bvhd_error *error)
{
    Bvhd__Error message;
    bvhd__error__init(&message);
    message.status = from->status;
    message.rule = from->vuid;
    message.where = control_constant(from->where);
    message.text = control_constant(from->text);
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_error(const void *from, void *ret_plain)
{
    const Bvhd__Error *message = from;
    struct bvhd_error *error = ret_plain;
    error->status = (enum bvhd_status)message->status;
    error->vuid = (enum bvhd_vuid)message->rule;
    control_copy_text(message->where, sizeof error->where, error->where);
    control_copy_text(message->text, sizeof error->text, error->text);
}

static const struct control_kind error_kind = {"error", &bvhd__error__descriptor, sizeof(struct bvhd_error), NULL,
                                               fill_error};
CONTROL_UNPACK(error, struct bvhd_error)

enum { BOUNDS_COUNT = 6, REACH_COUNT = 2 * SLABS_COUNT };

static void put_summary(const struct summary *summary, Bvhd__Result *message)
{
    message->primitives = summary->primitives;
    message->triangles = summary->triangles;
    message->instances = summary->instances;
    message->inactive = summary->inactive;
    message->degenerate = summary->degenerate;
    message->skipped = summary->skipped;
    message->refs = summary->refs;
    message->peak_bytes = summary->peak_bytes;
    message->depth = summary->depth;
    message->target = summary->target;
    message->quality = summary->quality;
    message->sah = control_double_bits(summary->sah);
    message->first_build_ms = control_double_bits(summary->build_ms);
    message->decay = control_double_bits(summary->decay);
    message->refits = summary->refits;
    message->method = control_constant(summary->method);
    message->n_bounds = BOUNDS_COUNT;
    message->bounds = control_constant(&summary->bounds);
    message->n_slabs = slabs_are_known(&summary->slabs) ? REACH_COUNT : 0;
    message->slabs = control_constant(&summary->slabs);
}

static void take_summary(const Bvhd__Result *message, struct summary *summary)
{
    summary->primitives = message->primitives;
    summary->triangles = message->triangles;
    summary->instances = message->instances;
    summary->inactive = message->inactive;
    summary->degenerate = message->degenerate;
    summary->skipped = message->skipped;
    summary->refs = message->refs;
    summary->peak_bytes = message->peak_bytes;
    summary->depth = message->depth;
    summary->target = message->target;
    summary->quality = message->quality;
    summary->sah = control_bits_double(message->sah);
    summary->build_ms = control_bits_double(message->first_build_ms);
    summary->decay = control_bits_double(message->decay);
    summary->refits = message->refits;
    control_copy_text(message->method, sizeof summary->method, summary->method);
    if (message->n_bounds > 0)
        memcpy(&summary->bounds, message->bounds, sizeof summary->bounds);
    if (message->n_slabs > 0)
        memcpy(&summary->slabs, message->slabs, sizeof summary->slabs);
}

enum bvhd_status control_pack_result(const struct control_result *result, struct memory *memory,
                                     struct bytes *ret_bytes, struct bvhd_error *error)
{
    Bvhd__Result message;
    bvhd__result__init(&message);
    message.item = result->item;
    message.status = result->error.status;
    message.rule = result->error.vuid;
    message.where = control_constant(result->error.where);
    message.text = control_constant(result->error.text);
    message.queued_ms = control_double_bits(result->queued_ms);
    message.prepare_ms = control_double_bits(result->prepare_ms);
    message.build_ms = control_double_bits(result->build_ms);
    if (result->error.status == BVHD_OK) {
        message.key = (ProtobufCBinaryData){sizeof result->key.bytes, control_constant(result->key.bytes)};
        message.size = result->size;
        message.origin = result->origin;
        put_summary(&result->summary, &message);
    }
    return control_encode(&message.base, memory, ret_bytes, error);
}

static enum bvhd_status check_result(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Result *message = from;
    bool keyless = message->key.len == 0 && message->status != BVHD_OK;
    if (message->key.len != KEY_SIZE && !keyless)
        return bvhd_error_set(error, BVHD_CORRUPT, "result.key", "%zu bytes", message->key.len);
    if (message->n_bounds != BOUNDS_COUNT && message->n_bounds != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "result.bounds", "%zu numbers", message->n_bounds);
    if (message->n_slabs != REACH_COUNT && message->n_slabs != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "result.slabs", "%zu numbers", message->n_slabs);
    *ret_extra = 0;
    return BVHD_OK;
}

static void fill_result(const void *from, void *ret_plain)
{
    const Bvhd__Result *message = from;
    struct control_result *result = ret_plain;
    result->item = message->item;
    result->error.status = (enum bvhd_status)message->status;
    result->error.vuid = (enum bvhd_vuid)message->rule;
    control_copy_text(message->where, sizeof result->error.where, result->error.where);
    control_copy_text(message->text, sizeof result->error.text, result->error.text);
    if (message->key.len > 0)
        memcpy(result->key.bytes, message->key.data, sizeof result->key.bytes);
    result->size = message->size;
    result->origin = message->origin;
    result->queued_ms = control_bits_double(message->queued_ms);
    result->prepare_ms = control_bits_double(message->prepare_ms);
    result->build_ms = control_bits_double(message->build_ms);
    take_summary(message, &result->summary);
}

static const struct control_kind result_kind = {"result", &bvhd__result__descriptor, sizeof(struct control_result),
                                                check_result, fill_result};
CONTROL_UNPACK(result, struct control_result)

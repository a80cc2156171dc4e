/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/reply.h"

struct reply *reply_create(enum frame_type type, uint64_t request, struct bytes control, struct memory *memory)
{
    struct reply *reply = memory_alloc(memory, sizeof *reply);
    if (!reply) {
        memory_free(memory, (void *)(uintptr_t)control.data);
        return NULL;
    }
    *reply = (struct reply){
        .header = {.type = (uint16_t)type, .control_size = (uint32_t)control.size, .request = request},
        .control = control,
        .memory = memory,
    };
    return reply;
}

struct reply *reply_result(uint64_t request, const struct control_result *result, struct blob *blob,
                           struct memory *memory)
{
    struct bytes control;
    if (control_pack_result(result, memory, &control, NULL) != BVHD_OK)
        return NULL;
    struct reply *reply = reply_create(FRAME_RESULT, request, control, memory);
    if (!reply)
        return NULL;
    reply->credits = 1;
    if (blob) {
        reply->blob = blob_ref(blob);
        reply->header.descriptors = blob->descriptor >= 0;
        reply->header.inline_size = blob->descriptor >= 0 ? 0 : (uint32_t)blob->size;
    }
    return reply;
}

struct reply *reply_error(uint64_t request, const struct bvhd_error *error, struct memory *memory)
{
    struct bytes control;
    if (control_pack_error(error, memory, &control, NULL) != BVHD_OK)
        return NULL;
    return reply_create(FRAME_ERROR, request, control, memory);
}

void reply_destroy(struct reply *reply)
{
    if (!reply)
        return;
    struct memory *memory = reply->memory;
    blob_unref(reply->blob);
    memory_free(memory, (void *)(uintptr_t)reply->control.data);
    memory_free(memory, reply);
}

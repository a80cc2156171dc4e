/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>

#include "proto/base/place.h"
#include "daemon/session/session_internal.h"
#include "builder/input/validate.h"

/*
 * The most memfds of one connection's requests at a time. Each is a descriptor first and a mapping later, of which a
 * process can have about 65,000.
 */
enum { MAX_ATTACHMENTS = 256 };

/* The contents of a BUILD frame, until it has become a request. */
struct intake {
    struct session *session;
    const struct frame *frame;
    const struct control_build *message;
    struct attachment *attachments[CONTROL_MAX_MEMFDS];
    uint32_t attachment_count; /* those whose descriptors are taken from the frame */
    struct payload *inlined; /* a copy of the inline bytes; NULL: no item lies there */
    struct bvhd_error *rules; /* one for each item: the rules between items that it breaks; NULL: not checked */
};

static struct service *service_of(const struct intake *intake)
{
    return intake->session->service;
}

static bool take_attachments(struct intake *intake)
{
    struct service *service = service_of(intake);
    for (uint32_t i = 0; i < intake->message->memfd_count; i++) {
        struct place where = place("memfds[%u]", i);
        struct payload_file file = {intake->frame->descriptors[i],
                                    intake->message->memfd_sizes[i],
                                    service->options.memory,
                                    where.text,
                                    &service->memory,
                                    intake->session->peer.share};
        intake->attachment_count++;
        intake->attachments[i] = attachment_create(&file);
        if (!intake->attachments[i])
            return false;
    }
    return true;
}

static bool take_inlined(struct intake *intake)
{
    const struct control_build *message = intake->message;
    bool used = false;
    for (uint32_t i = 0; i < message->item_count; i++)
        used = used || message->items[i].payload_source == SOURCE_INLINE;
    return !used ||
           payload_copy(intake->frame->inline_bytes, &service_of(intake)->inlines, &intake->inlined, NULL) == BVHD_OK;
}

static bool has_destinations(const struct control_build *message)
{
    for (uint32_t i = 0; message->item_count > 1 && i < message->item_count; i++)
        if (message->items[i].destination != 0)
            return true;
    return false;
}

/*
 * Checks the rules between items that their handles alone can break. The rules on references follow when the payloads
 * are read. False without memory.
 */
static bool check_batch(struct intake *intake)
{
    const struct control_build *message = intake->message;
    struct memory *memory = &service_of(intake)->memory;
    struct build_input *inputs = memory_array(memory, message->item_count, sizeof *inputs);
    intake->rules = memory_array(memory, message->item_count, sizeof *intake->rules);
    bool good = inputs && intake->rules;
    for (uint32_t i = 0; good && i < message->item_count; i++) {
        const struct control_item *item = &message->items[i];
        inputs[i] = (struct build_input){.mode = item->mode, .destination = item->destination, .source = item->source};
    }
    good = good && validate_batch(inputs, message->item_count, memory, intake->rules) == BVHD_OK;
    memory_free(memory, inputs);
    return good;
}

/* Makes the table of destinations by which a worker checks the rule on references. False without memory. */
static bool list_destinations(struct intake *intake, struct request *request)
{
    const struct control_build *message = intake->message;
    struct memory *memory = &service_of(intake)->memory;
    struct handle_entry *scratch = memory_array(memory, message->item_count, sizeof *scratch);
    request->destinations = memory_array(memory, message->item_count, sizeof *request->destinations);
    bool good = scratch && request->destinations;
    for (uint32_t i = 0; good && i < message->item_count; i++)
        request->destinations[i] = (struct handle_entry){message->items[i].destination, i};
    if (good) {
        handle_sort(request->destinations, scratch, message->item_count);
        request->destination_count = message->item_count;
    }
    memory_free(memory, scratch);
    return good;
}

static int clamp_priority(int32_t priority)
{
    return priority < PRIORITY_LOW ? PRIORITY_LOW : priority > PRIORITY_HIGH ? PRIORITY_HIGH : priority;
}

static struct request *make_request(struct intake *intake)
{
    const struct control_build *message = intake->message;
    struct request_head head = {intake->frame->header.request, clamp_priority(message->priority), true,
                                message->item_count, message->deadline_ms};
    bool handles = has_destinations(message);
    if (handles && !check_batch(intake))
        return NULL;
    struct request *request = request_create(&intake->session->client, &head);
    if (request && handles && !list_destinations(intake, request)) {
        memory_free(&service_of(intake)->memory, request->destinations);
        memory_free(&service_of(intake)->memory, request);
        return NULL;
    }
    return request;
}

/* Where an item's payload lies: one of the two, borrowed, and its size in bytes. */
struct payload_place {
    struct payload *payload;
    struct attachment *attachment;
    uint64_t size;
};

static enum bvhd_status find_payload(const struct intake *intake, const struct control_item *item, const char *where,
                                     struct payload_place *ret_place, struct bvhd_error *error)
{
    const struct session *session = intake->session;
    switch (item->payload_source) {
    case SOURCE_INLINE:
        *ret_place = (struct payload_place){intake->inlined, NULL, intake->frame->inline_bytes.size};
        return BVHD_OK;
    case SOURCE_POOL:
        if (!session->pool)
            return bvhd_error_set(error, BVHD_INVALID, where, "the connection has no pool");
        *ret_place = (struct payload_place){session->pool, NULL, session_uses(session, SHARE_POOL)};
        return BVHD_OK;
    case SOURCE_MEMFD:
        if (item->memfd >= intake->message->memfd_count)
            return bvhd_error_set(error, BVHD_INVALID, where, "memfd %u, but the request has %u", item->memfd,
                                  intake->message->memfd_count);
        *ret_place =
            (struct payload_place){NULL, intake->attachments[item->memfd], intake->message->memfd_sizes[item->memfd]};
        return BVHD_OK;
    default:
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where, "payload source %u is not known", item->payload_source);
    }
}

static enum bvhd_status locate(const struct intake *intake, uint32_t index, struct item *item, struct bvhd_error *error)
{
    const struct control_item *asked = &intake->message->items[index];
    uint64_t most = service_of(intake)->options.memory;
    struct place where = place("infos[%u].payload", index);
    struct payload_place found = {0};
    if (intake->rules && intake->rules[index].status != BVHD_OK) {
        *error = intake->rules[index];
        return error->status;
    }
    enum bvhd_status status = find_payload(intake, asked, where.text, &found, error);
    if (status != BVHD_OK)
        return status;
    if (!bytes_reach(found.size, asked->payload_offset, 0, 0, asked->payload_size))
        return bvhd_error_set(error, BVHD_INVALID, where.text, "the region ends outside of its source");
    if (asked->payload_size > most)
        return bvhd_error_set(error, BVHD_TOO_LARGE, where.text, "more bytes than the service has");
    item->source = (struct preparation_source){
        .payload = found.payload ? payload_ref(found.payload) : NULL,
        .attachment = found.attachment ? attachment_ref(found.attachment) : NULL,
        .offset = asked->payload_offset,
        .size = asked->payload_size,
    };
    return BVHD_OK;
}

static void start_items(const struct intake *intake, struct request *request)
{
    struct session *session = intake->session;
    struct bvhd_error error;
    for (uint32_t i = 0; i < request->count; i++) {
        struct item *item = &request->items[i];
        item->asked = intake->message->items[i];
        if (locate(intake, i, item, &error) != BVHD_OK) {
            item_refuse(item, &error);
            continue;
        }
        item->pooled = item->asked.payload_source == SOURCE_POOL;
        session->pool_users += item->pooled;
        session->service->counters.payload_bytes += item->asked.payload_size;
        item_start(item);
    }
}

/* False if there is no memory for the request now. */
static bool start_request(struct intake *intake)
{
    if (!take_attachments(intake) || !take_inlined(intake))
        return false;
    struct request *request = make_request(intake);
    if (!request)
        return false;
    request->attachments = intake->message->memfd_count;
    request->inline_bytes = intake->inlined ? intake->frame->inline_bytes.size : 0;
    session_add(intake->session, request);
    start_items(intake, request);
    request_settle(request);
    return true;
}

/* Returns why what came with the request exceeds the client's shares for now, or NULL. */
static const char *refusal_of(const struct intake *intake)
{
    const struct user_member *member = &intake->session->client.member;
    uint32_t memfds = intake->message->memfd_count;
    if (session_uses(intake->session, SHARE_MEMFDS) + memfds > MAX_ATTACHMENTS ||
        !user_fits(member, SHARE_MEMFDS, memfds))
        return "too many memfds of its requests are under way";
    if (!user_fits(member, SHARE_INLINE, intake->frame->inline_bytes.size))
        return "its payloads inside frames take all of its share";
    return NULL;
}

static void intake_finish(struct intake *intake)
{
    session_drop_descriptors(intake->session, intake->frame, intake->attachment_count);
    for (uint32_t i = 0; i < intake->attachment_count; i++)
        attachment_unref(intake->attachments[i]);
    payload_unref(intake->inlined);
    memory_free(&service_of(intake)->memory, intake->rules);
}

static void take_message(struct session *session, const struct frame *frame, const struct control_build *message)
{
    struct intake intake = {.session = session, .frame = frame, .message = message};
    uint64_t number = frame->header.request;
    if (session_admits(session, number, message->item_count)) {
        const char *why = refusal_of(&intake);
        if (!why && !start_request(&intake))
            why = "there is no memory for the request";
        if (why)
            session_send_busy(session, number, why);
    }
    intake_finish(&intake);
}

enum bvhd_status session_build(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct memory *memory = session_memory(session);
    struct control_build *message;
    enum bvhd_status status = control_unpack_build(frame->control, memory, &message, error);
    if (status == BVHD_OK && message->memfd_count != frame->header.descriptors) {
        status = bvhd_error_set(error, BVHD_INVALID, "build.memfds", "%u memfds are described, but %u descriptors came",
                                message->memfd_count, frame->header.descriptors);
        memory_free(memory, message);
    }
    if (status != BVHD_OK) {
        session_drop_descriptors(session, frame, 0);
        return session_refuses(session, frame->header.request, status, error) ? BVHD_OK : status;
    }
    take_message(session, frame, message);
    memory_free(memory, message);
    return BVHD_OK;
}

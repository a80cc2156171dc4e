/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>

#include "daemon/session/session_internal.h"
#include "daemon/system/log.h"
#include "daemon/system/release.h"
#include "proto/base/validate_shape.h"

void session_drop_descriptors(struct session *session, const struct frame *frame, uint32_t first)
{
    for (uint32_t i = first; i < frame->header.descriptors; i++)
        release_descriptor(session->peer.share, frame->descriptors[i]);
}

/* A connection may hold a part of what its user has room for and has not promised to other connections. */
enum { HELD_DIVISOR = 8 };

static uint32_t most_items(const struct service_options *options)
{
    return options->credits < CONTROL_MAX_ITEMS ? options->credits : CONTROL_MAX_ITEMS;
}

static void welcome(struct session *session, uint64_t request)
{
    struct service *service = session->service;
    struct control_welcome message = {
        .version = CONTROL_VERSION,
        .software = "bvhd",
        .credits = service->options.credits,
        .max_items = most_items(&service->options),
        .max_control = FRAME_MAX_CONTROL,
        .max_inline = FRAME_MAX_INLINE,
        .max_pool = service->options.max_pool,
        .max_payload = service->options.memory,
        .builders = service->builders,
        .updates = true,
        .micromaps = validate_micromaps,
        .max_held = user_promise(&session->client.member, session->releases ? HELD_DIVISOR : 0),
    };
    struct bytes control;
    if (control_pack_welcome(&message, session_memory(session), &control, NULL) != BVHD_OK) {
        session_fail(session);
        return;
    }
    session->open = true;
    session_send(session, reply_create(FRAME_WELCOME, request, control, session_memory(session)));
}

static enum bvhd_status take_hello(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_hello *hello;
    if (session->open)
        return bvhd_error_set(error, BVHD_INVALID, "frame.type", "a second HELLO");
    enum bvhd_status status = control_unpack_hello(frame->control, session_memory(session), &hello, error);
    if (status != BVHD_OK)
        return status;
    if (hello->version_min <= CONTROL_VERSION && CONTROL_VERSION <= hello->version_max) {
        log_event(LOG_DEBUG, "hello", PEER_FORMAT " software=%s", PEER_VALUES(&session->peer),
                  log_quote(hello->software).text);
        session->progress_ms = hello->progress_ms;
        session->releases = hello->releases;
        memcpy(session->software, hello->software, sizeof session->software);
        welcome(session, frame->header.request);
    } else {
        status = bvhd_error_set(error, BVHD_INCOMPATIBLE, "hello.version",
                                "the client speaks versions %u to %u of the protocol, and the daemon speaks %d to %d",
                                hello->version_min, hello->version_max, CONTROL_VERSION, CONTROL_VERSION);
    }
    memory_free(session_memory(session), hello);
    return status;
}

/* Returns BVHD_OK if the session can have a pool of that size now, else why it cannot. */
static enum bvhd_status check_pool(const struct session *session, uint64_t size, struct bvhd_error *error)
{
    const struct service *service = session->service;
    if (service->draining)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "", "the service is about to end");
    if (session->pool_users > 0)
        return bvhd_error_set(error, BVHD_INVALID, "pool", "%u payloads in the old pool are still needed",
                              session->pool_users);
    if (size > service->options.max_pool)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "pool", "%" PRIu64 " bytes, at most %" PRIu64, size,
                              service->options.max_pool);
    uint64_t old = session_uses(session, SHARE_POOL);
    if (size > old && !user_fits(&session->client.member, SHARE_POOL, size - old))
        return bvhd_error_set(error, BVHD_BUSY, "pool", "other clients' pools leave no room");
    return BVHD_OK;
}

/* Takes the descriptor. The session keeps its old pool if the new one cannot be used. */
static enum bvhd_status replace_pool(struct session *session, int descriptor, uint64_t size, struct bvhd_error *error)
{
    struct service *service = session->service;
    struct payload_file file = {descriptor,         size, service->options.max_pool, "pool", &service->memory,
                                session->peer.share};
    struct payload *pool;
    enum bvhd_status status = payload_open_pool(&file, &pool, error);
    if (status != BVHD_OK)
        return status;
    payload_unref(session->pool);
    user_give(&session->client.member, SHARE_POOL, session_uses(session, SHARE_POOL));
    user_take(&session->client.member, SHARE_POOL, size);
    session->pool = pool;
    return BVHD_OK;
}

bool session_refuses(struct session *session, uint64_t request, enum bvhd_status status, const struct bvhd_error *error)
{
    if (status != BVHD_TOO_LARGE && status != BVHD_UNSUPPORTED)
        return false;
    session_send_error(session, request, error);
    return true;
}

static enum bvhd_status take_pool(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_pool *message;
    struct bvhd_error refusal;
    uint64_t request = frame->header.request;
    enum bvhd_status status = control_unpack_pool(frame->control, session_memory(session), &message, error);
    if (status == BVHD_OK && frame->header.descriptors != 1) {
        memory_free(session_memory(session), message);
        status =
            bvhd_error_set(error, BVHD_INVALID, "pool", "%u descriptors instead of one", frame->header.descriptors);
    }
    if (status != BVHD_OK) {
        session_drop_descriptors(session, frame, 0);
        return session_refuses(session, request, status, error) ? BVHD_OK : status;
    }
    uint64_t size = message->size;
    memory_free(session_memory(session), message);
    status = check_pool(session, size, &refusal);
    if (status == BVHD_OK)
        status = replace_pool(session, frame->descriptors[0], size, &refusal);
    else
        session_drop_descriptors(session, frame, 0);
    if (status == BVHD_OK)
        session_send_plain(session, FRAME_DONE, request);
    else if (status == BVHD_BUSY || status == BVHD_NO_MEMORY)
        session_send_busy(session, request, refusal.text);
    else
        session_send_error(session, request, &refusal);
    return BVHD_OK;
}

static void get_keys(struct session *session, uint64_t number, const struct control_get *message)
{
    struct request_head head = {number, PRIORITY_NORMAL, false, message->key_count, 0};
    if (!session_admits(session, number, message->key_count))
        return;
    struct request *request = request_create(&session->client, &head);
    if (!request) {
        session_send_busy(session, number, "there is no memory for the request");
        return;
    }
    session_add(session, request);
    for (uint32_t i = 0; i < message->key_count; i++)
        item_get(&request->items[i], &message->keys[i]);
    request_settle(request);
}

static enum bvhd_status take_get(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_get *message;
    uint64_t number = frame->header.request;
    enum bvhd_status status = control_unpack_get(frame->control, session_memory(session), &message, error);
    if (status != BVHD_OK)
        return session_refuses(session, number, status, error) ? BVHD_OK : status;
    get_keys(session, number, message);
    memory_free(session_memory(session), message);
    return BVHD_OK;
}

/* A request with an unknown number has ended already, which is no error: its end may have crossed the CANCEL. */
static enum bvhd_status take_cancel(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_items *message;
    struct memory *memory = session_memory(session);
    enum bvhd_status status = control_unpack_items(frame->control, memory, &message, error);
    if (status != BVHD_OK)
        return status;
    struct request *request = session_find(session, frame->header.request);
    for (uint32_t i = 0; request && i < message->count; i++)
        if (message->items[i] >= request->count)
            status = bvhd_error_set(error, BVHD_INVALID, "cancel.items", "item %u of a request with %u items",
                                    message->items[i], request->count);
    if (request && status == BVHD_OK && message->count == 0) {
        request_cancel(request);
    } else if (request && status == BVHD_OK) {
        for (uint32_t i = 0; i < message->count; i++)
            item_cancel(&request->items[message->items[i]]);
        request_settle(request);
    }
    memory_free(memory, message);
    return status;
}

static enum bvhd_status take_released(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_released *message;
    enum bvhd_status status = control_unpack_released(frame->control, session_memory(session), &message, error);
    if (status != BVHD_OK)
        return status;
    status = session_release(session, message->bytes, error);
    memory_free(session_memory(session), message);
    return status;
}

static void take_stats(struct session *session, uint64_t request)
{
    struct counters counters = service_counters(session->service);
    struct memory *memory = session_memory(session);
    struct bytes control;
    if (counters_pack(&counters, memory, &control, NULL) == BVHD_OK)
        session_send(session, reply_create(FRAME_COUNTERS, request, control, memory));
    else
        session_fail(session);
}

static void refuse_type(struct session *session, const struct frame *frame)
{
    struct bvhd_error error;
    session_drop_descriptors(session, frame, 0);
    bvhd_error_set(&error, BVHD_UNSUPPORTED, "frame.type", "frames of type %u are not known", frame->header.type);
    session_send_error(session, frame->header.request, &error);
}

/* Whether a frame of this type may come with descriptors. Frames of unknown types may: they are refused as a whole. */
static bool may_carry(const struct frame_header *header)
{
    bool known = header->type >= FRAME_HELLO && header->type <= FRAME_CLIENTS;
    return !known || header->type == FRAME_POOL || header->type == FRAME_BUILD || header->descriptors == 0;
}

static enum bvhd_status check_frame(const struct session *session, const struct frame_header *header,
                                    struct bvhd_error *error)
{
    bool starts = header->type == FRAME_BUILD || header->type == FRAME_GET;
    if (session->failure.status != BVHD_OK)
        *error = session->failure;
    else if (!session->open && header->type != FRAME_HELLO)
        bvhd_error_set(error, BVHD_INVALID, "frame.type", "a frame of type %u before HELLO", header->type);
    else if (header->request == 0 && header->type != FRAME_HELLO && header->type != FRAME_RELEASED)
        bvhd_error_set(error, BVHD_INVALID, "frame.request", "a request cannot have the number 0");
    else if (!may_carry(header))
        bvhd_error_set(error, BVHD_INVALID, "frame.descriptors", "%u descriptors came with a frame of type %u",
                       header->descriptors, header->type);
    else if (starts && session_find(session, header->request))
        bvhd_error_set(error, BVHD_INVALID, "frame.request", "the number %" PRIu64 " is in use", header->request);
    else
        return BVHD_OK;
    return error->status;
}

static enum bvhd_status dispatch(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    uint64_t request = frame->header.request;
    switch (frame->header.type) {
    case FRAME_HELLO:
        return take_hello(session, frame, error);
    case FRAME_POOL:
        return take_pool(session, frame, error);
    case FRAME_BUILD:
        return session_build(session, frame, error);
    case FRAME_GET:
        return take_get(session, frame, error);
    case FRAME_CANCEL:
        return take_cancel(session, frame, error);
    case FRAME_CACHE:
        return session_cache(session, frame, error);
    case FRAME_RELEASED:
        return take_released(session, frame, error);
    case FRAME_STATS:
        take_stats(session, request);
        return BVHD_OK;
    case FRAME_PING:
        session_send_plain(session, FRAME_PONG, request);
        return BVHD_OK;
    case FRAME_CLIENTS:
        return session_list_clients(session, frame, error);
    default:
        refuse_type(session, frame);
        return BVHD_OK;
    }
}

void session_count_broken(struct session *session, enum bvhd_status status)
{
    session->service->counters.protocol_errors += status != BVHD_NO_MEMORY;
}

enum bvhd_status session_frame(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct bvhd_error reason;
    enum bvhd_status status = check_frame(session, &frame->header, &reason);
    if (status == BVHD_OK)
        status = dispatch(session, frame, &reason);
    else
        session_drop_descriptors(session, frame, 0);
    service_pump(session->service);
    if (status != BVHD_OK) {
        session_count_broken(session, status);
        if (error)
            *error = reason;
    }
    return status;
}

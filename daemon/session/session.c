/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <inttypes.h>

#include "daemon/system/log.h"
#include "daemon/system/release.h"
#include "daemon/session/session_internal.h"

/* Of BUSY: longer the more there is to do. */
enum { RETRY_BASE_MS = 5, RETRY_ITEMS_A_MS = 16, RETRY_MAX_MS = 1000 };

static struct session *session_of(struct request_client *client)
{
    return (struct session *)(void *)((unsigned char *)client - offsetof(struct session, client));
}

/* ---- replies ---- */

void session_end(struct session *session, enum bvhd_status status, const char *text)
{
    if (session->failure.status != BVHD_OK)
        return;
    bvhd_error_set(&session->failure, status, "", "%s", text);
    log_event(LOG_WARNING, "session_ended", "uid=%u pid=%d why=%s", session->peer.uid, (int)session->peer.pid,
              log_quote(text).text);
    if (session->link.fail)
        session->link.fail(session->link.context, &session->failure);
}

static void fail(struct session *session)
{
    session_end(session, BVHD_NO_MEMORY, "no memory for a reply");
}

/* `reply` NULL: there was no memory for it. */
static void send_reply(struct session *session, struct reply *reply)
{
    if (reply)
        session->link.send(session->link.context, reply);
    else
        fail(session);
}

static void send_plain(struct session *session, enum frame_type type, uint64_t request)
{
    send_reply(session, reply_create(type, request, (struct bytes){0}, &session->service->replies));
}

static void send_error(struct session *session, uint64_t request, const struct bvhd_error *error)
{
    if (error->status == BVHD_UNAVAILABLE)
        session->service->counters.refused++;
    else
        session->service->counters.request_errors++;
    log_event(LOG_DEBUG, "request_refused", "request=%" PRIu64 " status=%s why=%s", request,
              bvhd_status_name(error->status), log_quote(error->text).text);
    send_reply(session, reply_error(request, error, &session->service->replies));
}

void session_send_busy(struct session *session, uint64_t request)
{
    struct service *service = session->service;
    uint32_t wait = RETRY_BASE_MS + service->under_way / RETRY_ITEMS_A_MS;
    struct control_busy busy = {wait < RETRY_MAX_MS ? wait : RETRY_MAX_MS};
    struct bytes control;
    service->counters.refused++;
    if (control_pack_busy(&busy, &service->replies, &control, NULL) == BVHD_OK)
        send_reply(session, reply_create(FRAME_BUSY, request, control, &service->replies));
    else
        fail(session);
}

/* ---- what requests report ---- */

static void report_result(struct request_client *client, const struct request *request,
                          const struct control_result *result, struct blob *blob)
{
    struct session *session = session_of(client);
    struct reply *reply = reply_result(request->number, result, blob, &session->service->replies);
    session->service->counters.result_bytes += blob ? blob->size : 0;
    if (reply && blob)
        session_backlog_add(session, blob->size);
    send_reply(session, reply);
}

static void report_prepared(struct request_client *client, const struct request *request,
                            const struct control_items *items)
{
    struct session *session = session_of(client);
    struct memory *memory = &session->service->replies;
    struct bytes control;
    if (items && control_pack_items(items, memory, &control, NULL) == BVHD_OK)
        send_reply(session, reply_create(FRAME_PREPARED, request->number, control, memory));
    else
        fail(session);
}

static void report_unpooled(struct request_client *client)
{
    session_of(client)->pool_users--;
}

static struct request **bucket_of(struct session *session, uint64_t number)
{
    return &session->requests[number % SESSION_BUCKETS];
}

static void destroy(struct session *session)
{
    struct service *service = session->service;
    if (session->previous)
        session->previous->next = session->next;
    else
        service->sessions = session->next;
    if (session->next)
        session->next->previous = session->previous;
    service->closing_count--;
    memory_free(&service->memory, session);
}

static void report_ended(struct request_client *client, struct request *request)
{
    struct session *session = session_of(client);
    struct request **at = bucket_of(session, request->number);
    while (*at != request)
        at = &(*at)->next;
    *at = request->next;
    session->request_count--;
    session->attachments -= request->attachments;
    if (session->closed && session->request_count == 0)
        destroy(session);
}

static void report_moved(struct request_client *client)
{
    session_backlog_review(session_of(client));
}

static const struct request_events events = {report_result, report_prepared, report_unpooled, report_moved,
                                             report_ended};

struct request *session_find(const struct session *session, uint64_t number)
{
    struct request *request = session->requests[number % SESSION_BUCKETS];
    while (request && request->number != number)
        request = request->next;
    return request;
}

void session_add(struct session *session, struct request *request)
{
    struct service *service = session->service;
    struct request **bucket = bucket_of(session, request->number);
    request->next = *bucket;
    *bucket = request;
    session->request_count++;
    session->attachments += request->attachments;
    session->under_way += request->count;
    service->under_way += request->count;
    service->counters.requests++;
    service->counters.items += request->count;
}

/* ---- quotas ---- */

/* When much is under way, nobody may have more of it than its share; that much is everybody's, whatever others do. */
static bool is_crowded(const struct session *session, uint32_t items)
{
    const struct service *service = session->service;
    uint64_t most = service->options.max_queue, sum = (uint64_t)service->under_way + items;
    uint64_t share = most / (service->session_count > 0 ? service->session_count : 1);
    bool within_share = (uint64_t)session->under_way + items <= share;
    return !within_share && (sum > most || (sum > most / 2 && session->under_way > 0));
}

bool session_admits(struct session *session, uint64_t request, uint32_t items)
{
    const struct service_options *options = &session->service->options;
    struct bvhd_error error = {0};
    if (session->service->draining)
        bvhd_error_set(&error, BVHD_UNAVAILABLE, "", "the service is about to end");
    else if (items == 0)
        bvhd_error_set(&error, BVHD_INVALID, "items", "a request without items");
    else if (items > options->credits - (session->under_way < options->credits ? session->under_way : options->credits))
        bvhd_error_set(&error, BVHD_TOO_LARGE, "items",
                       "%u items beside %u under way: the connection has credits for %u", items, session->under_way,
                       options->credits);
    if (error.status != BVHD_OK) {
        send_error(session, request, &error);
        return false;
    }
    if (!is_crowded(session, items) && !session_backlog_is_long(session))
        return true;
    session_send_busy(session, request);
    return false;
}

/* ---- frames ---- */

void session_drop_descriptors(struct session *session, const struct frame *frame, uint32_t first)
{
    for (uint32_t i = first; i < frame->header.descriptors; i++) {
        release_descriptor(frame->descriptors[i]);
        descriptors_give(&session->service->descriptors, 1);
    }
}

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
    };
    struct bytes control;
    if (control_pack_welcome(&message, &service->replies, &control, NULL) != BVHD_OK) {
        fail(session);
        return;
    }
    session->open = true;
    send_reply(session, reply_create(FRAME_WELCOME, request, control, &service->replies));
}

static enum bvhd_status take_hello(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_hello *hello;
    if (session->open)
        return bvhd_error_set(error, BVHD_INVALID, "frame.type", "HELLO again");
    enum bvhd_status status = control_unpack_hello(frame->control, &session->service->replies, &hello, error);
    if (status != BVHD_OK)
        return status;
    if (hello->version_min <= CONTROL_VERSION && CONTROL_VERSION <= hello->version_max) {
        log_event(LOG_DEBUG, "hello", "uid=%u pid=%d software=%s", session->peer.uid, (int)session->peer.pid,
                  log_quote(hello->software).text);
        welcome(session, frame->header.request);
    } else {
        status = bvhd_error_set(error, BVHD_INCOMPATIBLE, "hello.version",
                                "the client speaks versions %u to %u of the protocol, the daemon %d to %d",
                                hello->version_min, hello->version_max, CONTROL_VERSION, CONTROL_VERSION);
    }
    memory_free(&session->service->replies, hello);
    return status;
}

/* Says why there can be no pool of that size now; BVHD_OK when there can. */
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
    if (service->pool_bytes - session->pool_size + size > service->options.memory / 4)
        return bvhd_error_set(error, BVHD_BUSY, "pool", "other clients' pools leave no room");
    return BVHD_OK;
}

/* Takes the descriptor; the old pool goes only when the new one is good. */
static enum bvhd_status replace_pool(struct session *session, int descriptor, uint64_t size, struct bvhd_error *error)
{
    struct service *service = session->service;
    struct payload_file file = {descriptor, size, service->options.max_pool, "pool", &service->memory};
    struct payload *pool;
    enum bvhd_status status = payload_open_pool(&file, &pool, error);
    descriptors_give(&service->descriptors, 1);
    if (status != BVHD_OK)
        return status;
    payload_unref(session->pool);
    service->pool_bytes += size - session->pool_size;
    session->pool = pool;
    session->pool_size = size;
    return BVHD_OK;
}

/* A message that is whole, but asks for what this version does not do: the request's error, not the connection's. */
bool session_refuses(struct session *session, uint64_t request, enum bvhd_status status, const struct bvhd_error *error)
{
    if (status != BVHD_TOO_LARGE && status != BVHD_UNSUPPORTED)
        return false;
    send_error(session, request, error);
    return true;
}

static enum bvhd_status take_pool(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_pool *message;
    struct bvhd_error refusal;
    uint64_t request = frame->header.request;
    enum bvhd_status status = control_unpack_pool(frame->control, &session->service->replies, &message, error);
    if (status == BVHD_OK && frame->header.descriptors != 1) {
        memory_free(&session->service->replies, message);
        status =
            bvhd_error_set(error, BVHD_INVALID, "pool", "%u descriptors instead of one", frame->header.descriptors);
    }
    if (status != BVHD_OK) {
        session_drop_descriptors(session, frame, 0);
        return session_refuses(session, request, status, error) ? BVHD_OK : status;
    }
    uint64_t size = message->size;
    memory_free(&session->service->replies, message);
    status = check_pool(session, size, &refusal);
    if (status == BVHD_OK)
        status = replace_pool(session, frame->descriptors[0], size, &refusal);
    else
        session_drop_descriptors(session, frame, 0);
    if (status == BVHD_OK)
        send_plain(session, FRAME_DONE, request);
    else if (status == BVHD_BUSY || status == BVHD_NO_MEMORY)
        session_send_busy(session, request);
    else
        send_error(session, request, &refusal);
    return BVHD_OK;
}

static void get_keys(struct session *session, uint64_t number, const struct control_get *message)
{
    struct request_head head = {number, PRIORITY_NORMAL, false, message->key_count};
    if (!session_admits(session, number, message->key_count))
        return;
    struct request *request = request_create(&session->client, &head);
    if (!request) {
        session_send_busy(session, number);
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
    enum bvhd_status status = control_unpack_get(frame->control, &session->service->replies, &message, error);
    if (status != BVHD_OK)
        return session_refuses(session, number, status, error) ? BVHD_OK : status;
    get_keys(session, number, message);
    memory_free(&session->service->replies, message);
    return BVHD_OK;
}

/* A request that is not known has ended meanwhile. */
static enum bvhd_status take_cancel(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_items *message;
    struct memory *memory = &session->service->replies;
    enum bvhd_status status = control_unpack_items(frame->control, memory, &message, error);
    if (status != BVHD_OK)
        return status;
    struct request *request = session_find(session, frame->header.request);
    for (uint32_t i = 0; request && i < message->count; i++)
        if (message->items[i] >= request->count)
            status = bvhd_error_set(error, BVHD_INVALID, "cancel.items", "item %u of a request with %u",
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

static void take_stats(struct session *session, uint64_t request)
{
    struct counters counters = service_counters(session->service);
    struct memory *memory = &session->service->replies;
    struct bytes control;
    if (counters_pack(&counters, memory, &control, NULL) == BVHD_OK)
        send_reply(session, reply_create(FRAME_COUNTERS, request, control, memory));
    else
        fail(session);
}

static void refuse_type(struct session *session, const struct frame *frame)
{
    struct bvhd_error error;
    session_drop_descriptors(session, frame, 0);
    bvhd_error_set(&error, BVHD_UNSUPPORTED, "frame.type", "frames of type %u are not known", frame->header.type);
    send_error(session, frame->header.request, &error);
}

/* Which frames may come with descriptors; others are refused whole. */
static bool may_carry(const struct frame_header *header)
{
    bool known = header->type >= FRAME_HELLO && header->type <= FRAME_PING;
    return !known || header->type == FRAME_POOL || header->type == FRAME_BUILD || header->descriptors == 0;
}

static enum bvhd_status check_frame(const struct session *session, const struct frame_header *header,
                                    struct bvhd_error *error)
{
    bool starts = header->type == FRAME_BUILD || header->type == FRAME_GET;
    if (session->failure.status != BVHD_OK)
        *error = session->failure;
    else if (!session->open && header->type != FRAME_HELLO)
        bvhd_error_set(error, BVHD_INVALID, "frame.type", "type %u before HELLO", header->type);
    else if (header->request == 0 && header->type != FRAME_HELLO)
        bvhd_error_set(error, BVHD_INVALID, "frame.request", "a request with the number 0");
    else if (!may_carry(header))
        bvhd_error_set(error, BVHD_INVALID, "frame.descriptors", "%u with a frame of type %u", header->descriptors,
                       header->type);
    else if (starts && session_find(session, header->request))
        bvhd_error_set(error, BVHD_INVALID, "frame.request", "number %" PRIu64 " is in use", header->request);
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
    case FRAME_STATS:
        take_stats(session, request);
        return BVHD_OK;
    case FRAME_PING:
        send_plain(session, FRAME_PONG, request);
        return BVHD_OK;
    default:
        refuse_type(session, frame);
        return BVHD_OK;
    }
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
        session->service->counters.protocol_errors += status != BVHD_NO_MEMORY;
        if (error)
            *error = reason;
    }
    return status;
}

/* ---- life ---- */

enum bvhd_status session_open(struct service *service, const struct session_peer *peer, const struct session_link *link,
                              struct session **ret_session, struct bvhd_error *error)
{
    struct session *session = memory_alloc(&service->memory, sizeof *session);
    struct pool_flow *flow = session ? pool_flow_create(service->pool) : NULL;
    if (!flow) {
        memory_free(&service->memory, session);
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for another session");
    }
    *session = (struct session){.service = service, .peer = *peer, .link = *link};
    session->client = (struct request_client){.service = service, .events = &events, .flights = {.flow = flow}};
    session->next = service->sessions;
    if (session->next)
        session->next->previous = session;
    service->sessions = session;
    service->session_count++;
    *ret_session = session;
    return BVHD_OK;
}

void session_sent(struct session *session, const struct reply *reply)
{
    assert(reply->credits <= session->under_way);
    session->under_way -= reply->credits;
    session->service->under_way -= reply->credits;
    if (reply->blob)
        session_backlog_take(session, reply->blob->size);
}

void session_goodbye(struct session *session)
{
    if (!session->open || session->goodbye)
        return;
    session->goodbye = true;
    send_plain(session, FRAME_GOODBYE, 0);
}

bool session_is_open(const struct session *session)
{
    return session->open;
}

static void give_back(struct session *session)
{
    struct service *service = session->service;
    service->under_way -= session->under_way;
    service->pool_bytes -= session->pool_size;
    session_backlog_drop(session);
    service->session_count--;
    service->closing_count++;
    payload_unref(session->pool);
    session->pool = NULL;
    pool_flow_end(service->pool, session->client.flights.flow);
}

void session_close(struct session *session)
{
    if (!session)
        return;
    struct service *service = session->service;
    session->client.gone = true;
    for (int i = 0; i < SESSION_BUCKETS; i++) {
        struct request *next;
        for (struct request *request = session->requests[i]; request; request = next) {
            next = request->next;
            request_cancel(request);
        }
    }
    give_back(session);
    session->closed = true;
    if (session->request_count == 0)
        destroy(session);
    service_pump(service);
}

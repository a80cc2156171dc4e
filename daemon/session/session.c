/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <inttypes.h>

#include "daemon/system/log.h"
#include "daemon/system/release.h"
#include "daemon/session/session_internal.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"

/* How long BUSY asks a client to wait: 5 ms, and 1 ms for each 16 items that are under way, up to 1 s. */
enum { RETRY_BASE_MS = 5, RETRY_ITEMS_PER_MS = 16, RETRY_MAX_MS = 1000 };

static struct session *session_of(struct request_client *client)
{
    return container_of(client, struct session, client);
}

/* ---- replies ---- */

void session_end(struct session *session, enum bvhd_status status, const char *text)
{
    if (session->failure.status != BVHD_OK)
        return;
    bvhd_error_set(&session->failure, status, "", "%s", text);
    uint32_t suppressed;
    if (log_limit_pass(&session->service->ended_log, &suppressed))
        log_event(LOG_WARNING, "session_ended", PEER_FORMAT " why=%s suppressed=%u", PEER_VALUES(&session->peer),
                  log_quote(text).text, suppressed);
    if (session->link.fail)
        session->link.fail(session->link.context, &session->failure);
}

void session_fail(struct session *session)
{
    session_end(session, BVHD_NO_MEMORY, "no memory for a reply");
}

void session_send(struct session *session, struct reply *reply)
{
    if (!reply) {
        session_fail(session);
        return;
    }
    user_take(&session->client.member, SHARE_REPLIES, reply_size(reply));
    session->link.send(session->link.context, reply);
}

void session_send_plain(struct session *session, enum frame_type type, uint64_t request)
{
    session_send(session, reply_create(type, request, (struct bytes){0}, session_memory(session)));
}

/* Clients can cause refusals at will, so that only some of them are logged. */
static void log_refusal(struct session *session, uint64_t request, enum bvhd_status status, const char *why)
{
    uint32_t suppressed;
    if (log_limit_pass(&session->service->refused_log, &suppressed))
        log_event(LOG_INFO, "request_refused", PEER_FORMAT " request=%" PRIu64 " status=%s why=%s suppressed=%u",
                  PEER_VALUES(&session->peer), request, bvhd_status_name(status), log_quote(why).text, suppressed);
}

void session_send_error(struct session *session, uint64_t request, const struct bvhd_error *error)
{
    if (error->status == BVHD_UNAVAILABLE)
        session->service->counters.refused++;
    else
        session->service->counters.request_errors++;
    log_refusal(session, request, error->status, error->text);
    session_send(session, reply_error(request, error, session_memory(session)));
}

void session_send_busy(struct session *session, uint64_t request, const char *why)
{
    struct service *service = session->service;
    uint32_t wait = RETRY_BASE_MS + (uint32_t)service_uses(service, SHARE_ITEMS) / RETRY_ITEMS_PER_MS;
    struct control_busy busy = {wait < RETRY_MAX_MS ? wait : RETRY_MAX_MS};
    struct bytes control;
    service->counters.refused++;
    log_refusal(session, request, BVHD_BUSY, why);
    if (control_pack_busy(&busy, session_memory(session), &control, NULL) == BVHD_OK)
        session_send(session, reply_create(FRAME_BUSY, request, control, session_memory(session)));
    else
        session_fail(session);
}

/* ---- the reports of requests ---- */

static void report_result(struct request_client *client, const struct request *request,
                          const struct control_result *result, struct blob *blob)
{
    struct session *session = session_of(client);
    struct reply *reply = reply_result(request->number, result, blob, session_memory(session));
    session->service->counters.result_bytes += blob ? blob->size : 0;
    if (reply && blob)
        session_add_result(session, blob->size);
    session_send(session, reply);
}

static void report_prepared(struct request_client *client, const struct request *request,
                            const struct control_items *items)
{
    struct session *session = session_of(client);
    struct memory *memory = session_memory(session);
    struct bytes control;
    if (items && control_pack_items(items, memory, &control, NULL) == BVHD_OK)
        session_send(session, reply_create(FRAME_PREPARED, request->number, control, memory));
    else
        session_fail(session);
}

static void report_pool_released(struct request_client *client)
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
    list_remove(&service->sessions.all, &session->in_service);
    user_leave(&session->client.member);
    service->sessions.closing--;
    memory_free(&service->memory, session);
}

/* Counts requests with a deadline, so that they are looked at while there are any. */
static void note_deadline(struct session *session, const struct request *request, int by)
{
    if (request->deadline_ns == 0)
        return;
    session->with_deadline += (uint32_t)by;
    session->service->with_deadline += (uint32_t)by;
}

static void report_ended(struct request_client *client, struct request *request)
{
    struct session *session = session_of(client);
    struct request **at = bucket_of(session, request->number);
    while (*at != request)
        at = &(*at)->next;
    *at = request->next;
    session->request_count--;
    user_give(&client->member, SHARE_MEMFDS, request->attachments);
    note_deadline(session, request, -1);
    if (session->closed && session->request_count == 0)
        destroy(session);
}

static const struct request_events events = {
    .result = report_result,
    .prepared = report_prepared,
    .pool_released = report_pool_released,
    .ended = report_ended,
};

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
    user_take(&session->client.member, SHARE_MEMFDS, request->attachments);
    user_take(&session->client.member, SHARE_INLINE, request->inline_bytes);
    user_take(&session->client.member, SHARE_ITEMS, request->count);
    user_review(&session->client.member);
    note_deadline(session, request, 1);
    service->counters.requests++;
    service->counters.items += request->count;
}

/* ---- quotas ---- */

bool session_admits(struct session *session, uint64_t request, uint32_t items)
{
    const struct service_options *options = &session->service->options;
    uint64_t under_way = session_uses(session, SHARE_ITEMS);
    struct bvhd_error error = {0};
    if (session->service->draining)
        bvhd_error_set(&error, BVHD_UNAVAILABLE, "", "the service is about to end");
    else if (items == 0)
        bvhd_error_set(&error, BVHD_INVALID, "items", "the request has no items");
    else if (under_way + items > options->credits)
        bvhd_error_set(&error, BVHD_TOO_LARGE, "items",
                       "%u items beside %" PRIu64 " under way: the connection has credits for %u", items, under_way,
                       options->credits);
    if (error.status != BVHD_OK) {
        session_send_error(session, request, &error);
        return false;
    }
    bool crowded = !user_fits(&session->client.member, SHARE_ITEMS, items);
    if (!crowded && !session_is_behind(session))
        return true;
    session_send_busy(session, request,
                      crowded ? "the queue has no room beyond its share" : "it has not read its results");
    return false;
}

/* Cancelling may end requests, and with them remove them from their bucket: the search begins again after each. */
static struct request *find_overdue(struct session *session, uint64_t now_ns)
{
    for (int i = 0; i < SESSION_BUCKETS; i++)
        for (struct request *request = session->requests[i]; request; request = request->next)
            if (request->deadline_ns > 0 && now_ns >= request->deadline_ns)
                return request;
    return NULL;
}

void session_check_deadlines(struct session *session, uint64_t now_ns)
{
    struct request *request;
    while (session->with_deadline > 0 && (request = find_overdue(session, now_ns))) {
        note_deadline(session, request, -1);
        request->deadline_ns = 0;
        request_expire(request);
    }
}

/* ---- opening and closing ---- */

enum bvhd_status session_open(struct service *service, const struct session_peer *peer, const struct session_link *link,
                              struct session **ret_session, struct bvhd_error *error)
{
    struct session *session = memory_alloc(&service->memory, sizeof *session);
    if (!session)
        return bvhd_error_no_memory(error, "", "no memory for another session");
    *session = (struct session){.service = service, .peer = *peer, .link = *link, .opened_ns = clock_ns()};
    session->client = (struct request_client){.service = service, .peer = *peer, .events = &events};
    enum bvhd_status status = user_join(&service->users, peer->uid, &session->client.member, error);
    if (status != BVHD_OK) {
        memory_free(&service->memory, session);
        return status;
    }
    list_prepend(&service->sessions.all, &session->in_service);
    service->sessions.open++;
    *ret_session = session;
    return BVHD_OK;
}

void session_sent(struct session *session, const struct reply *reply)
{
    user_give(&session->client.member, SHARE_ITEMS, reply->credits);
    user_give(&session->client.member, SHARE_REPLIES, reply_size(reply));
    if (reply->blob && reply->header.descriptors == 0) {
        session_take_result(session, reply->blob->size);
        if (memory_queue_count(&session->service->preparing) > 0)
            service_pump(session->service);
    } else if (reply->blob && session->releases) {
        session->held += reply->blob->size;
    }
    session->progress_unsent -= reply->header.type == FRAME_PROGRESS;
}

void session_goodbye(struct session *session, const struct bvhd_error *reason)
{
    if (!session->open || session->goodbye)
        return;
    session->goodbye = true;
    struct reply *reply = reply_error(0, reason, session_memory(session));
    if (reply)
        reply->header.type = FRAME_GOODBYE;
    session_send(session, reply);
}

bool session_is_idle(const struct session *session)
{
    return session->open && session->request_count == 0 && !session->cache_task &&
           session_uses(session, SHARE_RESULTS) == 0;
}

uint32_t session_siblings(const struct session *session)
{
    return session->client.member.user->members;
}

bool session_is_open(const struct session *session)
{
    return session->open;
}

static void give_back(struct session *session)
{
    struct service *service = session->service;
    struct user_member *member = &session->client.member;
    user_give(member, SHARE_ITEMS, session_uses(session, SHARE_ITEMS));
    user_give(member, SHARE_POOL, session_uses(session, SHARE_POOL));
    user_give(member, SHARE_REPLIES, session_uses(session, SHARE_REPLIES));
    user_give(member, SHARE_FRAMES, session_uses(session, SHARE_FRAMES));
    user_promise(member, 0);
    session_take_result(session, session_uses(session, SHARE_RESULTS));
    session_cache_leave(session);
    service->sessions.open--;
    service->sessions.closing++;
    payload_unref(session->pool);
    session->pool = NULL;
    user_end_flow(member);
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

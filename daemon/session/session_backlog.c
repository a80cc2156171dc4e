/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>

#include "daemon/session/session_internal.h"
#include "proto/base/container_of.h"

/* The share of one session, and that of all sessions together: the budget divided by these. */
enum { SESSION_DIVISOR = 8, ALL_DIVISOR = 2 };

bool session_backlog_is_long(const struct session *session)
{
    const struct service *service = session->service;
    bool crowded = service->sessions.backlog_bytes > service->options.memory / ALL_DIVISOR;
    return session->backlog.bytes > (crowded ? 0 : service->options.memory / SESSION_DIVISOR);
}

/* Holds the session's items while it is too far ahead of its client. Returns whether items were released. */
static bool hold(struct session *session)
{
    uint64_t ahead = session->backlog.bytes + session->client.started_bytes;
    bool hold = session_backlog_is_long(session) || ahead > session->service->options.memory / SESSION_DIVISOR;
    bool held = memory_lanes_are_held(&session->client.lanes);
    memory_queue_hold(&session->service->preparing, &session->client.lanes, hold);
    return held && !hold;
}

void session_backlog_review(struct session *session)
{
    if (!session->backlog.dropped)
        hold(session);
}

void session_backlog_drop(struct session *session)
{
    if (!session->backlog.dropped)
        session->service->sessions.backlog_bytes -= session->backlog.bytes;
    session->backlog.dropped = true;
}

/*
 * A result that many clients wait for counts once for each of them, but lies in memory once, and the cache has a budget
 * of its own. So the backlogs alone do not say that memory is short: no client has to go because all get the same.
 */
static bool is_too_much(const struct service *service)
{
    uint64_t budget = service->options.memory;
    return service->sessions.backlog_bytes > budget && service_uncached_bytes(service) > budget;
}

static void end_longest(struct service *service)
{
    struct session *longest = NULL;
    for (struct list_link *link = service->sessions.all.first; link; link = link->next) {
        struct session *session = container_of(link, struct session, in_service);
        if (!session->backlog.dropped && (!longest || session->backlog.bytes > longest->backlog.bytes))
            longest = session;
    }
    if (!longest)
        return;
    session_backlog_drop(longest);
    session_end(longest, BVHD_TOO_LARGE, "the client does not read its results");
}

void session_backlog_add(struct session *session, uint64_t bytes)
{
    struct service *service = session->service;
    session->backlog.bytes += bytes;
    if (session->backlog.dropped)
        return;
    service->sessions.backlog_bytes += bytes;
    hold(session);
    if (is_too_much(service))
        end_longest(service);
}

void session_backlog_take(struct session *session, uint64_t bytes)
{
    assert(session->backlog.bytes >= bytes);
    session->backlog.bytes -= bytes;
    if (session->backlog.dropped)
        return;
    session->service->sessions.backlog_bytes -= bytes;
    if (hold(session))
        service_pump(session->service);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>

#include "daemon/session/session_internal.h"

/* Parts of the budget for requests and builds: for one session, for all of them. */
enum { PART_OF_ONE = 8, PART_OF_ALL = 2 };

bool session_backlog_is_long(const struct session *session)
{
    const struct service *service = session->service;
    bool crowded = service->backlog_bytes > service->options.memory / PART_OF_ALL;
    return session->backlog.bytes > (crowded ? 0 : service->options.memory / PART_OF_ONE);
}

/* What it has asked for waits while its backlog is long. Returns whether it no longer does. */
static bool hold(struct session *session)
{
    uint64_t ahead = session->backlog.bytes + session->client.ahead;
    bool hold = session_backlog_is_long(session) || ahead > session->service->options.memory / PART_OF_ONE;
    bool held = session->client.lanes[ADMISSION_LARGE].held;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        fair_queue_hold(&session->service->preparing[class], &session->client.lanes[class], hold);
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
        session->service->backlog_bytes -= session->backlog.bytes;
    session->backlog.dropped = true;
}

/*
 * A result that many wait for counts for each of them, but lies in memory once, and what the cache keeps is in its
 * budget. Nobody who reads has to go because all get the same.
 */
static bool is_too_much(const struct service *service)
{
    uint64_t live = atomic_load_explicit(&service->account.live_bytes, memory_order_relaxed),
             kept = cache_load(service->cache).bytes;
    uint64_t beside = live > kept ? live - kept : 0;
    return service->backlog_bytes > service->options.memory && beside > service->options.memory;
}

static void end_longest(struct service *service)
{
    struct session *longest = NULL;
    for (struct session *session = service->sessions; session; session = session->next)
        if (!session->backlog.dropped && (!longest || session->backlog.bytes > longest->backlog.bytes))
            longest = session;
    if (!longest)
        return;
    session_backlog_drop(longest);
    session_end(longest, BVHD_TOO_LARGE, "too much of what was asked for is not read");
}

void session_backlog_add(struct session *session, uint64_t bytes)
{
    struct service *service = session->service;
    session->backlog.bytes += bytes;
    if (session->backlog.dropped)
        return;
    service->backlog_bytes += bytes;
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
    session->service->backlog_bytes -= bytes;
    if (hold(session))
        service_pump(session->service);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/conn_group.h"

#include <assert.h>

#include "proto/base/clock.h"
#include "proto/base/container_of.h"

struct conn_limits conn_limits_default(void)
{
    return (struct conn_limits){
        .hello_ms = 5000,
        .stall_ms = 30000,
        .frame_ms = 300000,
        .linger_ms = 1000,
        .held_ms = 1000,
        .idle_ms = 1000,
        .retry_ms = 50,
        .share_bytes = 512 * 1024,
        .share_frames = 64,
        .share_us = 500,
        .large_from = 1024 * 1024,
        .large_most = 64,
        .queue_bytes = 4 * 1024 * 1024,
        .queue_replies = 1024,
    };
}

/*
 * A connection is costly if its work takes more than COSTLY_NS on average, and light if it takes LIGHT_NS or less. Once
 * the connections in `due` have taken DUE_SHARE_NS of an iteration, those of them that are not light wait with the
 * costly ones, since many of them together delay the loop as much. Costly ones are served until COSTLY_SHARE_NS have
 * passed.
 */
enum { COSTLY_NS = 300 * 1000, COSTLY_SHARE_NS = 2 * 1000 * 1000, LIGHT_NS = 50 * 1000, DUE_SHARE_NS = 1000 * 1000 };

/* Between two looks at deadlines, and at how far builds are, which sessions report as often as their clients want. */
enum { PROGRESS_MS = 100 };

static struct conn *member(struct list_link *link)
{
    return container_of(link, struct conn, link);
}

static struct conn *take_first(struct list *list)
{
    struct list_link *link = list_take_first(list);
    if (!link)
        return NULL;
    struct conn *conn = container_of(link, struct conn, due_link);
    conn->due_in = NULL;
    return conn;
}

static void append(struct list *list, struct conn *conn)
{
    conn->due_in = list;
    list_append(list, &conn->due_link);
}

static void ignore_idle(uv_idle_t *idle)
{
    (void)idle;
}

/* Makes connections that were put off due, and keeps the loop from waiting if any are due. */
static void prepare_next_iteration(struct conn_group *group)
{
    for (struct conn *conn; (conn = take_first(&group->later));)
        conn_group_due(group, conn);
    if (group->due.first || group->costly.first)
        uv_idle_start(&group->again, ignore_idle);
    else
        uv_idle_stop(&group->again);
}

/* The connection may be closed by its work, but the struct stays valid here: the loop frees it later. */
static void work(struct conn_group *group, struct conn *conn)
{
    uint64_t begin = uv_hrtime();
    group->working = conn;
    conn_work(conn);
    group->working = NULL;
    conn->cost_ns = (3 * conn->cost_ns + uv_hrtime() - begin) / 4;
}

static void report_progress(uv_timer_t *timer)
{
    struct conn_group *group = timer->data;
    uint64_t now_ns = clock_ns();
    for (struct list_link *link = group->all.first; link; link = link->next) {
        if (!member(link)->session)
            continue;
        session_check_deadlines(member(link)->session, now_ns);
        session_report_progress(member(link)->session, uv_now(group->loop));
    }
}

/* The timer stops with the last build and the last deadline, so that an idle daemon sleeps. */
static void watch_builds(struct conn_group *group)
{
    bool is_needed = service_is_building(group->service) || service_has_deadlines(group->service);
    if (!is_needed)
        uv_timer_stop(&group->progress);
    else if (!uv_is_active((const uv_handle_t *)&group->progress))
        uv_timer_start(&group->progress, report_progress, PROGRESS_MS, PROGRESS_MS);
}

static void work_off_due(uv_prepare_t *prepare)
{
    struct conn_group *group = prepare->data;
    struct conn *conn;
    for (uint64_t end = uv_hrtime() + DUE_SHARE_NS; (conn = take_first(&group->due));) {
        if (conn->cost_ns > LIGHT_NS && uv_hrtime() >= end)
            append(&group->costly, conn);
        else
            work(group, conn);
    }
    for (uint64_t end = uv_hrtime() + COSTLY_SHARE_NS; uv_hrtime() < end && (conn = take_first(&group->costly));)
        work(group, conn);
    prepare_next_iteration(group);
    watch_builds(group);
    if (group->changed)
        group->changed(group->context);
}

void conn_group_init(struct conn_group *group, uv_loop_t *loop, struct service *service,
                     const struct conn_limits *limits)
{
    *group = (struct conn_group){.loop = loop, .service = service, .limits = *limits};
    uv_prepare_init(loop, &group->prepare);
    uv_idle_init(loop, &group->again);
    uv_timer_init(loop, &group->progress);
    group->prepare.data = group->progress.data = group;
    uv_prepare_start(&group->prepare, work_off_due);
}

void conn_group_finish(struct conn_group *group)
{
    assert(!group->all.first);
    uv_close((uv_handle_t *)&group->prepare, NULL);
    uv_close((uv_handle_t *)&group->again, NULL);
    uv_close((uv_handle_t *)&group->progress, NULL);
}

uint32_t conn_group_count_uid(const struct conn_group *group, uint32_t uid)
{
    uint32_t count = 0;
    for (struct list_link *link = group->all.first; link; link = link->next)
        count += member(link)->peer.uid == uid;
    return count;
}

/* The order in which idle clients have to leave. */
static bool leaves_before(const struct conn *conn, const struct conn *other)
{
    uint32_t count = session_siblings(conn->session), others = other ? session_siblings(other->session) : 0;
    return !other || count > others || (count == others && conn_idle_since(conn) <= conn_idle_since(other));
}

bool conn_group_dismiss_idle(struct conn_group *group, uint32_t uid)
{
    struct conn *first = NULL;
    uint64_t now = uv_now(group->loop);
    for (struct list_link *link = group->all.first; link; link = link->next) {
        struct conn *conn = member(link);
        uint64_t since = conn_idle_since(conn);
        if (since != UINT64_MAX && now - since >= group->limits.idle_ms &&
            (uid == CONN_ANY_USER || conn->peer.uid == uid) && leaves_before(conn, first))
            first = conn;
    }
    if (!first)
        return false;
    uint32_t suppressed;
    if (log_limit_pass(&group->idle_log, &suppressed))
        log_event(LOG_INFO, "idle_dismissed", PEER_FORMAT " idle_ms=%llu suppressed=%u", PEER_VALUES(&first->peer),
                  (unsigned long long)(now - conn_idle_since(first)), suppressed);
    conn_dismiss(first);
    return true;
}

void conn_group_goodbye(struct conn_group *group)
{
    struct bvhd_error reason;
    bvhd_error_set(&reason, BVHD_UNAVAILABLE, "connection", "the daemon is about to end");
    for (struct list_link *link = group->all.first, *next; link; link = next) {
        next = link->next;
        conn_goodbye(member(link), &reason);
    }
}

bool conn_group_is_flushed(const struct conn_group *group)
{
    for (struct list_link *link = group->all.first; link; link = link->next)
        if (!conn_is_flushed(member(link)))
            return false;
    return true;
}

void conn_group_close(struct conn_group *group)
{
    while (group->all.first)
        conn_close(member(group->all.first));
}

static void count_changed(struct conn_group *group, int by)
{
    group->count = (uint32_t)((int)group->count + by);
    service_count_connections(group->service, group->count);
}

void conn_group_add(struct conn_group *group, struct conn *conn)
{
    list_prepend(&group->all, &conn->link);
    count_changed(group, 1);
}

void conn_group_remove(struct conn_group *group, struct conn *conn)
{
    if (conn->due_in)
        list_remove(conn->due_in, &conn->due_link);
    conn->due_in = NULL;
    list_remove(&group->all, &conn->link);
    count_changed(group, -1);
}

void conn_group_due(struct conn_group *group, struct conn *conn)
{
    if (conn->due_in || conn == group->working) /* conn_work itself checks everything that could be due */
        return;
    bool is_costly = conn->lost || conn->cost_ns > COSTLY_NS; /* a client that has left can be served last */
    append(is_costly ? &group->costly : &group->due, conn);
}

void conn_group_later(struct conn_group *group, struct conn *conn)
{
    if (!conn->due_in)
        append(&group->later, conn);
}

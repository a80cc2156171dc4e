/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/conn_group.h"

#include <assert.h>

struct conn_limits conn_limits_default(void)
{
    return (struct conn_limits){
        .hello_ms = 5000,
        .stall_ms = 30000,
        .linger_ms = 1000,
        .held_ms = 1000,
        .retry_ms = 50,
        .turn_bytes = 512 * 1024,
        .turn_frames = 64,
        .turn_us = 500,
        .queue_bytes = 4 * 1024 * 1024,
        .queue_replies = 1024,
    };
}

/*
 * Nanoseconds of work that make a connection costly; of a turn for those that are. When all others have taken TURN_NS
 * together, those of them that are not light either wait with the costly ones: that they are many is as bad.
 */
enum { COSTLY_NS = 300 * 1000, COSTLY_TURN_NS = 2 * 1000 * 1000, LIGHT_NS = 50 * 1000, TURN_NS = 1000 * 1000 };

static struct conn *take_first(struct conn **first, struct conn ***end)
{
    struct conn *conn = *first;
    if (!conn)
        return NULL;
    *first = conn->next_due;
    if (!*first)
        *end = first;
    conn->is_due = conn->waits_costly = false;
    return conn;
}

static void append_due(struct conn_group *group, struct conn *conn, bool costly)
{
    struct conn ***end = costly ? &group->costly_end : &group->due_end;
    conn->is_due = true;
    conn->waits_costly = costly;
    conn->next_due = NULL;
    **end = conn;
    *end = &conn->next_due;
}

static void ignore_idle(uv_idle_t *idle)
{
    (void)idle;
}

/* What was put off becomes due, and the loop does not wait before it. */
static void prepare_next_turn(struct conn_group *group)
{
    struct conn *conn = group->later;
    group->later = NULL;
    group->later_end = &group->later;
    for (struct conn *next; conn; conn = next) {
        next = conn->next_due;
        conn->is_later = false;
        conn_group_due(group, conn);
    }
    if (group->due || group->costly)
        uv_idle_start(&group->again, ignore_idle);
    else
        uv_idle_stop(&group->again);
}

/* The struct outlives its end: the loop frees it later. */
static void work(struct conn_group *group, struct conn *conn)
{
    uint64_t begin = uv_hrtime();
    group->working = conn;
    conn_work(conn);
    group->working = NULL;
    conn->cost_ns = (3 * conn->cost_ns + uv_hrtime() - begin) / 4;
}

static void take_turn(uv_prepare_t *prepare)
{
    struct conn_group *group = prepare->data;
    struct conn *conn;
    for (uint64_t end = uv_hrtime() + TURN_NS; (conn = take_first(&group->due, &group->due_end));) {
        if (conn->cost_ns > LIGHT_NS && uv_hrtime() >= end)
            append_due(group, conn, true);
        else
            work(group, conn);
    }
    for (uint64_t end = uv_hrtime() + COSTLY_TURN_NS;
         uv_hrtime() < end && (conn = take_first(&group->costly, &group->costly_end));)
        work(group, conn);
    prepare_next_turn(group);
    if (group->changed)
        group->changed(group->context);
}

void conn_group_init(struct conn_group *group, uv_loop_t *loop, struct service *service,
                     const struct conn_limits *limits)
{
    *group = (struct conn_group){.loop = loop, .service = service, .limits = *limits};
    group->due_end = &group->due;
    group->costly_end = &group->costly;
    group->later_end = &group->later;
    uv_prepare_init(loop, &group->turn);
    uv_idle_init(loop, &group->again);
    group->turn.data = group;
    uv_prepare_start(&group->turn, take_turn);
}

void conn_group_finish(struct conn_group *group)
{
    assert(!group->first);
    uv_close((uv_handle_t *)&group->turn, NULL);
    uv_close((uv_handle_t *)&group->again, NULL);
}

uint32_t conn_group_count_uid(const struct conn_group *group, uint32_t uid)
{
    uint32_t count = 0;
    for (const struct conn *conn = group->first; conn; conn = conn->next)
        count += conn->peer.uid == uid;
    return count;
}

void conn_group_goodbye(struct conn_group *group)
{
    for (struct conn *conn = group->first, *next; conn; conn = next) {
        next = conn->next;
        conn_goodbye(conn);
    }
}

bool conn_group_is_flushed(const struct conn_group *group)
{
    for (const struct conn *conn = group->first; conn; conn = conn->next)
        if (!conn_is_flushed(conn))
            return false;
    return true;
}

void conn_group_close(struct conn_group *group)
{
    while (group->first)
        conn_close(group->first);
}

static void count_changed(struct conn_group *group, int by)
{
    group->count = (uint32_t)((int)group->count + by);
    service_count_connections(group->service, group->count);
}

void conn_group_add(struct conn_group *group, struct conn *conn)
{
    conn->next = group->first;
    if (conn->next)
        conn->next->previous = conn;
    group->first = conn;
    count_changed(group, 1);
}

static void remove_from_list(struct conn **first, struct conn ***end, const struct conn *conn)
{
    struct conn **at = first;
    while (*at != conn)
        at = &(*at)->next_due;
    *at = conn->next_due;
    if (*end == &conn->next_due)
        *end = at;
}

void conn_group_remove(struct conn_group *group, struct conn *conn)
{
    if (conn->waits_costly)
        remove_from_list(&group->costly, &group->costly_end, conn);
    else if (conn->is_due)
        remove_from_list(&group->due, &group->due_end, conn);
    if (conn->is_later)
        remove_from_list(&group->later, &group->later_end, conn);
    conn->is_due = conn->is_later = conn->waits_costly = false;
    *(conn->previous ? &conn->previous->next : &group->first) = conn->next;
    if (conn->next)
        conn->next->previous = conn->previous;
    count_changed(group, -1);
}

void conn_group_due(struct conn_group *group, struct conn *conn)
{
    if (conn->is_due || conn->is_later || conn == group->working) /* its work ends with a look at everything */
        return;
    append_due(group, conn, conn->lost || conn->cost_ns > COSTLY_NS); /* who has left waits for nothing */
}

void conn_group_later(struct conn_group *group, struct conn *conn)
{
    if (conn->is_later || conn->is_due)
        return;
    conn->is_later = true;
    conn->next_due = NULL;
    *group->later_end = conn;
    group->later_end = &conn->next_due;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/conn_group.h"

#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

enum { DISCARD_READS = 16 /* from a broken client in one iteration of the loop */ };

static uint64_t now_of(const struct conn *conn)
{
    return uv_now(conn->group->loop);
}

static void send_reply(void *context, struct reply *reply)
{
    struct conn *conn = context;
    outbox_push(&conn->outbox, reply);
    conn_group_due(conn->group, conn);
}

/* Counts the client's socket, descriptors that belong to no complete frame yet, and those that it has not read. */
static uint32_t count_descriptors(const void *context)
{
    const struct conn *conn = context;
    return 1 + conn->inlet.parser.descriptor_count + conn->outbox.unread;
}

static void note_failure(void *context, const struct bvhd_error *error)
{
    struct conn *conn = context;
    conn->failed = true;
    conn->failure = *error;
    conn_group_due(conn->group, conn);
}

static void reply_done(void *context, struct reply *reply)
{
    struct conn *conn = context;
    if (conn->session)
        session_sent(conn->session, reply);
    reply_destroy(reply);
}

static void result_read(void *context, uint64_t bytes)
{
    struct conn *conn = context;
    if (conn->session)
        session_read(conn->session, bytes);
}

static void on_poll(uv_poll_t *poll, int status, int events)
{
    struct conn *conn = poll->data;
    conn->lost |= status < 0 || (events & UV_DISCONNECT);
    conn->readable |= (events & UV_READABLE) != 0;
    conn->writable |= (events & UV_WRITABLE) != 0;
    conn_group_due(conn->group, conn);
}

static void on_timer(uv_timer_t *timer)
{
    struct conn *conn = timer->data;
    conn_group_due(conn->group, conn);
}

static void on_closed(uv_handle_t *handle)
{
    struct conn *conn = handle->data;
    if (--conn->handles == 0)
        free(conn);
}

static void end_session(struct conn *conn)
{
    struct session *session = conn->session;
    conn->session = NULL;
    session_close(session);
}

void conn_close(struct conn *conn)
{
    end_session(conn);
    outbox_finish(&conn->outbox);
    if (conn->state != CONN_HELD)
        inlet_finish(&conn->inlet);
    conn->state = CONN_CLOSED;
    conn->group->large -= conn->is_large;
    conn_group_remove(conn->group, conn);
    uv_close((uv_handle_t *)&conn->poll, on_closed);
    uv_close((uv_handle_t *)&conn->timer, on_closed);
    inlet_close_socket(conn->socket, conn->peer.share);
    descriptor_share_close(conn->peer.share);
}

/* Ends the connection of a client that is gone or was given up. While descriptors are unread, the struct stays. */
static void leave(struct conn *conn)
{
    log_event(LOG_DEBUG, "disconnected", PEER_FORMAT, PEER_VALUES(&conn->peer));
    if (!outbox_is_unread(&conn->outbox)) {
        conn_close(conn);
        return;
    }
    end_session(conn);
    outbox_drop(&conn->outbox);
    inlet_finish(&conn->inlet);
    conn->state = CONN_HELD;
    uv_poll_stop(&conn->poll);
    shutdown(conn->socket, SHUT_RDWR);
    uint32_t interval = conn->group->limits.held_ms;
    uv_timer_start(&conn->timer, on_timer, interval, interval);
}

/* Sends the error to the client, and gives it linger_ms to read it. */
static void fail(struct conn *conn, const struct bvhd_error *error)
{
    uint32_t suppressed;
    if (log_limit_pass(&conn->group->broken_log, &suppressed))
        log_event(LOG_INFO, "connection_failed", PEER_FORMAT " status=%s where=%s why=%s suppressed=%u",
                  PEER_VALUES(&conn->peer), bvhd_status_name(error->status), log_quote(error->where).text,
                  log_quote(error->text).text, suppressed);
    end_session(conn);
    inlet_finish(&conn->inlet);
    struct reply *reply = reply_error(0, error, service_frame_memory(conn->group->service));
    if (reply)
        outbox_push(&conn->outbox, reply);
    conn->state = CONN_ENDING;
    conn->readable = true;
    conn->reading_waits = conn->reading_full = conn->failed = false;
    conn->hello_by = conn->read_by = conn->frame_by = conn->leave_by = 0;
    conn->end_by = now_of(conn) + conn->group->limits.linger_ms;
}

/* Ends the connection of a client that broke the protocol before a frame was whole, which the session cannot see. */
static void fail_broken(struct conn *conn, const struct bvhd_error *error)
{
    session_count_broken(conn->session, error->status);
    fail(conn, error);
}

static bool is_queue_full(const struct conn *conn)
{
    const struct conn_limits *limits = &conn->group->limits;
    return conn->outbox.bytes >= limits->queue_bytes || conn->outbox.replies >= limits->queue_replies ||
           (conn->outbox.replies > 0 && conn->session && session_is_talkative(conn->session));
}

static void take_frame(struct conn *conn, const struct frame *frame)
{
    struct bvhd_error error;
    if (session_frame(conn->session, frame, &error) != BVHD_OK) {
        fail(conn, &error);
    } else if (conn->hello_by && session_is_open(conn->session)) {
        conn->hello_by = 0;
        inlet_open(&conn->inlet);
    }
}

/*
 * Reads from the socket once, if the client's share has room for the frame under way. Returns whether frames may be
 * complete now; *bytes grows by the bytes read.
 */
static bool receive(struct conn *conn, uint64_t *bytes)
{
    struct bvhd_error error;
    uint64_t size;
    if (!session_set_frame(conn->session, inlet_wanted(&conn->inlet))) {
        conn->reading_waits = true;
        return false;
    }
    enum inlet_result result = inlet_receive(&conn->inlet, &size, &error);
    *bytes += size;
    conn->readable = result == INLET_DATA || result == INLET_SHORT;
    conn->reading_waits = result == INLET_SHORT;
    conn->lost |= result == INLET_END;
    if (result == INLET_BROKEN)
        fail_broken(conn, &error);
    return result == INLET_DATA || result == INLET_LAST;
}

/*
 * Reads and handles frames, up to the connection's share of one loop iteration. Returns whether any bytes were read or
 * frames handled.
 */
static bool take_frames(struct conn *conn)
{
    const struct conn_limits *limits = &conn->group->limits;
    uint64_t bytes = 0, end = uv_hrtime() + (uint64_t)limits->share_us * 1000;
    uint32_t frames = 0;
    while (conn->state == CONN_OPEN && !conn->failed && !(conn->reading_full = is_queue_full(conn))) {
        struct frame frame;
        struct bvhd_error error;
        bool found;
        if (frames >= limits->share_frames || bytes >= limits->share_bytes || (frames > 0 && uv_hrtime() >= end)) {
            conn_group_later(conn->group, conn);
            break;
        }
        if (inlet_next(&conn->inlet, &frame, &found, &error) != BVHD_OK) {
            fail_broken(conn, &error);
        } else if (found) {
            take_frame(conn, &frame);
            frames++;
        } else if (!conn->readable || !receive(conn, &bytes)) {
            break;
        }
    }
    if (conn->session)
        session_set_frame(conn->session, inlet_capacity(&conn->inlet)); /* it cannot be more than before */
    return bytes || frames;
}

/*
 * Reads and discards what a broken client still sends. If the socket were closed with unread bytes in it, the kernel
 * would reset the connection, and the client could not read the error.
 */
static void discard_input(struct conn *conn)
{
    for (int i = 0; conn->readable && i < DISCARD_READS; i++) {
        enum inlet_result result = inlet_discard(conn->socket, conn->peer.share);
        conn->lost |= result == INLET_END || result == INLET_SHORT;
        conn->readable = result == INLET_DATA;
    }
}

/* A shortage that the client's own user causes is no excuse: it may be that of descriptors in unfinished frames. */
static bool is_short_of_room(const struct conn *conn)
{
    return conn->reading_waits && descriptor_share_has_room(conn->peer.share, INLET_DESCRIPTORS);
}

static void read_frames(struct conn *conn)
{
    const struct conn_limits *limits = &conn->group->limits;
    uint64_t now = now_of(conn), begin;
    bool progress = take_frames(conn);
    bool waits_for_client = inlet_is_mid_frame(&conn->inlet, &begin) && conn->state == CONN_OPEN &&
                            !is_short_of_room(conn) && !conn->reading_full;
    if (!waits_for_client)
        conn->read_by = conn->frame_by = 0;
    else if (progress || !conn->read_by)
        conn->read_by = now + limits->stall_ms;
    if (waits_for_client && (!conn->frame_by || begin != conn->frame_begin))
        conn->frame_by = now + limits->frame_ms;
    conn->frame_begin = begin;
    if (progress) {
        conn->pause_ms = 0;
        conn->active_at = now;
    }
}

/* Returns whether the client keeps others of its user waiting by results that were sent and not read. */
static bool presses(const struct conn *conn)
{
    return conn->outbox.unread > 0 && conn->session && session_is_behind(conn->session);
}

/* A client that has read much may read more. One that reads nothing does not get there. */
static void make_room_for_results(struct conn *conn)
{
    const struct conn_limits *limits = &conn->group->limits;
    if (conn->is_large || conn->outbox.sent < limits->large_from || conn->group->large == limits->large_most)
        return;
    conn->is_large = true;
    conn->group->large++;
    outbox_make_large(&conn->outbox);
}

static void write_replies(struct conn *conn)
{
    bool progress;
    enum outbox_state state = outbox_flush(&conn->outbox, &progress);
    conn->lost |= state == OUTBOX_LOST;
    make_room_for_results(conn);
    conn->hint_failed = !progress && (conn->hint_failed || conn->writable);
    conn->writable = false;
    conn->writing = state;
    bool waits_for_client = state != OUTBOX_EMPTY && state != OUTBOX_WAITING; /* the latter: for other clients */
    if (!waits_for_client && !presses(conn))
        conn->write_by = 0;
    else if (progress || !conn->write_by)
        conn->write_by = now_of(conn) + conn->group->limits.stall_ms;
    if (progress) {
        conn->pause_ms = 0;
        conn->active_at = now_of(conn);
    }
    if (conn->reading_full && !is_queue_full(conn))
        conn_group_later(conn->group, conn);
    if (state == OUTBOX_EMPTY && conn->state == CONN_ENDING && !conn->write_shut)
        conn->write_shut = shutdown(conn->socket, SHUT_WR) == 0;
}

static bool has_passed(const struct conn *conn, uint64_t deadline)
{
    return deadline && now_of(conn) >= deadline;
}

static bool is_idle(const struct conn *conn)
{
    uint64_t begin;
    return conn->state == CONN_OPEN && !conn->failed && session_is_idle(conn->session) && !conn->outbox.first &&
           conn->outbox.unread == 0 && !inlet_is_mid_frame(&conn->inlet, &begin);
}

static void check_deadlines(struct conn *conn)
{
    if (has_passed(conn, conn->hello_by)) {
        struct bvhd_error error;
        bvhd_error_set(&error, BVHD_INVALID, "connection", "no HELLO within %u ms", conn->group->limits.hello_ms);
        fail_broken(conn, &error);
        write_replies(conn);
    }
    if (has_passed(conn, conn->read_by) || has_passed(conn, conn->frame_by) || has_passed(conn, conn->write_by)) {
        uint32_t suppressed;
        if (log_limit_pass(&conn->group->stalled_log, &suppressed))
            log_event(LOG_INFO, "client_stalled", PEER_FORMAT " replies=%u suppressed=%u", PEER_VALUES(&conn->peer),
                      conn->outbox.replies, suppressed);
        conn->lost = true;
    }
    if (has_passed(conn, conn->leave_by)) {
        conn->lost |= is_idle(conn);
        conn->leave_by = now_of(conn) + conn->group->limits.linger_ms;
    }
    conn->lost |= has_passed(conn, conn->end_by);
}

static void watch_socket(struct conn *conn)
{
    bool reads = !conn->reading_waits && !conn->reading_full;
    bool writes = conn->writing == OUTBOX_BLOCKED || (conn->writing == OUTBOX_UNREAD && !conn->hint_failed);
    int events = UV_DISCONNECT | (reads ? UV_READABLE : 0) | (writes ? UV_WRITABLE : 0);
    if (events != conn->watched)
        uv_poll_start(&conn->poll, events, on_poll);
    conn->watched = events;
}

static void set_timer(struct conn *conn)
{
    const struct conn_limits *limits = &conn->group->limits;
    bool waits = conn->reading_waits || conn->writing == OUTBOX_UNREAD || conn->writing == OUTBOX_WAITING;
    conn->retry_at = 0;
    if (waits || conn->outbox.unread > 0) {
        uint32_t doubled = conn->pause_ms ? 2 * conn->pause_ms : 1,
                 longest = waits ? limits->retry_ms : limits->held_ms;
        conn->pause_ms = doubled < longest ? doubled : longest;
        conn->retry_at = now_of(conn) + conn->pause_ms;
    }
    const uint64_t deadlines[] = {conn->hello_by, conn->read_by, conn->frame_by, conn->write_by,
                                  conn->leave_by, conn->end_by,  conn->retry_at};
    uint64_t next = 0, now = now_of(conn);
    for (size_t i = 0; i < sizeof deadlines / sizeof *deadlines; i++)
        if (deadlines[i] && (!next || deadlines[i] < next))
            next = deadlines[i];
    if (next)
        uv_timer_start(&conn->timer, on_timer, next > now ? next - now : 0, 0);
    else
        uv_timer_stop(&conn->timer);
}

static void work_held(struct conn *conn)
{
    if (!outbox_is_unread(&conn->outbox))
        conn_close(conn);
}

void conn_work(struct conn *conn)
{
    if (conn->state == CONN_HELD) {
        work_held(conn);
        return;
    }
    if (!conn->lost && conn->state == CONN_OPEN)
        read_frames(conn);
    if (conn->failed && conn->state == CONN_OPEN)
        fail(conn, &conn->failure);
    if (!conn->lost && conn->state == CONN_ENDING)
        discard_input(conn);
    if (!conn->lost)
        write_replies(conn);
    if (!conn->lost)
        check_deadlines(conn);
    if (conn->lost) {
        leave(conn);
        return;
    }
    if (conn->failed && conn->state == CONN_OPEN)
        conn_group_later(conn->group, conn); /* the session went on when a reply was written, and failed */
    watch_socket(conn);
    set_timer(conn);
}

uint64_t conn_idle_since(const struct conn *conn)
{
    return is_idle(conn) && !conn->leave_by && !conn->readable ? conn->active_at : UINT64_MAX;
}

void conn_dismiss(struct conn *conn)
{
    struct bvhd_error reason;
    bvhd_error_set(&reason, BVHD_BUSY, "connection",
                   "there is no room for clients that ask for nothing; connect again with the next request");
    conn->leave_by = now_of(conn) + conn->group->limits.linger_ms;
    conn_goodbye(conn, &reason);
}

void conn_goodbye(struct conn *conn, const struct bvhd_error *reason)
{
    if (conn->session && session_is_open(conn->session))
        session_goodbye(conn->session, reason);
    else if (conn->state == CONN_OPEN)
        conn->lost = true;
    conn_group_due(conn->group, conn);
}

bool conn_is_flushed(const struct conn *conn)
{
    return !conn->outbox.first;
}

static void init(struct conn *conn, int socket)
{
    static const struct outbox_events events = {.done = reply_done, .read = result_read};
    conn->socket = socket;
    inlet_init(&conn->inlet, socket, conn->peer.share, service_frame_memory(conn->group->service));
    outbox_init(&conn->outbox, socket, conn->peer.share, &events, conn);
    uv_timer_init(conn->group->loop, &conn->timer);
    conn->poll.data = conn->timer.data = conn;
    conn->handles = 2;
    conn->active_at = now_of(conn);
    conn->hello_by = now_of(conn) + conn->group->limits.hello_ms;
    conn_group_add(conn->group, conn);
    conn_group_due(conn->group, conn);
}

enum bvhd_status conn_open(struct conn_group *group, int socket, const struct session_peer *peer,
                           struct bvhd_error *error)
{
    struct conn *conn = calloc(1, sizeof *conn);
    enum bvhd_status status = conn ? BVHD_OK : bvhd_error_no_memory(error, "connection", "no memory for a connection");
    if (status == BVHD_OK) {
        conn->group = group;
        conn->peer = *peer;
        conn->peer.connection = ++group->opened;
        const struct session_link link = {
            .send = send_reply, .fail = note_failure, .context = conn, .descriptors = count_descriptors};
        status = session_open(group->service, &conn->peer, &link, &conn->session, error);
    }
    if (status == BVHD_OK && uv_poll_init(group->loop, &conn->poll, socket)) {
        session_close(conn->session);
        status = bvhd_error_set(error, BVHD_IO, "connection", "the event loop does not take its socket");
    }
    if (status != BVHD_OK) {
        free(conn);
        inlet_close_socket(socket, peer->share);
        descriptor_share_close(peer->share);
        return status;
    }
    init(conn, socket);
    log_event(LOG_DEBUG, "connected", PEER_FORMAT, PEER_VALUES(&conn->peer));
    return BVHD_OK;
}

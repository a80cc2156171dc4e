/* SPDX-License-Identifier: Apache-2.0 */
/* session_clients.c - FRAME_CLIENTS: the list of the daemon's clients, and of what each of them holds. */
#include <stdio.h>

#include "daemon/session/management.h"
#include "daemon/session/session_internal.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"

static uint32_t waiting_in(const struct memory_lanes *lanes)
{
    uint32_t count = 0;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        count += lanes->lanes[class].count;
    return count;
}

static uint32_t descriptors_of(const struct session *session)
{
    const struct session_link *link = &session->link;
    return (uint32_t)session_uses(session, SHARE_MEMFDS) + (link->descriptors ? link->descriptors(link->context) : 0);
}

static struct control_client describe(const struct session *session, uint64_t now)
{
    const struct request_client *requests = &session->client;
    struct pool_flow_load load = pool_flow_load(session->service->pool, requests->member.flow);
    struct control_client client = {
        .connection = session->peer.connection,
        .uid = session->peer.uid,
        .pid = session->peer.pid,
        .connected_ms = (now - session->opened_ns) / 1000000,
        .busy_ms = load.busy_ns / 1000000,
        .memory_bytes =
            requests->started_bytes + session_uses(session, SHARE_INLINE) + session_uses(session, SHARE_FRAMES),
        .result_bytes = session_uses(session, SHARE_RESULTS),
        .pool_bytes = session_uses(session, SHARE_POOL),
        .requests = session->request_count,
        .items = (uint32_t)session_uses(session, SHARE_ITEMS),
        .waiting = waiting_in(&requests->member.preparing) + waiting_in(&requests->member.building),
        .threads = load.threads,
        .descriptors = descriptors_of(session),
    };
    memcpy(client.software, session->software, sizeof client.software);
    return client;
}

/* Fills the list with what `viewer` may see. There is room for all sessions, or for as many as a list may have. */
static void fill(const struct session *viewer, uint32_t room, struct control_client_list *list)
{
    uint64_t now = clock_ns();
    bool sees_all = session_may_manage(viewer);
    for (struct list_link *link = viewer->service->sessions.all.first; link; link = link->next) {
        const struct session *session = container_of(link, struct session, in_service);
        if (session->closed)
            continue;
        list->total++;
        if (!sees_all && session->peer.uid != viewer->peer.uid)
            list->hidden++;
        else if (list->count < room)
            list->clients[list->count++] = describe(session, now);
    }
}

static void answer(struct session *session, uint64_t request)
{
    struct memory *memory = session_memory(session);
    uint32_t open = session->service->sessions.open, room = open < CONTROL_MAX_CLIENTS ? open : CONTROL_MAX_CLIENTS;
    struct control_client_list list = {.clients = memory_array(memory, room, sizeof *list.clients)};
    struct bytes control;
    enum bvhd_status status = BVHD_NO_MEMORY;
    if (list.clients) {
        fill(session, room, &list);
        status = control_pack_client_list(&list, memory, &control, NULL);
    }
    memory_free(memory, list.clients);
    if (status == BVHD_OK)
        session_send(session, reply_create(FRAME_CLIENT_LIST, request, control, memory));
    else
        session_fail(session);
}

enum bvhd_status session_list_clients(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct control_clients *message;
    struct bvhd_error refusal;
    enum bvhd_status status = control_unpack_clients(frame->control, session_memory(session), &message, error);
    if (status != BVHD_OK)
        return session_refuses(session, frame->header.request, status, error) ? BVHD_OK : status;
    bool all = message->all;
    memory_free(session_memory(session), message);
    if (all && session_check_management(session, "clients", &refusal) != BVHD_OK)
        session_send_error(session, frame->header.request, &refusal);
    else
        answer(session, frame->header.request);
    return BVHD_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* session_progress.c - tells a client how far its builds are, as often as it has asked for. */
#include "daemon/session/session_internal.h"

/* The least time between two reports of a session, whatever the client has asked for. */
enum { LEAST_MS = 100 };

/* Lists the items that have got on since the client was told. Returns their number. */
static uint32_t list_items(struct request *request, uint32_t *ret_items, uint32_t *ret_thousandths)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < request->count && count < CONTROL_MAX_ITEMS; i++) {
        struct item *item = &request->items[i];
        uint32_t thousandths = item->state == ITEM_JOINED ? flight_thousandths(&item->waiter) : 0;
        if (thousandths <= item->told_thousandths)
            continue;
        item->told_thousandths = thousandths;
        ret_items[count] = i;
        ret_thousandths[count++] = thousandths;
    }
    return count;
}

/* Without memory nothing is sent: progress is no answer that a client waits for. */
static void report(struct session *session, struct request *request)
{
    struct memory *memory = session_memory(session);
    uint32_t most = request->count < CONTROL_MAX_ITEMS ? request->count : CONTROL_MAX_ITEMS;
    uint32_t *lists = memory_array(memory, 2 * (uint64_t)most, sizeof *lists);
    struct control_progress progress = {.items = lists, .thousandths = lists + most};
    struct bytes control;
    if (!lists)
        return;
    progress.count = list_items(request, progress.items, progress.thousandths);
    if (progress.count > 0 && control_pack_progress(&progress, memory, &control, NULL) == BVHD_OK) {
        struct reply *reply = reply_create(FRAME_PROGRESS, request->number, control, memory);
        session->progress_unsent += reply != NULL;
        if (reply)
            session_send(session, reply);
    }
    memory_free(memory, lists);
}

void session_report_progress(struct session *session, uint64_t now_ms)
{
    uint32_t least = session->progress_ms > LEAST_MS ? session->progress_ms : LEAST_MS;
    if (session->progress_ms == 0 || session->progress_unsent > 0 || session->failure.status != BVHD_OK ||
        now_ms - session->progress_at < least)
        return;
    session->progress_at = now_ms;
    for (int bucket = 0; bucket < SESSION_BUCKETS; bucket++)
        for (struct request *request = session->requests[bucket]; request; request = request->next)
            if (request->open > 0)
                report(session, request);
}

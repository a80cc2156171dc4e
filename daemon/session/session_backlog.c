/* SPDX-License-Identifier: Apache-2.0 */
/* session_backlog.c - backpressure: results that the client has not read, or still holds, and unfinished frames. */
#include <inttypes.h>

#include "daemon/session/session_internal.h"

/* Starts what was held until now. */
static void resume(struct session *session)
{
    if (memory_queue_count(&session->service->preparing) > 0)
        service_pump(session->service);
}

void session_add_result(struct session *session, uint64_t bytes)
{
    user_take(&session->client.member, SHARE_RESULTS, bytes);
    user_take(&session->client.member, SHARE_AHEAD, bytes);
}

void session_take_result(struct session *session, uint64_t bytes)
{
    user_give(&session->client.member, SHARE_RESULTS, bytes);
    user_give(&session->client.member, SHARE_AHEAD, bytes);
}

/* A client that sends RELEASED holds what it has read, so that it counts until then. */
void session_read(struct session *session, uint64_t bytes)
{
    if (session->releases)
        return;
    session_take_result(session, bytes);
    resume(session);
}

enum bvhd_status session_release(struct session *session, uint64_t bytes, struct bvhd_error *error)
{
    if (!session->releases || bytes > session->held)
        return bvhd_error_set(error, BVHD_INVALID, "released.bytes",
                              "%" PRIu64 ", of %" PRIu64 " that the client holds", bytes, session->held);
    session->held -= bytes;
    session_take_result(session, bytes);
    resume(session);
    return BVHD_OK;
}

bool session_is_talkative(const struct session *session)
{
    return session_uses(session, SHARE_REPLIES) > 0 && share_is_over(&session->client.member.share, SHARE_REPLIES);
}

bool session_is_behind(const struct session *session)
{
    return session_uses(session, SHARE_RESULTS) > 0 && share_is_over(&session->client.member.share, SHARE_RESULTS);
}

bool session_set_frame(struct session *session, uint64_t bytes)
{
    struct user_member *member = &session->client.member;
    uint64_t before = session_uses(session, SHARE_FRAMES), charged = bytes > FRAME_KEEP ? bytes : 0;
    bool is_only_one = member->user->share.used[SHARE_FRAMES] == before;
    if (charged > before && !is_only_one && !user_fits(member, SHARE_FRAMES, charged - before))
        return false;
    user_give(member, SHARE_FRAMES, before);
    user_take(member, SHARE_FRAMES, charged);
    return true;
}

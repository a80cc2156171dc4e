/* SPDX-License-Identifier: Apache-2.0 */
/* session_backlog.c - backpressure: results that the client has not read, or still holds. */
#include "daemon/session/session_internal.h"

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

bool session_is_behind(const struct session *session)
{
    return session_uses(session, SHARE_RESULTS) > 0 && share_is_over(&session->client.member.share, SHARE_RESULTS);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/management.h"

#include <unistd.h>

#include "daemon/session/session_internal.h"

bool session_may_manage(const struct session *session)
{
    return session->peer.uid == 0 || session->peer.uid == geteuid();
}

enum bvhd_status session_check_management(const struct session *session, const char *what, struct bvhd_error *error)
{
    if (session_may_manage(session))
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_UNSUPPORTED, what,
                          "only root and the user whom the daemon runs as (uid %u) may do this, not uid %u",
                          (unsigned)geteuid(), session->peer.uid);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * management.h - decides who may manage the daemon: see what other users have under way, and change what concerns all
 * users.
 *
 * Root may, and the user whom the daemon runs as. The kernel says who a client is (SO_PEERCRED), so no request can
 * claim to be another user's.
 */
#ifndef BVHD_MANAGEMENT_H
#define BVHD_MANAGEMENT_H

#include <stdbool.h>

#include "proto/base/status.h"

struct session;

bool session_may_manage(const struct session *session);

/*
 * Returns BVHD_OK if the session may manage the daemon, else BVHD_UNSUPPORTED, with the rule as the text. `what` is the
 * request, for the error's place: "cache.clear".
 */
enum bvhd_status session_check_management(const struct session *session, const char *what, struct bvhd_error *error);

#endif

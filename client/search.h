/* SPDX-License-Identifier: Apache-2.0 */
/* search.h - one attempt to find a daemon on any of the places where its socket may be. */
#ifndef BVHD_SEARCH_H
#define BVHD_SEARCH_H

#include "client/address.h"
#include "client/connection.h"

/*
 * Tries the places in their order, and connects to the first one on which a daemon listens. `now` is for the
 * connection. BVHD_UNAVAILABLE: nobody listens on any of them, for the reasons and with the remedy in the error's text.
 * BVHD_BUSY: there is a daemon that takes no connection now. Other errors are those of connection_create.
 */
enum bvhd_status search_connect(const struct address *address, uint64_t now, struct connection **ret_connection,
                                struct bvhd_error *error);

#endif

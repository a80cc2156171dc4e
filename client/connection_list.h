/* SPDX-License-Identifier: Apache-2.0 */
/* connection_list.h - the service's connections in the form that programs get. */
#ifndef BVHD_CONNECTION_LIST_H
#define BVHD_CONNECTION_LIST_H

#include <bvhd/bvhd.h>

#include "proto/wire/control.h"

/* Makes the list from a message in library_memory. It takes the message over, even if it fails and returns NULL. */
struct bvhd_connections *connection_list_create(struct control_client_list *message);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* counter_list.h - the service's counters as its client gets them. */
#ifndef BVHD_COUNTER_LIST_H
#define BVHD_COUNTER_LIST_H

#include <bvhd/bvhd.h>

#include "proto/wire/control.h"

/* Takes the message, from library_memory, also when it fails and returns NULL. */
struct bvhd_counters *counter_list_create(struct control_counters *message);

#endif

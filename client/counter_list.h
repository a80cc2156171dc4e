/* SPDX-License-Identifier: Apache-2.0 */
/* counter_list.h - the service's counters in the form that programs get. */
#ifndef BVHD_COUNTER_LIST_H
#define BVHD_COUNTER_LIST_H

#include <bvhd/bvhd.h>

#include "proto/wire/control.h"

/* Makes the counters from a message in library_memory. It takes the message over, even if it fails and returns NULL. */
struct bvhd_counters *counter_list_create(struct control_counters *message);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* cache_state.h - what the service keeps, in the form that programs get. */
#ifndef BVHD_CACHE_STATE_H
#define BVHD_CACHE_STATE_H

#include <bvhd/bvhd.h>

#include "proto/wire/control.h"

/* Makes the state from a message in library_memory. It takes the message over, even if it fails and returns NULL. */
struct bvhd_cache_state *cache_state_create(struct control_cache_state *message);

#endif

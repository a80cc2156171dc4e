/* SPDX-License-Identifier: Apache-2.0 */
/* detached.h - starts a thread that nobody joins and that has all signals blocked. */
#ifndef BVHD_DETACHED_H
#define BVHD_DETACHED_H

#include <stdbool.h>

/* Runs run(context) on a new thread; its return value is ignored. Returns false when no thread could be started. */
bool detached_start(void *(*run)(void *context), void *context);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* detached.h - a thread that nobody waits for, and that takes no signals. */
#ifndef BVHD_DETACHED_H
#define BVHD_DETACHED_H

#include <stdbool.h>

/* False when the system has no more threads. */
bool detached_start(void *(*run)(void *context), void *context);

#endif

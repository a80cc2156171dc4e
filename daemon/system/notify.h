/* SPDX-License-Identifier: Apache-2.0 */
/* notify.h - what the service manager is told, and what it has handed over. Without one everything does nothing. */
#ifndef BVHD_NOTIFY_H
#define BVHD_NOTIFY_H

#include <stdint.h>

/* Started, with a line for people ("listening on ..."); leaving; alive. */
void notify_ready(const char *status);
void notify_stopping(const char *status);
void notify_alive(void);

/* Milliseconds between two notify_alive: half of what the manager waits. 0: it does not wait for them. */
uint64_t notify_interval_ms(void);

/*
 * How many sockets were handed over; the first is NOTIFY_FIRST_SOCKET. Takes the hint out of the environment: a second
 * call finds none. Negative: the error number.
 */
enum { NOTIFY_FIRST_SOCKET = 3 };
int notify_sockets(void);

#endif

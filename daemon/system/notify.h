/* SPDX-License-Identifier: Apache-2.0 */
/*
 * notify.h - talks to the service manager (systemd): what the daemon tells it, and which sockets it has handed over.
 * Without a service manager the notifications do nothing and the queries return 0. Loop thread only.
 */
#ifndef BVHD_NOTIFY_H
#define BVHD_NOTIFY_H

#include <stdint.h>

/* The daemon serves clients now. `status` is a line for people, such as "listening on ...". */
void notify_ready(const char *status);

/* The daemon is about to end. `status` is a line for people. */
void notify_stopping(const char *status);

/* The daemon still works; to be sent every notify_interval_ms(). */
void notify_alive(void);

/* Milliseconds between two notify_alive: half of the manager's timeout. 0: the manager expects none. */
uint64_t notify_interval_ms(void);

/*
 * Returns how many sockets the manager has handed over, or a negative error number. Their descriptors are consecutive
 * and begin at NOTIFY_FIRST_SOCKET. The call removes the variables from the environment, so a second one returns 0.
 */
enum { NOTIFY_FIRST_SOCKET = 3 };
int notify_sockets(void);

#endif

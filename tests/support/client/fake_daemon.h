/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fake_daemon.h - a daemon that answers as the test tells it, correctly or not; and one that answers by itself, on a
 * thread.
 *
 * For tests of the client library. The first kind runs in the test's own thread, alternating with calls of the library
 * that do not wait.
 */
#ifndef BVHD_FAKE_DAEMON_H
#define BVHD_FAKE_DAEMON_H

#include <pthread.h>
#include <stdatomic.h>

#include "tests/support/daemon/raw_client.h"

struct fake_daemon {
    char folder[64], path[96];
    int listener;
    struct raw_client peer; /* the connection that was accepted last; socket -1: none */
    struct control_welcome welcome;
    const unsigned char *pool; /* mapping of the client's pool; NULL: none */
    uint64_t pool_size;
    /* For the daemon that answers by itself: */
    pthread_t thread;
    atomic_int stop;
    atomic_uint answered; /* number of RESULTs */
};

/* Starts to listen in a new folder. */
void fake_start(struct fake_daemon *fake);

/* Closes everything and removes the folder. */
void fake_stop(struct fake_daemon *fake);

/* Stop listening, and listen again on the same path. */
void fake_close_listener(struct fake_daemon *fake);
void fake_open_listener(struct fake_daemon *fake);

/*
 * Accepts the next client; returns false if none comes within 10 s. The previous one is
 * disconnected, or moved to *keep if `keep` is not NULL.
 */
bool fake_accept(struct fake_daemon *fake, struct raw_client *keep);

/* Closes the connection. */
void fake_hang_up(struct fake_daemon *fake);

/*
 * Receives the next frame, which must have this type; its descriptors belong to the caller. Returns false if no frame,
 * or another one, comes within 10 s.
 */
bool fake_expect(struct fake_daemon *fake, enum frame_type type, struct frame *ret_frame);

/* Returns whether no frame comes within a short time. */
bool fake_is_quiet(struct fake_daemon *fake);

/* Accepts a client, receives HELLO and sends fake->welcome. */
bool fake_greet(struct fake_daemon *fake);

void fake_send(struct fake_daemon *fake, enum frame_type type, uint64_t request, struct bytes control);
void fake_send_welcome(struct fake_daemon *fake);
void fake_send_error(struct fake_daemon *fake, uint64_t request, enum bvhd_status status, const char *where,
                     const char *text);
void fake_send_busy(struct fake_daemon *fake, uint64_t request, uint32_t retry_ms);
void fake_send_prepared(struct fake_daemon *fake, uint64_t request, uint32_t first, uint32_t count);

/* Sends a result of `size` bytes, where byte i is i % 251: up to 64 KiB inline, otherwise in a sealed descriptor. */
void fake_send_result(struct fake_daemon *fake, uint64_t request, uint32_t item, uint64_t size);
void fake_send_failed(struct fake_daemon *fake, uint64_t request, uint32_t item, enum bvhd_status status,
                      const char *where);

/* Sends a result as given, even if it is invalid, with these bytes and this descriptor (-1: none), which is closed. */
void fake_send_result_with(struct fake_daemon *fake, uint64_t request, const struct control_result *result,
                           struct bytes inline_bytes, int descriptor);

/* Fills bytes as the result of an item is filled. */
void fake_fill(unsigned char *bytes, uint64_t size);

/* Unpacks the message of a BUILD; freed with fake_free. */
struct control_build *fake_build(struct fake_daemon *fake, const struct frame *frame);
void fake_free(struct fake_daemon *fake, void *message);

/* Receives POOL and answers DONE. */
bool fake_take_pool(struct fake_daemon *fake);

/*
 * Starts to answer on a thread, one connection after another: every item is prepared, and its result has as many bytes
 * as the item's destination states, or 100 if that is 0. Keys whose first byte is 0 are not found.
 */
void fake_serve(struct fake_daemon *fake);
void fake_serve_end(struct fake_daemon *fake);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wrong_frames.h - random requests of all kinds, most of them with something wrong: fields, sizes, descriptors, order.
 *
 * For test programs only. A seed repeats the same sequence, provided that answers come at the same times.
 */
#ifndef BVHD_WRONG_FRAMES_H
#define BVHD_WRONG_FRAMES_H

#include "tests/support/daemon/raw_client.h"

enum { WRONG_KEYS = 16 };

struct wrong_frames {
    uint64_t state;
    struct key keys[WRONG_KEYS]; /* keys of results that were received */
    uint32_t key_count;
    unsigned char *payloads; /* bytes that items refer to */
    uint64_t payload_size;
    unsigned char *pool; /* shared by all connections */
    /* memfds: of the pool; with all seals, as an attachment needs them; without any seal */
    int pool_file, sealed_file, wild_file;
};

void wrong_init(struct wrong_frames *wrong, uint64_t seed);

uint64_t wrong_next(struct wrong_frames *wrong);
uint64_t wrong_below(struct wrong_frames *wrong, uint64_t bound); /* 0 .. bound - 1 */

/* Connects, mostly with a HELLO and often with a pool. Returns false on failure. */
bool wrong_connect(struct wrong_frames *wrong, struct raw_client *client, const char *path);

/* Sends one frame and reads what has arrived. Returns false when the connection has ended, or should be closed. */
bool wrong_send(struct wrong_frames *wrong, struct raw_client *client);

#endif

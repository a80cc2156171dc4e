/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wrong_frames.h - random requests of all kinds, most of them with something wrong: fields, sizes, descriptors, order.
 *
 * For test programs only. A seed gives the same sequence again as far as answers come at the same time.
 */
#ifndef BVHD_WRONG_FRAMES_H
#define BVHD_WRONG_FRAMES_H

#include "tests/support/daemon/raw_client.h"

enum { WRONG_KEYS = 16 };

struct wrong_frames {
    uint64_t state;
    struct key keys[WRONG_KEYS]; /* of results that came */
    uint32_t key_count;
    unsigned char *payloads; /* what items point into */
    uint64_t payload_size;
    unsigned char *pool; /* shared with all connections */
    int pool_file, sealed_file, wild_file;
};

void wrong_init(struct wrong_frames *wrong, uint64_t seed);

uint64_t wrong_next(struct wrong_frames *wrong);
uint64_t wrong_below(struct wrong_frames *wrong, uint64_t bound); /* 0 .. bound - 1 */

/* Connects, mostly with a HELLO and often with a pool. False when that did not go well. */
bool wrong_connect(struct wrong_frames *wrong, struct raw_client *client, const char *path);

/* One frame, and reads what has come. False when the connection has ended, or should. */
bool wrong_send(struct wrong_frames *wrong, struct raw_client *client);

#endif

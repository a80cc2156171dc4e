/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/checksum.h"

enum { STRIPE = 32, LANES = 4 };

static const uint64_t prime[5] = {0x9e3779b185ebca87u, 0xc2b2ae3d27d4eb4fu, 0x165667b19e3779f9u, 0x85ebca77c2b2ae63u,
                                  0x27d4eb2f165667c5u};

static uint64_t rotate(uint64_t value, int bits)
{
    return value << bits | value >> (64 - bits);
}

static uint64_t take_word(uint64_t lane, uint64_t word)
{
    return rotate(lane + word * prime[1], 31) * prime[0];
}

/* Takes `count` stripes of 32 bytes, four lanes side by side. */
static void take_stripes(uint64_t sum_lanes[LANES], const unsigned char *at, uint64_t count)
{
    uint64_t lanes[LANES];
    memcpy(lanes, sum_lanes, sizeof lanes);
    for (; count > 0; count--, at += STRIPE)
        for (int i = 0; i < LANES; i++)
            lanes[i] = take_word(lanes[i], bytes_get64(at + 8 * i));
    memcpy(sum_lanes, lanes, sizeof lanes);
}

static uint64_t join_lanes(const uint64_t lanes[LANES])
{
    uint64_t sum = rotate(lanes[0], 1) + rotate(lanes[1], 7) + rotate(lanes[2], 12) + rotate(lanes[3], 18);
    for (int i = 0; i < LANES; i++)
        sum = (sum ^ take_word(0, lanes[i])) * prime[0] + prime[3];
    return sum;
}

static uint64_t take_rest(const unsigned char *at, uint64_t size, uint64_t sum)
{
    for (; size >= 8; size -= 8, at += 8)
        sum = rotate(sum ^ take_word(0, bytes_get64(at)), 27) * prime[0] + prime[3];
    if (size >= 4) {
        sum = rotate(sum ^ bytes_get32(at) * prime[0], 23) * prime[1] + prime[2];
        size -= 4;
        at += 4;
    }
    for (; size > 0; size--, at++)
        sum = rotate(sum ^ *at * prime[4], 11) * prime[0];
    return sum;
}

void checksum_init(struct checksum *sum, uint64_t seed)
{
    *sum = (struct checksum){{seed + prime[0] + prime[1], seed + prime[1], seed, seed - prime[0]}, .seed = seed};
}

void checksum_add(struct checksum *sum, struct bytes piece)
{
    uint64_t kept = sum->size % STRIPE, room = STRIPE - kept;
    sum->size += piece.size;
    if (kept && piece.size >= room) {
        memcpy(sum->rest + kept, piece.data, room);
        take_stripes(sum->lanes, sum->rest, 1);
        piece = (struct bytes){piece.data + room, piece.size - room};
        kept = 0;
    }
    if (kept == 0 && piece.size >= STRIPE) {
        take_stripes(sum->lanes, piece.data, piece.size / STRIPE);
        piece = (struct bytes){piece.data + piece.size / STRIPE * STRIPE, piece.size % STRIPE};
    }
    if (piece.size)
        memcpy(sum->rest + kept, piece.data, piece.size);
}

uint64_t checksum_get(const struct checksum *sum)
{
    uint64_t result = sum->size >= STRIPE ? join_lanes(sum->lanes) : sum->seed + prime[4];
    result = take_rest(sum->rest, sum->size % STRIPE, result + sum->size);
    result = (result ^ result >> 33) * prime[1];
    result = (result ^ result >> 29) * prime[2];
    return result ^ result >> 32;
}

uint64_t checksum(struct bytes data, uint64_t seed)
{
    struct checksum sum;
    checksum_init(&sum, seed);
    checksum_add(&sum, data);
    return checksum_get(&sum);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * checksum.h - a number by which damaged bytes are found: XXH64, as its author specifies it. It runs at the speed of
 * memory. It protects against damage and not against forgery, for which keys are (key.h).
 */
#ifndef BVHD_CHECKSUM_H
#define BVHD_CHECKSUM_H

#include "proto/base/bytes.h"

/* Returns the XXH64 of the bytes, which may have any alignment. */
uint64_t checksum(struct bytes data, uint64_t seed);

/* The XXH64 of bytes that come in pieces. All fields belong to checksum.c. */
struct checksum {
    uint64_t lanes[4], seed, size;
    unsigned char rest[32]; /* the last bytes that make no whole stripe */
};

/* Begin a sum, add the next piece, and return the sum of all pieces so far. */
void checksum_init(struct checksum *sum, uint64_t seed);
void checksum_add(struct checksum *sum, struct bytes piece);
uint64_t checksum_get(const struct checksum *sum);

#endif

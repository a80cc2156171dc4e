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

#endif

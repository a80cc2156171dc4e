/* SPDX-License-Identifier: Apache-2.0 */
/* number.h - reads whole numbers from options and files of options. */
#ifndef BVHD_NUMBER_H
#define BVHD_NUMBER_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/status.h"

/* The values that a number may have. */
struct number_range {
    uint64_t lowest, highest;
    bool is_size; /* the suffixes K, M and G are allowed: times 1024, 1024^2, 1024^3 */
};

/*
 * Reads decimal digits and nothing else. Returns BVHD_INVALID, with `where` as the place, if the text is not a number
 * or out of range.
 */
enum bvhd_status number_read(const char *where, const char *text, struct number_range range, uint64_t *ret_value,
                             struct bvhd_error *error);

/* Does the same for a range within 32 bits. */
enum bvhd_status number_read32(const char *where, const char *text, struct number_range range, uint32_t *ret_value,
                               struct bvhd_error *error);

#endif

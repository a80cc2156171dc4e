/* SPDX-License-Identifier: Apache-2.0 */
/* number.h - whole numbers as people write them in options and files of options. */
#ifndef BVHD_NUMBER_H
#define BVHD_NUMBER_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/status.h"

/* What a number may be. */
struct number_range {
    uint64_t lowest, highest;
    bool is_size; /* K, M or G may follow: times 1024, 1024^2, 1024^3 */
};

/* Decimal digits and nothing else. BVHD_INVALID at `where`, for what is no number or outside of the range. */
enum bvhd_status number_read(const char *where, const char *text, struct number_range range, uint64_t *ret_value,
                             struct bvhd_error *error);

/* The same for a range within 32 bits. */
enum bvhd_status number_read32(const char *where, const char *text, struct number_range range, uint32_t *ret_value,
                               struct bvhd_error *error);

#endif

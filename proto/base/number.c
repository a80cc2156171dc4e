/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/number.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static bool is_digit(char character)
{
    return character >= '0' && character <= '9';
}

enum bvhd_status number_read(const char *where, const char *text, struct number_range range, uint64_t *ret_value,
                             struct bvhd_error *error)
{
    char *end;
    errno = 0;
    uint64_t value = strtoull(text, &end, 10);
    const char *letters = "KMG", *letter = range.is_size && *end ? strchr(letters, *end) : NULL;
    unsigned shift = letter ? 10 * (unsigned)(letter - letters + 1) : 0;
    if (letter)
        end++;
    if (!is_digit(*text) || errno || *end || value > UINT64_MAX >> shift)
        return bvhd_error_set(error, BVHD_INVALID, where, "not a whole number: '%s'", text);
    if (value << shift < range.lowest || value << shift > range.highest)
        return bvhd_error_set(error, BVHD_INVALID, where, "not between %" PRIu64 " and %" PRIu64 ": '%s'", range.lowest,
                              range.highest, text);
    *ret_value = value << shift;
    return BVHD_OK;
}

enum bvhd_status number_read32(const char *where, const char *text, struct number_range range, uint32_t *ret_value,
                               struct bvhd_error *error)
{
    uint64_t value = 0;
    enum bvhd_status status = number_read(where, text, range, &value, error);
    if (status == BVHD_OK)
        *ret_value = (uint32_t)value;
    return status;
}

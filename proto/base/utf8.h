/* SPDX-License-Identifier: Apache-2.0 */
/* utf8.h - recognises UTF-8 in texts from outside. */
#ifndef BVHD_UTF8_H
#define BVHD_UTF8_H

#include <stdbool.h>

/*
 * Returns the number of bytes of the UTF-8 sequence at `at` in a NUL-terminated text, or 0 when it is not valid:
 * overlong, a surrogate, too large or truncated.
 */
static inline unsigned utf8_length(const unsigned char *at)
{
    unsigned char lead = at[0];
    if (lead < 0x80)
        return 1;
    unsigned length = lead >= 0xc2 && lead <= 0xdf   ? 2
                      : (lead & 0xf0) == 0xe0        ? 3
                      : lead >= 0xf0 && lead <= 0xf4 ? 4
                                                     : 0;
    for (unsigned i = 1; i < length; i++)
        if ((at[i] & 0xc0) != 0x80)
            return 0;
    if ((lead == 0xe0 && at[1] < 0xa0) || (lead == 0xed && at[1] > 0x9f) || (lead == 0xf0 && at[1] < 0x90) ||
        (lead == 0xf4 && at[1] > 0x8f))
        return 0;
    return length;
}

/* Returns whether a NUL-terminated text is valid UTF-8. */
static inline bool utf8_is_valid(const char *text)
{
    const unsigned char *at = (const unsigned char *)text;
    while (*at) {
        unsigned length = utf8_length(at);
        if (length == 0)
            return false;
        at += length;
    }
    return true;
}

#endif

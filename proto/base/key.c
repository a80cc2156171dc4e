/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/key.h"

void key_to_text(const struct key *key, char ret_text[KEY_TEXT_SIZE])
{
    static const char digits[] = "0123456789abcdef";
    for (int i = 0; i < KEY_SIZE; i++) {
        ret_text[2 * i] = digits[key->bytes[i] >> 4];
        ret_text[2 * i + 1] = digits[key->bytes[i] & 15];
    }
    ret_text[2 * KEY_SIZE] = '\0';
}

/* Returns -1 for every other character, the final NUL included. */
static int digit_value(char digit)
{
    if (digit >= '0' && digit <= '9')
        return digit - '0';
    if (digit >= 'a' && digit <= 'f')
        return digit - 'a' + 10;
    if (digit >= 'A' && digit <= 'F')
        return digit - 'A' + 10;
    return -1;
}

int key_from_text(const char *text, struct key *ret_key)
{
    struct key key;
    for (int i = 0; i < KEY_SIZE; i++) {
        int high = digit_value(text[2 * i]);
        int low = high < 0 ? -1 : digit_value(text[2 * i + 1]);
        if (low < 0)
            return -1;
        key.bytes[i] = (uint8_t)(high << 4 | low);
    }
    if (text[2 * KEY_SIZE] != '\0')
        return -1;
    *ret_key = key;
    return 0;
}

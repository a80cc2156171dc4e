/* SPDX-License-Identifier: Apache-2.0 */
/*
 * key.h - the names of immutable bytes: a key is a SHA-256 over everything that decides them. Equal keys mean equal
 * bytes.
 */
#ifndef BVHD_KEY_H
#define BVHD_KEY_H

#include <stdint.h>
#include <string.h>

enum { KEY_SIZE = 32, KEY_TEXT_SIZE = 65 };

struct key {
    uint8_t bytes[KEY_SIZE];
};

static inline int key_equal(const struct key *a, const struct key *b)
{
    return memcmp(a->bytes, b->bytes, KEY_SIZE) == 0;
}

/* No hash is 0, so a key whose bits are all 0 stands for none. */
static inline int key_is_zero(const struct key *key)
{
    static const struct key zero;
    return key_equal(key, &zero);
}

/* Writes lower-case hexadecimal digits and a NUL. */
void key_to_text(const struct key *key, char ret_text[KEY_TEXT_SIZE]);

/* Returns 0 on success, -1 unless `text` is exactly 64 hexadecimal digits. */
int key_from_text(const char *text, struct key *ret_key);

#endif

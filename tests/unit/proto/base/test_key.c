/* SPDX-License-Identifier: Apache-2.0 */
/* test_key.c - tests that keys survive the way to text and back, and that every other text is refused. */
#include "tests/support/unit.h"

#include "proto/base/key.h"

static struct key counting_key(void)
{
    struct key key;
    for (int i = 0; i < KEY_SIZE; i++)
        key.bytes[i] = (uint8_t)(i * 8 + 7);
    return key;
}

static void text_is_what_printf_says(void **state)
{
    (void)state;
    struct key key = counting_key();
    char expected[KEY_TEXT_SIZE], text[KEY_TEXT_SIZE];
    for (int i = 0; i < KEY_SIZE; i++)
        snprintf(expected + 2 * i, 3, "%02x", key.bytes[i]);
    key_to_text(&key, text);
    assert_string_equal(text, expected);
}

static void every_byte_survives(void **state)
{
    (void)state;
    for (int value = 0; value < 256; value++) {
        struct key key, back;
        memset(key.bytes, value, KEY_SIZE);
        memset(back.bytes, value + 1, KEY_SIZE);
        char text[KEY_TEXT_SIZE];
        key_to_text(&key, text);
        assert_int_equal(key_from_text(text, &back), 0);
        assert_true(key_equal(&key, &back));
    }
}

static void capitals_are_read(void **state)
{
    (void)state;
    struct key key;
    assert_int_equal(key_from_text("00000000000000000000000000000000000000000000000000000000ABCDEFab", &key), 0);
    assert_int_equal(key.bytes[28], 0xab);
    assert_int_equal(key.bytes[29], 0xcd);
    assert_int_equal(key.bytes[30], 0xef);
    assert_int_equal(key.bytes[31], 0xab);
}

static void anything_else_is_refused(void **state)
{
    (void)state;
    struct key key = counting_key(), untouched = key;
    char text[KEY_TEXT_SIZE + 1];
    key_to_text(&key, text);
    for (int length = 0; length < 64; length++) {
        char *cut = strndup(text, (size_t)length); /* on the heap, so that a sanitizer detects a read past the end */
        assert_int_equal(key_from_text(cut, &key), -1);
        free(cut);
    }
    for (int at = 0; at < 64; at++)
        for (int character = 1; character < 256; character++) {
            if (character < 128 && strchr("0123456789abcdefABCDEF", character))
                continue;
            char wrong[KEY_TEXT_SIZE];
            memcpy(wrong, text, sizeof wrong);
            wrong[at] = (char)character;
            assert_int_equal(key_from_text(wrong, &key), -1);
        }
    memcpy(text + 64, "0", 2);
    assert_int_equal(key_from_text(text, &key), -1);
    assert_true(key_equal(&key, &untouched));
}

static void one_bit_makes_another_key(void **state)
{
    (void)state;
    struct key key = counting_key();
    for (int bit = 0; bit < KEY_SIZE * 8; bit++) {
        struct key other = key;
        other.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        assert_false(key_equal(&key, &other));
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_is_what_printf_says),  cmocka_unit_test(every_byte_survives),
        cmocka_unit_test(capitals_are_read),         cmocka_unit_test(anything_else_is_refused),
        cmocka_unit_test(one_bit_makes_another_key),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

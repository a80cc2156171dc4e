/* SPDX-License-Identifier: Apache-2.0 */
/* test_checksum.c - tests that checksums are XXH64, by the vectors of its reference implementation. */
#include "tests/support/unit.h"

#include "proto/base/checksum.h"

static uint64_t of_text(const char *text, uint64_t seed)
{
    return checksum((struct bytes){(const unsigned char *)text, strlen(text)}, seed);
}

static void known_texts(void **state)
{
    (void)state;
    assert_int_equal(of_text("", 0), 0xef46db3751d8e999u);
    assert_int_equal(of_text("a", 0), 0xd24ec4f1a98c6e5bu);
    assert_int_equal(of_text("abc", 0), 0x44bc2cf5ad770999u);
    assert_int_equal(checksum((struct bytes){NULL, 0}, 0), 0xef46db3751d8e999u);
}

/* The reference's own test: pseudorandom bytes, of sizes on each path, with two seeds. */
static void known_bytes(void **state)
{
    enum { SIZE = 222 };
    static const uint64_t expected[][3] = {{0, 0xef46db3751d8e999u, 0xac75fda2929b17efu},
                                           {1, 0xe934a84adb052768u, 0x5014607643a9b4c3u},
                                           {4, 0x9136a0dca57457eeu, 0},
                                           {14, 0x8282dcc4994e35c8u, 0xc3bd6bf63deb6df0u},
                                           {222, 0xb641ae8cb691c174u, 0x20cb8ab7ae10c14au}};
    unsigned char data[SIZE];
    uint64_t generator = 2654435761u;
    (void)state;
    for (int i = 0; i < SIZE; i++) {
        data[i] = (unsigned char)(generator >> 56);
        generator *= 11400714785074694797u;
    }
    for (size_t i = 0; i < sizeof expected / sizeof expected[0]; i++) {
        struct bytes part = {data, expected[i][0]};
        assert_int_equal(checksum(part, 0), expected[i][1]);
        if (expected[i][2])
            assert_int_equal(checksum(part, 2654435761u), expected[i][2]);
    }
}

static void every_bit_counts(void **state)
{
    unsigned char data[100] = {0};
    (void)state;
    for (uint64_t size = 1; size <= sizeof data; size++) {
        uint64_t sum = checksum((struct bytes){data, size}, 0);
        for (uint64_t bit = 0; bit < 8 * size; bit++) {
            data[bit / 8] ^= (unsigned char)(1u << bit % 8);
            assert_int_not_equal(checksum((struct bytes){data, size}, 0), sum);
            data[bit / 8] ^= (unsigned char)(1u << bit % 8);
        }
    }
}

/* The sum does not depend on where the pieces end. */
static void pieces(void **state)
{
    unsigned char data[200];
    (void)state;
    for (unsigned i = 0; i < sizeof data; i++)
        data[i] = (unsigned char)(i * 37);
    for (uint64_t first = 0; first <= 100; first++)
        for (uint64_t second = 0; second <= 100; second++) {
            struct checksum sum;
            checksum_init(&sum, 5);
            checksum_add(&sum, (struct bytes){data, first});
            checksum_add(&sum, (struct bytes){data + first, second});
            checksum_add(&sum, (struct bytes){data + first + second, sizeof data - first - second});
            assert_int_equal(checksum_get(&sum), checksum((struct bytes){data, sizeof data}, 5));
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_texts),
        cmocka_unit_test(known_bytes),
        cmocka_unit_test(every_bit_counts),
        cmocka_unit_test(pieces),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

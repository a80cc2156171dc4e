/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_control_hostile.c - tests that no message, however it was made, takes more heap than CONTROL_HEAP_RATIO times
 * its size and the fixed part, or much time, or leaves memory allocated when it fails.
 */
#include "tests/support/unit.h"

#include <time.h>

#include "tests/support/proto/messages.h"
#include "tests/support/random.h"

enum { MEBIBYTE = 1 << 20, FIELDS = 32 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

struct flood {
    unsigned char *bytes;
    uint64_t size;
};

static double now_ms(void)
{
    struct timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

/*
 * Unpacks the bytes as every kind of message, and returns how many kinds accepted them. The bound on processor time
 * allows for the slowest sanitizer.
 */
static int unpack_all(const struct flood *flood)
{
    int taken = 0;
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        void *message = NULL;
        struct bvhd_error error;
        double began = now_ms();
        atomic_store(&memory.peak, 0);
        enum bvhd_status status =
            messages_kinds[i].unpack((struct bytes){flood->bytes, flood->size}, &memory, &message, &error);
        assert_true(status == BVHD_OK || status == BVHD_CORRUPT || status == BVHD_TOO_LARGE ||
                    status == BVHD_UNSUPPORTED);
        assert_true(memory.peak <= CONTROL_HEAP_RATIO * flood->size + CONTROL_HEAP_FIXED);
        assert_true(now_ms() - began < 1000);
        memory_free(&memory, message);
        assert_int_equal(memory.live, 0);
        taken += status == BVHD_OK;
    }
    return taken;
}

/* Repeats `pattern` up to `size` bytes. */
static struct flood repeat(const void *pattern, uint64_t length, uint64_t size)
{
    struct flood flood = {malloc(size + length), 0};
    for (; flood.size + length <= size; flood.size += length)
        memcpy(flood.bytes + flood.size, pattern, length);
    return flood;
}

static int repeat_all(const void *pattern, uint64_t length, uint64_t size)
{
    struct flood flood = repeat(pattern, length, size);
    int taken = unpack_all(&flood);
    free(flood.bytes);
    return taken;
}

/* Writes a field's tag, of one or two bytes. */
static uint64_t put_tag(unsigned char *bytes, uint32_t field, uint32_t wire_type)
{
    uint32_t tag = field << 3 | wire_type;
    bytes[0] = (unsigned char)(tag < 0x80 ? tag : 0x80 | (tag & 0x7f));
    bytes[1] = (unsigned char)(tag >> 7);
    return tag < 0x80 ? 1 : 2;
}

/*
 * A megabyte of every field number with every wire type: empty submessages, empty packed fields, numbers, groups,
 * strings of one byte.
 */
static void one_field_by_the_megabyte(void **state)
{
    (void)state;
    for (uint32_t field = 1; field <= FIELDS; field++)
        for (uint32_t wire_type = 0; wire_type < 8; wire_type++) {
            unsigned char pattern[16] = {0};
            uint64_t tag = put_tag(pattern, field, wire_type);
            repeat_all(pattern, tag + (wire_type == 1 ? 8 : wire_type == 5 ? 4 : 1), MEBIBYTE);
        }
    assert_int_equal(repeat_all("\x0a\x00", 2, MEBIBYTE), 0); /* empty counters, keys, items */
    for (uint32_t field = 1; field <= FIELDS; field++) {
        unsigned char pattern[16] = {0};
        uint64_t tag = put_tag(pattern, field, 2);
        pattern[tag] = 2;
        memcpy(pattern + tag + 1, "\x0a\x00", 2);
        repeat_all(pattern, tag + 3, MEBIBYTE);
    }
}

/* Submessages in submessages: 40 KB of them, each as long as its contents. */
static void nesting_ends(void **state)
{
    (void)state;
    enum { SIZE = 40 * 1024 };
    for (uint32_t field = 1; field <= FIELDS; field++) {
        unsigned char *bytes = malloc(SIZE);
        uint64_t start = SIZE;
        while (start > 8) {
            unsigned char head[8];
            uint64_t inner = SIZE - start, length = put_tag(head, field, 2);
            do
                head[length++] = (unsigned char)((inner & 0x7f) | (inner > 0x7f ? 0x80 : 0));
            while (inner >>= 7);
            start -= length;
            memcpy(bytes + start, head, length);
        }
        unpack_all(&(struct flood){bytes + start, SIZE - start});
        free(bytes);
    }
}

static void groups_are_no_messages(void **state)
{
    (void)state;
    for (uint32_t field = 1; field <= FIELDS; field++) {
        unsigned char group[4];
        uint64_t length = put_tag(group, field, 3);
        length += put_tag(group + length, field, 4);
        assert_int_equal(repeat_all(group, length, 40 * 1024), 0);
        assert_int_equal(unpack_all(&(struct flood){group, length}), 0);
        assert_int_equal(repeat_all(group, length / 2, 40 * 1024), 0);
    }
}

static void overlong_numbers_are_refused(void **state)
{
    (void)state;
    for (int length = 1; length < 30; length++) {
        unsigned char bytes[64] = {1 << 3};
        memset(bytes + 1, 0xff, (size_t)length);
        bytes[length + 1] = 0x01;
        unpack_all(&(struct flood){bytes, (uint64_t)length + 2});
        unpack_all(&(struct flood){bytes + 1, (uint64_t)length + 1}); /* an overlong tag */
        bytes[0] = 1 << 3 | 2; /* an overlong length */
        assert_int_equal(unpack_all(&(struct flood){bytes, (uint64_t)length + 2}), 0);
    }
    struct flood flood = repeat("\xff", 1, MEBIBYTE);
    assert_int_equal(unpack_all(&flood), 0);
    flood.bytes[0] = 1 << 3;
    assert_int_equal(unpack_all(&flood), 0);
    free(flood.bytes);
}

static void lengths_beyond_the_end_are_refused(void **state)
{
    (void)state;
    static const uint64_t lengths[] = {
        11, 127, 128, 1 << 20, INT32_MAX, UINT32_MAX - 1, UINT32_MAX, (uint64_t)1 << 32, UINT64_MAX};
    for (uint32_t field = 1; field <= FIELDS; field++)
        for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
            unsigned char bytes[64] = {0};
            uint64_t size = put_tag(bytes, field, 2), length = lengths[i];
            do
                bytes[size++] = (unsigned char)((length & 0x7f) | (length > 0x7f ? 0x80 : 0));
            while (length >>= 7);
            assert_int_equal(unpack_all(&(struct flood){bytes, size + 10}), 0);
        }
}

/*
 * Unknown fields are kept while the message is unpacked: one field of a megabyte is accepted, a megabyte of small
 * fields is not.
 */
static void unknown_fields_by_the_megabyte(void **state)
{
    (void)state;
    unsigned char *bytes = calloc(1, MEBIBYTE + 8);
    memcpy(bytes, "\x82\x7d\x80\x80\x40", 5); /* field 2000, of 2^20 bytes */
    /* A result without a key is refused. */
    assert_int_equal(unpack_all(&(struct flood){bytes, MEBIBYTE + 5}), MESSAGES_KINDS - 1);
    free(bytes);
    assert_int_equal(repeat_all("\x80\x7d\x01", 3, MEBIBYTE), 0);
    assert_int_equal(repeat_all("\x82\x7d\x01x", 4, MEBIBYTE), 0);
    assert_int_equal(repeat_all("\x80\x7d\x01", 3, 3 * 50), MESSAGES_KINDS - 1);
    struct flood flood = repeat("\x80\x7d\x01", 3, MEBIBYTE);
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        void *message;
        struct bvhd_error error;
        assert_int_equal(messages_kinds[i].unpack((struct bytes){flood.bytes, flood.size}, &memory, &message, &error),
                         BVHD_TOO_LARGE);
        assert_string_equal(error.where, messages_kinds[i].name);
    }
    free(flood.bytes);
}

/* A field that is given repeatedly: the last one counts, and each one takes its bytes until the end. */
static void repeated_strings_take_their_bytes(void **state)
{
    (void)state;
    for (uint32_t field = 1; field <= FIELDS; field++)
        for (uint64_t length = 1; length < 100000; length = length * 3 + 1) {
            unsigned char *pattern = malloc(length + 8);
            uint64_t size = put_tag(pattern, field, 2), rest = length;
            do
                pattern[size++] = (unsigned char)((rest & 0x7f) | (rest > 0x7f ? 0x80 : 0));
            while (rest >>= 7);
            memset(pattern + size, 0, length);
            repeat_all(pattern, size + length, 200000);
            free(pattern);
        }
}

/* Sample messages with a few bytes changed, cut off or doubled. */
static void mutations_hold_nothing(void **state)
{
    (void)state;
    struct random random = {17};
    for (int round = 0; round < 3000; round++) {
        struct bytes sample = messages_sample(&messages_kinds[round % MESSAGES_KINDS], &memory);
        struct flood flood = {malloc(2 * sample.size), sample.size};
        memcpy(flood.bytes, sample.data, sample.size);
        memcpy(flood.bytes + sample.size, sample.data, sample.size);
        messages_free(sample, &memory);
        if (random_next(&random) % 4 == 0)
            flood.size = random_next(&random) % (2 * flood.size);
        for (uint64_t changes = random_next(&random) % 6; changes > 0 && flood.size > 0; changes--)
            flood.bytes[random_next(&random) % flood.size] ^= (unsigned char)(1 << random_next(&random) % 8);
        unpack_all(&flood);
        free(flood.bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_field_by_the_megabyte),
        cmocka_unit_test(nesting_ends),
        cmocka_unit_test(groups_are_no_messages),
        cmocka_unit_test(overlong_numbers_are_refused),
        cmocka_unit_test(lengths_beyond_the_end_are_refused),
        cmocka_unit_test(unknown_fields_by_the_megabyte),
        cmocka_unit_test(repeated_strings_take_their_bytes),
        cmocka_unit_test(mutations_hold_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

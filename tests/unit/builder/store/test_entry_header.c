/* SPDX-License-Identifier: Apache-2.0 */
/* test_entry_header.c - tests that a header is read as it was written, and refused when any field of it is wrong. */
#include "tests/support/unit.h"

#include <xxhash.h>

#include "builder/store/entry_header.h"

enum { SUMMARY = 40, PAYLOAD = 1000, FILE_SIZE = ENTRY_HEADER + SUMMARY + PAYLOAD };

static unsigned char file[ENTRY_HEAD_MAX + 2];
static struct key key;

/* Writes a header with a summary of that size into `file`. */
static void write_file(uint64_t summary, uint64_t payload)
{
    memset(file, 7, sizeof file);
    memset(key.bytes, 3, sizeof key.bytes);
    struct store_entry entry = {key, {file + ENTRY_HEADER, summary}, payload};
    entry_header_write(&entry, file);
    entry_header_seal(file, (struct entry_checksum){UINT64_C(0x0102030405060708), UINT64_C(0x1112131415161718)});
}

static enum bvhd_status read_file(uint64_t head, uint64_t size, const char *where)
{
    struct store_entry entry = {.size = 12345};
    struct bvhd_error error = {0};
    enum bvhd_status status = entry_header_read((struct bytes){file, head}, size, &key, &entry, &error);
    if (status != BVHD_OK) {
        assert_int_equal(status, BVHD_CORRUPT);
        assert_int_equal(error.status, BVHD_CORRUPT);
        assert_string_equal(error.where, where);
        assert_int_equal(entry.size, 12345);
    }
    return status;
}

static bool no_state;

XXH3_state_t *__wrap_XXH3_createState(void);
XXH3_state_t *__real_XXH3_createState(void);

XXH3_state_t *__wrap_XXH3_createState(void)
{
    return no_state ? NULL : __real_XXH3_createState();
}

static void a_hash_without_memory_is_none(void **state)
{
    (void)state;
    struct entry_hash hash;
    write_file(SUMMARY, PAYLOAD);
    no_state = true;
    assert_false(entry_hash_begin(&hash, file));
    no_state = false;
    assert_true(entry_hash_begin(&hash, file));
    struct entry_checksum first = entry_hash_get(&hash);
    entry_hash_add(&hash, (struct bytes){file, 1});
    assert_true(entry_hash_get(&hash).low != first.low);
    entry_hash_finish(&hash);
}

static void a_header_is_read_as_it_was_written(void **state)
{
    (void)state;
    static const uint64_t summaries[] = {0, 1, SUMMARY, STORE_SUMMARY_MAX};
    for (int i = 0; i < 4; i++) {
        struct store_entry entry;
        write_file(summaries[i], PAYLOAD);
        uint64_t size = ENTRY_HEADER + summaries[i] + PAYLOAD;
        struct bytes head = {file, size < sizeof file ? size : sizeof file};
        assert_int_equal(entry_header_read(head, size, &key, &entry, NULL), BVHD_OK);
        assert_int_equal(entry.size, PAYLOAD);
        assert_int_equal(entry.summary.size, summaries[i]);
        assert_ptr_equal(entry.summary.data, file + ENTRY_HEADER);
        assert_true(key_equal(&entry.key, &key));
        struct entry_checksum sum = entry_header_checksum(file);
        assert_true(sum.low == UINT64_C(0x0102030405060708) && sum.high == UINT64_C(0x1112131415161718));
    }
}

static void every_truncation_is_refused(void **state)
{
    (void)state;
    write_file(SUMMARY, 0);
    for (uint64_t size = 0; size < ENTRY_HEADER; size++) {
        char where[32];
        snprintf(where, sizeof where, "byte %d", (int)size);
        assert_int_equal(read_file(size, size, where), BVHD_CORRUPT);
    }
    for (uint64_t size = ENTRY_HEADER; size < ENTRY_HEADER + SUMMARY; size++)
        assert_int_equal(read_file(size, size, "byte 12"), BVHD_CORRUPT);
    assert_int_equal(read_file(ENTRY_HEADER + SUMMARY, ENTRY_HEADER + SUMMARY, ""), BVHD_OK);
    assert_int_equal(read_file(ENTRY_HEADER + SUMMARY + 1, ENTRY_HEADER + SUMMARY + 1, "byte 16"), BVHD_CORRUPT);
}

static void every_field_is_looked_at(void **state)
{
    (void)state;
    static const struct {
        int from, to;
        const char *where;
    } fields[] = {{0, 8, "byte 0"}, {8, 12, "byte 8"}, {16, 24, "byte 16"}, {24, 56, "byte 24"}};
    for (int i = 0; i < 4; i++)
        for (int at = 8 * fields[i].from; at < 8 * fields[i].to; at++) {
            write_file(SUMMARY, PAYLOAD);
            file[at / 8] ^= (unsigned char)(1 << at % 8);
            assert_int_equal(read_file(ENTRY_HEADER + SUMMARY, FILE_SIZE, fields[i].where), BVHD_CORRUPT);
        }
    for (int at = 8 * 12; at < 8 * 16; at++) {
        write_file(SUMMARY, PAYLOAD);
        file[at / 8] ^= (unsigned char)(1 << at % 8);
        uint64_t summary = bytes_get32(file + 12);
        const char *where = summary > SUMMARY ? "byte 12" : "byte 16";
        assert_int_equal(read_file(ENTRY_HEADER + SUMMARY, FILE_SIZE, where), BVHD_CORRUPT);
    }
}

static void a_summary_has_a_most(void **state)
{
    (void)state;
    write_file(STORE_SUMMARY_MAX + 1, 0);
    uint64_t size = ENTRY_HEADER + STORE_SUMMARY_MAX + 1;
    assert_int_equal(read_file(size, size, "byte 12"), BVHD_CORRUPT);
}

/* The sum of each prefix, in any portions, is that of its bytes at once; and each bit of a header changes it. */
static void the_hash_covers_every_byte_but_itself(void **state)
{
    (void)state;
    write_file(SUMMARY, PAYLOAD);
    struct entry_hash whole, portions;
    assert_true(entry_hash_begin(&whole, file) && entry_hash_begin(&portions, file));
    entry_hash_add(&whole, (struct bytes){file + ENTRY_HEADER, SUMMARY});
    for (int i = 0; i < SUMMARY; i++)
        entry_hash_add(&portions, (struct bytes){file + ENTRY_HEADER + i, 1});
    const struct entry_checksum sum = entry_hash_get(&whole), same = entry_hash_get(&portions);
    assert_true(sum.low == same.low && sum.high == same.high);
    entry_hash_finish(&whole);
    entry_hash_finish(&portions);
    for (int at = 0; at < 8 * ENTRY_HEADER; at++) {
        struct entry_hash other;
        file[at / 8] ^= (unsigned char)(1 << at % 8);
        assert_true(entry_hash_begin(&other, file));
        entry_hash_add(&other, (struct bytes){file + ENTRY_HEADER, SUMMARY});
        struct entry_checksum changed = entry_hash_get(&other);
        assert_int_equal(changed.low != sum.low || changed.high != sum.high, at < 8 * 56);
        entry_hash_finish(&other);
        file[at / 8] ^= (unsigned char)(1 << at % 8);
    }
}

/* Whichever instructions the processor has, long pieces give the sum that the library's plain function gives. */
static void the_hash_is_xxh3(void **state)
{
    (void)state;
    enum { LONG = 200000, PIECE = 65536 };
    static unsigned char bytes[LONG];
    write_file(SUMMARY, PAYLOAD);
    memcpy(bytes, file, 56);
    for (uint32_t i = 56; i < LONG; i++)
        bytes[i] = (unsigned char)(i * 2654435761U >> 13);
    for (uint64_t size = 56; size <= LONG; size += 9997) {
        struct entry_hash hash;
        assert_true(entry_hash_begin(&hash, file));
        for (uint64_t at = 56, piece; at < size; at += piece) {
            piece = size - at < PIECE ? size - at : PIECE;
            entry_hash_add(&hash, (struct bytes){bytes + at, piece});
        }
        const struct entry_checksum sum = entry_hash_get(&hash);
        const XXH128_hash_t expected = XXH3_128bits(bytes, size);
        assert_true(sum.low == expected.low64 && sum.high == expected.high64);
        entry_hash_finish(&hash);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_hash_without_memory_is_none),
        cmocka_unit_test(a_header_is_read_as_it_was_written),
        cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(every_field_is_looked_at),
        cmocka_unit_test(a_summary_has_a_most),
        cmocka_unit_test(the_hash_covers_every_byte_but_itself),
        cmocka_unit_test(the_hash_is_xxh3),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_serialized.c - tests that the header of serialized structures is read and written, and that wrong ones are
 * refused.
 */
#include "tests/support/unit.h"

#include "builder/format/serialized.h"

enum { HANDLES = 3, BLOB_SIZE = SERIALIZED_HANDLES + HANDLES * 8 + 17 };

/*
 * Makes a blob by hand, byte by byte, from the table in the Vulkan specification
 * (vkCmdCopyAccelerationStructureToMemoryKHR).
 */
static void make_blob(unsigned char blob[BLOB_SIZE])
{
    memset(blob, 0xee, BLOB_SIZE);
    for (int i = 0; i < 16; i++) {
        blob[i] = (unsigned char)(0x10 + i);
        blob[16 + i] = (unsigned char)(0x80 + i);
    }
    memset(blob + 32, 0, 24);
    blob[32] = BLOB_SIZE;
    /* 0x1234567890abcd15, the lowest byte first */
    static const unsigned char deserialized[8] = {0x15, 0xcd, 0xab, 0x90, 0x78, 0x56, 0x34, 0x12};
    memcpy(blob + 40, deserialized, 8);
    blob[48] = HANDLES;
}

/* The copy is on the heap and exactly as long as stated, so that a sanitizer detects a read past the end. */
static enum bvhd_status read_copy(const unsigned char *blob, size_t size, struct serialized_header *ret_header,
                                  struct bvhd_error *error)
{
    unsigned char *copy = malloc(size ? size : 1);
    memcpy(copy, blob, size);
    enum bvhd_status status = serialized_read((struct bytes){size ? copy : NULL, size}, ret_header, error);
    free(copy);
    return status;
}

static void a_good_header_is_read(void **state)
{
    (void)state;
    unsigned char blob[BLOB_SIZE];
    make_blob(blob);
    struct serialized_header header;
    assert_int_equal(read_copy(blob, BLOB_SIZE, &header, NULL), BVHD_OK);
    assert_memory_equal(header.driver_uuid, blob, 16);
    assert_memory_equal(header.compatibility_uuid, blob + 16, 16);
    assert_int_equal(header.serialized_size, BLOB_SIZE);
    assert_true(header.deserialized_size == UINT64_C(0x1234567890abcd15));
    assert_int_equal(header.handle_count, HANDLES);
}

static void what_is_written_is_the_table(void **state)
{
    (void)state;
    unsigned char blob[BLOB_SIZE], written[BLOB_SIZE];
    make_blob(blob);
    memcpy(written, blob, BLOB_SIZE);
    memset(written, 0x77, SERIALIZED_HANDLES);
    struct serialized_header header;
    assert_int_equal(read_copy(blob, BLOB_SIZE, &header, NULL), BVHD_OK);
    serialized_write(written, &header);
    assert_memory_equal(written, blob, BLOB_SIZE); /* only the first 56 bytes are written */
}

static void every_truncation_is_corrupt(void **state)
{
    (void)state;
    unsigned char blob[BLOB_SIZE];
    make_blob(blob);
    for (size_t size = 0; size < BLOB_SIZE; size++) {
        struct serialized_header header, untouched;
        memset(&header, 0xc3, sizeof header);
        untouched = header;
        struct bvhd_error error;
        assert_int_equal(read_copy(blob, size, &header, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, size < SERIALIZED_HANDLES ? "header" : "header.serializedSize");
        assert_memory_equal(&header, &untouched, sizeof header);
    }
}

static void an_extra_byte_is_corrupt(void **state)
{
    (void)state;
    unsigned char blob[BLOB_SIZE + 1];
    make_blob(blob);
    blob[BLOB_SIZE] = 0;
    struct serialized_header header;
    struct bvhd_error error;
    assert_int_equal(read_copy(blob, BLOB_SIZE + 1, &header, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "header.serializedSize");
}

static enum bvhd_status read_with_handles(uint64_t count, struct bvhd_error *error)
{
    unsigned char blob[BLOB_SIZE];
    make_blob(blob);
    bytes_put64(blob + 48, count);
    struct serialized_header header;
    return read_copy(blob, BLOB_SIZE, &header, error);
}

static void handles_must_fit(void **state)
{
    (void)state;
    const uint64_t most = (BLOB_SIZE - SERIALIZED_HANDLES) / 8;
    assert_int_equal(read_with_handles(0, NULL), BVHD_OK);
    assert_int_equal(read_with_handles(most, NULL), BVHD_OK);
    static const uint64_t too_many[] = {most + 1,
                                        0xffffffff,
                                        UINT64_C(1) << 32,
                                        UINT64_C(1) << 61,
                                        (UINT64_C(1) << 61) + 1,
                                        UINT64_C(0xfffffffe00000000)};
    for (size_t i = 0; i < sizeof too_many / sizeof too_many[0]; i++) {
        struct bvhd_error error;
        assert_int_equal(read_with_handles(too_many[i], &error), BVHD_CORRUPT);
        assert_string_equal(error.where, "header.handleCount");
    }
}

/* Reads a header in block form with so many blocks, whose block says these two words. */
static enum bvhd_status read_block(uint64_t blocks, uint64_t type, uint64_t count, struct serialized_header *ret_header,
                                   struct bvhd_error *error)
{
    unsigned char blob[BLOB_SIZE];
    make_blob(blob);
    bytes_put64(blob + 48, UINT64_C(0xffffffff00000000) + blocks);
    bytes_put64(blob + 56, type);
    bytes_put64(blob + 64, count);
    return read_copy(blob, BLOB_SIZE, ret_header, error);
}

static void a_block_of_micromaps_is_read(void **state)
{
    (void)state;
    const uint64_t most = (BLOB_SIZE - SERIALIZED_MICROMAPS) / 8;
    struct serialized_header header;
    unsigned char written[SERIALIZED_MICROMAPS + 16], read[BLOB_SIZE];
    for (uint64_t count = 1; count <= most; count++) {
        assert_int_equal(read_block(1, 0, count, &header, NULL), BVHD_OK);
        assert_int_equal(header.micromap_count, count);
        assert_int_equal(header.handle_count, 0);
        assert_int_equal(serialized_end(&header), 72 + 8 * count);
    }
    memset(written, 0x77, sizeof written);
    serialized_write(written, &header);
    make_blob(read);
    bytes_put64(read + 48, UINT64_C(0xffffffff00000001));
    bytes_put64(read + 56, 0);
    bytes_put64(read + 64, most);
    memset(read + 72, 0x77, 16);
    assert_memory_equal(written, read, sizeof written);
}

static void other_blocks_are_refused(void **state)
{
    (void)state;
    struct serialized_header header;
    struct bvhd_error error;
    const uint64_t most = (BLOB_SIZE - SERIALIZED_MICROMAPS) / 8;
    static const uint64_t blocks[] = {0, 2, 3, UINT32_MAX};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        assert_int_equal(read_block(blocks[i], 0, 1, &header, &error), BVHD_INCOMPATIBLE);
        assert_string_equal(error.where, "header.handleCount");
    }
    assert_int_equal(read_block(1, 1, 1, &header, &error), BVHD_INCOMPATIBLE);
    assert_int_equal(read_block(1, UINT64_C(1) << 32, 1, &header, &error), BVHD_INCOMPATIBLE);
    const uint64_t counts[] = {0, most + 1, UINT64_C(1) << 61, UINT64_MAX};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        assert_int_equal(read_block(1, 0, counts[i], &header, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, "header.blocks");
    }
    unsigned char blob[SERIALIZED_HANDLES + 15];
    memset(blob, 0, sizeof blob);
    bytes_put64(blob + 32, sizeof blob);
    bytes_put64(blob + 48, UINT64_C(0xffffffff00000001));
    for (int i = 0; i < 2; i++) {
        assert_int_equal(read_copy(blob, sizeof blob, &header, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, "header.blocks");
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_good_header_is_read),
        cmocka_unit_test(what_is_written_is_the_table),
        cmocka_unit_test(every_truncation_is_corrupt),
        cmocka_unit_test(an_extra_byte_is_corrupt),
        cmocka_unit_test(handles_must_fit),
        cmocka_unit_test(a_block_of_micromaps_is_read),
        cmocka_unit_test(other_blocks_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

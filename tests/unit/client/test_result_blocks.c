/* SPDX-License-Identifier: Apache-2.0 */
/* test_result_blocks.c - tests that small results share blocks of memory, and that these are freed with the last. */
#include "tests/support/unit.h"

#include "client/library.h"
#include "client/result_blob.h"

enum { SIZE = 60001, COUNT = 200, OWN = RESULT_BLOCKS_FROM / SIZE + 1, ALIGNMENT = 64 };

static uint64_t live(void)
{
    return atomic_load(&library_memory.live);
}

/* Makes a blob whose bytes tell its number. */
static struct bvhd_blob *make(struct result_blocks *blocks, int number)
{
    static unsigned char bytes[SIZE];
    struct bvhd_blob *blob = NULL;
    struct bvhd_error error;
    memset(bytes, number, sizeof bytes);
    assert_int_equal(result_blob_copy_into((struct bytes){bytes, sizeof bytes}, blocks, &blob, &error), BVHD_OK);
    return blob;
}

static void expect(const struct bvhd_blob *blob, int number)
{
    const unsigned char *data = bvhd_blob_data(blob);
    assert_int_equal(bvhd_blob_size(blob), SIZE);
    assert_int_equal((uintptr_t)data % ALIGNMENT, 0);
    for (int i = 0; i < SIZE; i++)
        assert_true(data[i] == (unsigned char)number);
}

/* Makes results until blocks are used. Returns their number. */
static int fill_own(struct result_blocks *blocks, struct bvhd_blob **ret_blobs)
{
    for (int i = 0; i < OWN; i++)
        ret_blobs[i] = make(blocks, i);
    return OWN;
}

static void free_all(struct bvhd_blob **blobs, int count)
{
    for (int i = 0; i < count; i++)
        bvhd_blob_unref(blobs[i]);
}

static void few_results_take_no_block(void **state)
{
    struct result_blocks blocks = {0};
    struct bvhd_blob *blobs[OWN];
    uint64_t before = live();
    (void)state;
    int count = fill_own(&blocks, blobs);
    assert_true(live() - before < (uint64_t)OWN * (SIZE + 1000));
    free_all(blobs, count);
    assert_int_equal(live(), before);
    result_blocks_finish(&blocks);
}

static void many_results_share_blocks(void **state)
{
    struct result_blocks blocks = {0};
    static struct bvhd_blob *blobs[COUNT];
    uint64_t before = live();
    (void)state;
    for (int i = 0; i < COUNT; i++) {
        blobs[i] = make(&blocks, i);
        assert_true(live() - before < (uint64_t)(i + 1) * (SIZE + 1000) + (4 << 20));
    }
    assert_non_null(blocks.current);
    for (int i = 0; i < COUNT; i++)
        expect(blobs[i], i);
    for (int i = 0; i < COUNT; i += 2)
        bvhd_blob_unref(blobs[i]);
    result_blocks_finish(&blocks);
    for (int i = 1; i < COUNT; i += 2) {
        expect(blobs[i], i);
        bvhd_blob_unref(blobs[i]);
    }
    assert_int_equal(live(), before);
}

static void one_result_keeps_its_block_alone(void **state)
{
    struct result_blocks blocks = {0};
    static struct bvhd_blob *blobs[COUNT];
    uint64_t before = live();
    (void)state;
    for (int i = 0; i < COUNT; i++)
        blobs[i] = make(&blocks, i);
    result_blocks_finish(&blocks);
    free_all(blobs, COUNT - 1);
    assert_in_range(live() - before, SIZE, (4 << 20) + 1000);
    expect(blobs[COUNT - 1], COUNT - 1);
    bvhd_blob_unref(blobs[COUNT - 1]);
    assert_int_equal(live(), before);
}

static void large_results_have_their_own_memory(void **state)
{
    enum { LARGE = 3 << 20 };
    struct result_blocks blocks = {.received = RESULT_BLOCKS_FROM};
    struct bvhd_blob *blob;
    uint64_t before = live();
    unsigned char *bytes = calloc(1, LARGE);
    (void)state;
    assert_non_null(bytes);
    assert_int_equal(result_blob_copy_into((struct bytes){bytes, LARGE}, &blocks, &blob, NULL), BVHD_OK);
    assert_null(blocks.current);
    bvhd_blob_unref(blob);
    free(bytes);
    assert_int_equal(live(), before);
}

/* Without memory for a block, a result gets memory of its own; without any, it fails and holds nothing. */
static void shortages_lose_nothing(void **state)
{
    static const unsigned char bytes[SIZE];
    struct result_blocks blocks = {.received = RESULT_BLOCKS_FROM};
    struct bvhd_blob *blob;
    uint64_t before = live();
    (void)state;
    atomic_store(&library_memory.fail_after, 0);
    blob = make(&blocks, 7);
    assert_null(blocks.current);
    expect(blob, 7);
    bvhd_blob_unref(blob);
    atomic_store(&library_memory.fail_after, 1); /* the block comes, its blob does not */
    assert_int_equal(result_blob_copy_into((struct bytes){bytes, SIZE}, &blocks, &blob, NULL), BVHD_NO_MEMORY);
    assert_non_null(blocks.current);
    result_blocks_finish(&blocks);
    assert_int_equal(live(), before);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(few_results_take_no_block),        cmocka_unit_test(many_results_share_blocks),
        cmocka_unit_test(one_result_keeps_its_block_alone), cmocka_unit_test(large_results_have_their_own_memory),
        cmocka_unit_test(shortages_lose_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

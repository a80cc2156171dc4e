/* SPDX-License-Identifier: Apache-2.0 */
/* test_reply.c - tests the frames that are made for a client, with and without memory. */
#include "tests/support/unit.h"

#include "daemon/session/reply.h"

static struct memory memory;
static struct descriptors descriptors;
static struct blob_account account;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    blob_account_init(&account, &memory, &descriptors);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    assert_int_equal(atomic_load(&memory.live), 0);
    assert_int_equal(atomic_load(&account.live_blobs), 0);
    return 0;
}

static struct blob *make_blob(uint64_t size)
{
    struct blob_writer writer;
    struct blob *blob;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, size);
    assert_non_null(bytes);
    memset(bytes, 7, size);
    assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
    return blob;
}

static void test_a_frame_without_blob(void **state)
{
    (void)state;
    unsigned char *control = memory_alloc(&memory, 5);
    struct reply *reply = reply_create(FRAME_PREPARED, 42, (struct bytes){control, 5}, &memory);
    assert_int_equal(reply->header.type, FRAME_PREPARED);
    assert_int_equal(reply->header.request, 42);
    assert_int_equal(reply->header.control_size, 5);
    assert_int_equal(reply->header.inline_size + reply->header.descriptors + reply->credits, 0);
    reply_destroy(reply);
    reply_destroy(NULL);
}

/* Small blobs are sent inline, large ones as a descriptor. */
static void test_results(void **state)
{
    (void)state;
    static const uint64_t sizes[] = {1, BLOB_INLINE_MAX, BLOB_INLINE_MAX + 1};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct blob *blob = make_blob(sizes[i]);
        struct control_result result = {.item = 3, .size = sizes[i], .origin = ORIGIN_BUILT}, *read;
        struct reply *reply = reply_result(9, &result, blob, &memory);
        blob_unref(blob); /* the reply has a ref of its own */
        assert_int_equal(reply->credits, 1);
        assert_int_equal(reply->header.descriptors, sizes[i] > BLOB_INLINE_MAX);
        assert_int_equal(reply->header.inline_size, sizes[i] > BLOB_INLINE_MAX ? 0 : sizes[i]);
        assert_int_equal(reply->blob->size, sizes[i]);
        assert_int_equal(control_unpack_result(reply->control, &memory, &read, NULL), BVHD_OK);
        assert_int_equal(read->item, 3);
        memory_free(&memory, read);
        reply_destroy(reply);
    }
}

static void test_errors(void **state)
{
    (void)state;
    struct bvhd_error error, *read;
    bvhd_error_set(&error, BVHD_TOO_LARGE, "items", "too many");
    struct reply *reply = reply_error(7, &error, &memory);
    assert_int_equal(reply->header.type, FRAME_ERROR);
    assert_int_equal(control_unpack_error(reply->control, &memory, &read, NULL), BVHD_OK);
    assert_int_equal(read->status, BVHD_TOO_LARGE);
    assert_string_equal(read->where, "items");
    memory_free(&memory, read);
    reply_destroy(reply);
}

static void test_failing_allocations(void **state)
{
    (void)state;
    struct blob *blob = make_blob(100);
    struct control_result result = {.size = 100, .origin = ORIGIN_BUILT};
    struct reply *reply = NULL;
    int64_t after = 0;
    for (; !reply; after++) {
        atomic_store(&memory.fail_after, after);
        reply = reply_result(1, &result, blob, &memory);
        assert_int_equal(atomic_load(&blob->refs), reply ? 2 : 1);
    }
    assert_true(after >= 3);
    atomic_store(&memory.fail_after, -1);
    reply_destroy(reply);
    blob_unref(blob);
    unsigned char *control = memory_alloc(&memory, 5);
    atomic_store(&memory.fail_after, 0);
    assert_null(reply_create(FRAME_PONG, 1, (struct bytes){control, 5}, &memory));
    atomic_store(&memory.fail_after, -1);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_a_frame_without_blob),
        TEST(test_results),
        TEST(test_errors),
        TEST(test_failing_allocations),
    };
    descriptors_init(&descriptors);
    return cmocka_run_group_tests(tests, NULL, NULL);
}

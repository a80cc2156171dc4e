/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client.c - tests the client library against a daemon that answers step by step: results, errors, keys, and
 * waiting.
 */
#include "tests/support/unit.h"

#include <unistd.h>

#include "tests/support/client/client_bed.h"

static void test_result(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_int_equal(bvhd_batch_count(batch), 1);
    assert_true(bvhd_batch_is_copied(batch));
    assert_false(bvhd_batch_is_done(batch));
    assert_null(bvhd_batch_result(batch, 1));
    assert_int_equal(bed_status(batch, 0), BVHD_PENDING);
    assert_true(fake_greet(&bed.fake));
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_equal(build->item_count, 1);
    assert_int_equal(build->items[0].destination, 1);
    assert_int_equal(build->items[0].type, STRUCTURE_BOTTOM);
    assert_int_equal(build->items[0].target, TARGET_PORTABLE);
    assert_int_equal(build->items[0].payload_source, SOURCE_INLINE);
    assert_int_equal(build->items[0].payload_size, frame.inline_bytes.size);
    assert_memory_equal(frame.inline_bytes.data + 96, bed.asked->vertices, 36);
    fake_free(&bed.fake, build);
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_result(&bed.fake, frame.header.request, 0, 1000);
    assert_true(bed_finish(&bed, batch));
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    assert_int_equal(result->error.status, BVHD_OK);
    assert_int_equal(result->size, 1000);
    assert_int_equal((uintptr_t)result->data % 64, 0);
    unsigned char expected[1000];
    fake_fill(expected, sizeof expected);
    assert_memory_equal(result->data, expected, sizeof expected);
    assert_int_equal(result->key.bytes[31], 0xab);
    assert_int_equal(result->origin, BVHD_ORIGIN_BUILT);
    assert_true(result->queued_ms == 1 && result->prepare_ms == 2 && result->build_ms == 3 &&
                result->original_build_ms == 4);
    assert_true(result->primitives == 11 && result->triangles == 12 && result->depth == 13 && result->sah == 1.5);
    assert_string_equal(result->method, "binned");
    assert_true(result->bounds[0] == 1 && result->bounds[5] == 6);
    bed_end(&bed, batch);
}

/* Small and large results outlive their batch and their client. */
static void test_blob_outlives(void **state)
{
    (void)state;
    static const uint64_t sizes[2] = {100, 200000};
    struct client_bed bed;
    struct frame frame;
    struct bvhd_blob *blobs[2];
    bed_start(&bed);
    int before = bed.descriptors;
    assert_true(bed_connect(&bed));
    for (int i = 0; i < 2; i++) {
        struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        fake_send_result(&bed.fake, frame.header.request, 0, sizes[i]);
        assert_true(bed_finish(&bed, batch));
        const struct bvhd_result *result = bvhd_batch_result(batch, 0);
        assert_int_equal(result->error.status, BVHD_OK);
        blobs[i] = bvhd_blob_ref(result->blob);
        assert_ptr_equal(bvhd_blob_data(blobs[i]), result->data);
        bvhd_batch_destroy(batch);
    }
    bed_stop(&bed);
    assert_int_equal(open_descriptors(), before);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(bvhd_blob_size(blobs[i]), sizes[i]);
        const unsigned char *bytes = bvhd_blob_data(blobs[i]);
        assert_int_equal(bytes[99], 99);
        assert_int_equal(bytes[sizes[i] - 1], (sizes[i] - 1) % 251);
        bvhd_blob_unref(blobs[i]);
    }
    bvhd_blob_unref(NULL);
    assert_int_equal(library_memory.live, bed.live);
}

static void test_fetch(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct bvhd_batch *batch;
    struct bvhd_key keys[3] = {{{1}}, {{2}}, {{3}}};
    bed_start(&bed);
    assert_int_equal(bvhd_batch_fetch(bed.client, 3, keys, &batch, NULL), BVHD_OK);
    assert_true(bvhd_batch_is_copied(batch));
    assert_true(fake_greet(&bed.fake));
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_GET, &frame));
    struct control_get *get;
    assert_int_equal(control_unpack_get(frame.control, &bed.fake.peer.memory, &get, NULL), BVHD_OK);
    assert_int_equal(get->key_count, 3);
    assert_int_equal(get->keys[2].bytes[0], 3);
    fake_free(&bed.fake, get);
    fake_send_result(&bed.fake, frame.header.request, 2, 70000);
    fake_send_failed(&bed.fake, frame.header.request, 0, BVHD_NOT_FOUND, "");
    fake_send_result(&bed.fake, frame.header.request, 1, 1);
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_NOT_FOUND);
    assert_int_equal(bed_status(batch, 1), BVHD_OK);
    assert_int_equal(bvhd_batch_result(batch, 2)->size, 70000);
    bed_end(&bed, batch);
}

/* A batch without items is done at once, without a daemon. */
static void test_empty(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_batch *batch;
    bed_start(&bed);
    batch = bed_submit(&bed, 0, 0);
    assert_int_equal(bvhd_batch_wait(batch, 0), BVHD_OK);
    assert_null(bvhd_batch_result(batch, 0));
    bvhd_batch_destroy(batch);
    assert_int_equal(bvhd_batch_fetch(bed.client, 0, NULL, &batch, NULL), BVHD_OK);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    bvhd_batch_destroy(batch);
    bvhd_batch_destroy(NULL);
    bvhd_client_destroy(NULL);
    bvhd_counters_destroy(NULL);
    assert_true(bed_stop(&bed));
}

/* An info that breaks a rule gets an error as its result; the others are requested. */
static void test_broken_infos(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct bvhd_batch *batch;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    bed_describe(bed.asked, 3, 1);
    bed.asked->infos[0].sType = 0;
    bed.asked->geometries[2].sType = 0;
    assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batch, NULL), BVHD_OK);
    assert_int_equal(bed_status(batch, 0), BVHD_INVALID);
    assert_int_equal(bed_status(batch, 2), BVHD_INVALID);
    assert_string_equal(bvhd_batch_result(batch, 2)->error.where, "infos[2].geometries[0].sType");
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_failed(&bed.fake, frame.header.request, 0, BVHD_INVALID, "infos[0].geometries[0].flags");
    assert_true(bed_finish(&bed, batch));
    assert_string_equal(bvhd_batch_result(batch, 1)->error.where, "infos[1].geometries[0].flags");
    bvhd_batch_destroy(batch);
    bed_describe(bed.asked, 40, 1);
    bed.asked->infos[39].dstAccelerationStructure = bed.asked->infos[1].dstAccelerationStructure;
    assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batch, NULL), BVHD_OK);
    assert_int_equal(bvhd_batch_result(batch, 1)->error.vuid, BVHD_VUID_03698);
    assert_string_equal(bvhd_batch_result(batch, 39)->error.where, "infos[39].dstAccelerationStructure");
    assert_int_equal(bed_status(batch, 2), BVHD_PENDING);
    bvhd_batch_destroy(batch);
    struct bvhd_build build = bed.asked->build;
    build.struct_size--;
    assert_int_equal(bvhd_batch_submit(bed.client, &build, &batch, NULL), BVHD_INVALID);
    assert_true(bed_stop(&bed));
}

/* A request fails as a whole. */
static void test_error(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    bed.fake.welcome.credits = 2;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_error(&bed.fake, frame.header.request, BVHD_TOO_LARGE, "request.items", "too many");
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_TOO_LARGE);
    assert_string_equal(bvhd_batch_result(batch, 1)->error.where, "request.items");
    bvhd_batch_destroy(batch);
    batch = bed_submit(&bed, 1, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_error(&bed.fake, frame.header.request, BVHD_OK, "", "");
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_CORRUPT);
    bvhd_batch_destroy(batch);
    batch = bed_submit(&bed, 2, 1); /* all credits are back */
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_equal(build->item_count, 2);
    fake_free(&bed.fake, build);
    bed_end(&bed, batch);
}

/* Places in errors count as the caller counts, however the batch was cut into requests. */
static void test_renumbered(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    bed.fake.welcome.max_items = 2;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 4, 1);
    for (int i = 0; i < 2; i++) {
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        fake_send_prepared(&bed.fake, frame.header.request, 0, 2);
        fake_send_failed(&bed.fake, frame.header.request, 0, BVHD_INVALID, "infos[0].flags");
        fake_send_failed(&bed.fake, frame.header.request, 1, BVHD_PENDING, "infos[10].flags");
    }
    assert_true(bed_finish(&bed, batch));
    assert_string_equal(bvhd_batch_result(batch, 2)->error.where, "infos[2].flags");
    assert_string_equal(bvhd_batch_result(batch, 3)->error.where, "infos[10].flags");
    assert_int_equal(bed_status(batch, 3), BVHD_CORRUPT);
    bed_end(&bed, batch);
}

static void check_connections(struct bvhd_client *client)
{
    struct bvhd_connections *connections;
    struct bvhd_error error;
    assert_int_equal(bvhd_client_connections(client, 0, -1, &connections, NULL), BVHD_OK);
    assert_int_equal(bvhd_connections_count(connections), 1);
    assert_int_equal(bvhd_connections_total(connections), 9);
    assert_int_equal(bvhd_connections_hidden(connections), 8);
    const struct bvhd_connection *row = bvhd_connections_get(connections, 0);
    assert_true(row->number == 3 && row->uid == 4 && row->pid == 5 && row->busy_ms == 6);
    assert_string_equal(row->software, "a fake");
    assert_null(bvhd_connections_get(connections, 1));
    bvhd_connections_destroy(connections);
    assert_int_equal(bvhd_client_connections(client, BVHD_CONNECTIONS_ALL, -1, &connections, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.text, "not everybody");
}

static void check_cache(struct bvhd_client *client)
{
    struct bvhd_cache_state *cache;
    struct bvhd_error error;
    assert_int_equal(bvhd_client_cache(client, BVHD_CACHE_SHOW, 7, -1, &cache, NULL), BVHD_OK);
    assert_string_equal(cache->directory, "/a/b");
    assert_true(cache->counted == 1 && cache->entries == 1 && cache->bytes == 2 && cache->budget == 3);
    assert_true(cache->memory_entries == 4 && cache->memory_bytes == 5 && cache->memory_budget == 6);
    bvhd_cache_state_destroy(cache);
    assert_int_equal(bvhd_client_cache(client, BVHD_CACHE_TRIM, 7, -1, &cache, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.text, "1 to 7 bytes");
    assert_int_equal(bvhd_client_cache(client, BVHD_CACHE_CLEAR, 7, -1, &cache, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.text, "2 to 0 bytes");
}

static void test_calls(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_counters *counters;
    double ms = -1;
    bed_start(&bed);
    fake_serve(&bed.fake);
    assert_int_equal(bvhd_client_connect(bed.client, NULL), BVHD_OK);
    assert_int_equal(bvhd_client_ping(bed.client, BED_LATE_MS, &ms, NULL), BVHD_OK);
    assert_true(ms >= 0 && ms < BED_LATE_MS);
    assert_int_equal(bvhd_client_counters(bed.client, -1, &counters, NULL), BVHD_OK);
    assert_int_equal(bvhd_counters_count(counters), 2);
    assert_string_equal(bvhd_counters_name(counters, 1), "hits_memory");
    assert_int_equal(bvhd_counters_value(counters, 1), 8);
    assert_null(bvhd_counters_name(counters, 2));
    assert_int_equal(bvhd_counters_value(counters, 2), 0);
    assert_string_equal(bvhd_counters_version(counters), "9.8.7");
    bvhd_counters_destroy(counters);
    check_connections(bed.client);
    check_cache(bed.client);
    fake_serve_end(&bed.fake);
    assert_int_equal(bvhd_client_ping(bed.client, 10, NULL, NULL), BVHD_UNAVAILABLE);
    assert_true(bed_stop(&bed));
}

static void send_progress(struct client_bed *bed, uint64_t request, uint32_t item, uint32_t thousandths)
{
    const struct control_progress progress = {1, &item, &thousandths};
    struct bytes control;
    assert_int_equal(control_pack_progress(&progress, &bed->fake.peer.memory, &control, NULL), BVHD_OK);
    fake_send(&bed->fake, FRAME_PROGRESS, request, control);
    fake_free(&bed->fake, (void *)(uintptr_t)control.data);
    bvhd_client_dispatch(bed->client);
}

/* Progress goes from 0 to what the daemon tells, never back, and to 1 with the result. */
static void test_progress(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct control_hello *hello;
    bed_start(&bed);
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    assert_true(fake_accept(&bed.fake, NULL) && fake_expect(&bed.fake, FRAME_HELLO, &frame));
    assert_int_equal(control_unpack_hello(frame.control, &bed.fake.peer.memory, &hello, NULL), BVHD_OK);
    assert_in_range(hello->progress_ms, 100, 1000);
    fake_free(&bed.fake, hello);
    fake_send_welcome(&bed.fake);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    const uint64_t request = frame.header.request;
    assert_true(bvhd_batch_progress(batch, 0) == 0 && bvhd_batch_progress(batch, 2) == 0);
    send_progress(&bed, request, 1, 250);
    assert_true(bvhd_batch_progress(batch, 0) == 0 && bvhd_batch_progress(batch, 1) == 0.25f);
    send_progress(&bed, request, 1, 100);
    assert_true(bvhd_batch_progress(batch, 1) == 0.25f);
    assert_int_equal(bed_status(batch, 1), BVHD_PENDING);
    fake_send_result(&bed.fake, request, 0, 10);
    bvhd_client_dispatch(bed.client);
    assert_true(bvhd_batch_progress(batch, 0) == 1);
    send_progress(&bed, request, 0, 500); /* an item with its result */
    bvhd_batch_cancel_item(batch, 1);
    assert_true(bvhd_batch_progress(batch, 0) == 1 && bvhd_batch_progress(batch, 1) == 1);
    send_progress(&bed, request, 1, 600); /* an item that was cancelled */
    assert_int_equal(bed_status(batch, 1), BVHD_CANCELLED);
    bvhd_batch_destroy(batch);
    send_progress(&bed, request, 1, 700); /* a batch that is gone */
    assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
    batch = bed_submit(&bed, 1, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame)); /* on the same connection */
    bed_end(&bed, batch);
}

static void test_keys(void **state)
{
    (void)state;
    struct bvhd_key key = {{0x01, 0xfe}}, again;
    char text[BVHD_KEY_TEXT_SIZE];
    bvhd_key_to_text(&key, text);
    assert_int_equal(strlen(text), 64);
    assert_memory_equal(text, "01fe00", 6);
    assert_int_equal(bvhd_key_from_text(text, &again), BVHD_OK);
    assert_memory_equal(&key, &again, sizeof key);
    text[63] = 'g';
    assert_int_equal(bvhd_key_from_text(text, &again), BVHD_INVALID);
}

/* The header's version is that of the project, which only its build file states. */
static void test_version(void **state)
{
    (void)state;
    const char *expected = getenv("BVHD_PROJECT_VERSION");
    char numbers[40];
    snprintf(numbers, sizeof numbers, "%d.%d.%d", BVHD_VERSION_MAJOR, BVHD_VERSION_MINOR, BVHD_VERSION_PATCH);
    assert_string_equal(BVHD_VERSION_STRING, numbers);
    assert_string_equal(bvhd_version(), numbers);
    assert_true(BVHD_VERSION >= BVHD_MAKE_VERSION(0, 1, 0));
    if (expected)
        assert_string_equal(numbers, expected);
    else
        skip();
}

/*
 * The whole way from connecting to the result, with each allocation failing once: it ends with an error or a result,
 * and nothing stays allocated.
 */
static void test_failing_allocations(void **state)
{
    (void)state;
    struct client_bed bed;
    int64_t fails = 0;
    bool succeeded = false;
    bed_start(&bed);
    bed.fake.welcome.max_items = 2;
    fake_serve(&bed.fake);
    bed_describe(bed.asked, 5, 700);
    bvhd_client_destroy(bed.client);
    for (; !succeeded; fails++) {
        struct bvhd_client_options options = {
            .struct_size = sizeof options, .socket_path = bed.fake.path, .local = BVHD_LOCAL_NEVER};
        struct bvhd_batch *batch = NULL, *keys = NULL;
        struct bvhd_key key = {{1}};
        uint64_t live = library_memory.live;
        bed.client = NULL;
        library_memory.fail_after = fails;
        enum bvhd_status status = bvhd_client_create(&options, &bed.client, NULL);
        if (status == BVHD_OK)
            status = bvhd_batch_submit(bed.client, &bed.asked->build, &batch, NULL);
        if (status == BVHD_OK)
            status = bvhd_batch_wait(batch, 10000);
        for (uint32_t i = 0; status == BVHD_OK && i < 5; i++)
            status = bed_status(batch, i);
        if (status == BVHD_OK)
            status = bvhd_batch_fetch(bed.client, 1, &key, &keys, NULL);
        if (status == BVHD_OK)
            status = bvhd_batch_wait(keys, 10000);
        if (status == BVHD_OK)
            status = bed_status(keys, 0);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        succeeded = library_memory.fail_after >= 0;
        library_memory.fail_after = -1;
        bvhd_batch_destroy(keys);
        bvhd_batch_destroy(batch);
        bvhd_client_destroy(bed.client);
        assert_int_equal(library_memory.live, live);
    }
    assert_in_range(fails, 20, 500);
    fake_serve_end(&bed.fake);
    bed.client = NULL;
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_result),       cmocka_unit_test(test_blob_outlives),
        cmocka_unit_test(test_fetch),        cmocka_unit_test(test_empty),
        cmocka_unit_test(test_broken_infos), cmocka_unit_test(test_error),
        cmocka_unit_test(test_renumbered),   cmocka_unit_test(test_calls),
        cmocka_unit_test(test_progress),     cmocka_unit_test(test_keys),
        cmocka_unit_test(test_version),      cmocka_unit_test(test_failing_allocations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

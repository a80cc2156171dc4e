/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_incoming.c - tests that the client library takes each answer for the request that it belongs to: for the pool,
 * for batches that are gone, for calls that wait no longer, broken ones, and while no memory is left.
 */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/client.h"
#include "tests/support/client/client_bed.h"

static const struct bytes nothing, broken = {(const unsigned char *)"\xff\xff\xff\xff", 4};

/* Progress of the items 0 and 1: 500 thousandths each. */
static const struct bytes half = {(const unsigned char *)"\x0a\x04\0\0\0\0\x12\x04\xf4\x01\0\0", 12},
                          half_of_next = {(const unsigned char *)"\x0a\x04\1\0\0\0\x12\x04\xf4\x01\0\0", 12};

/* Submits a payload that belongs into the pool, and receives POOL. The daemon keeps no descriptor of it. */
static struct bvhd_batch *ask_for_pool(struct client_bed *bed, uint64_t *ret_request)
{
    struct frame frame;
    struct bvhd_batch *batch = bed_submit(bed, 1, 1000);
    assert_true(fake_expect(&bed->fake, FRAME_POOL, &frame));
    close(frame.descriptors[0]);
    *ret_request = frame.header.request;
    return batch;
}

static void expect_violation(struct client_bed *bed, struct bvhd_batch *batch, const char *text)
{
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_non_null(strstr(bed_text(batch), text));
    assert_true(raw_await_close(&bed->fake.peer, 1000, NULL));
    bvhd_batch_destroy(batch);
}

/* POOL has no items, so answers about items break the protocol. */
static void test_items_of_the_pool(void **state)
{
    (void)state;
    static const char *const texts[] = {"a result of what has none", "nothing is to be prepared",
                                        "progress of what has no items"};
    for (int i = 0; i < 3; i++) {
        struct client_bed bed;
        uint64_t request;
        bed_start(&bed);
        assert_true(bed_connect(&bed));
        struct bvhd_batch *batch = ask_for_pool(&bed, &request);
        if (i == 0)
            fake_send_result(&bed.fake, request, 0, 10);
        else if (i == 1)
            fake_send_prepared(&bed.fake, request, 0, 1);
        else
            fake_send(&bed.fake, FRAME_PROGRESS, request, half);
        expect_violation(&bed, batch, texts[i]);
        assert_true(bed_stop(&bed));
    }
}

/* A daemon that is too busy for a pool gets the payload in a descriptor of its own. */
static void test_busy_for_the_pool(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    uint64_t request;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = ask_for_pool(&bed, &request);
    fake_send_busy(&bed.fake, request, 60000);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_not_equal(build->items[0].payload_source, SOURCE_POOL);
    for (int i = 0; i < frame.header.descriptors; i++)
        close(frame.descriptors[i]);
    fake_free(&bed.fake, build);
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_result(&bed.fake, frame.header.request, 0, 10);
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bed_end(&bed, batch);
}

/* A request cannot be refused once one of its items has its result. */
static void test_busy_after_a_result(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_result(&bed.fake, frame.header.request, 1, 10);
    fake_send_busy(&bed.fake, frame.header.request, 1);
    expect_violation(&bed, batch, "a request that was taken cannot be refused");
    assert_true(bed_stop(&bed));
}

/* Messages that cannot be unpacked, and answers to other questions. Each ends the connection. */
static void test_broken_answers(void **state)
{
    (void)state;
    static const enum frame_type types[] = {FRAME_RESULT,  FRAME_PREPARED,    FRAME_PROGRESS,    FRAME_ERROR,
                                            FRAME_BUSY,    FRAME_CLIENT_LIST, FRAME_CACHE_STATE, FRAME_COUNTERS,
                                            FRAME_WELCOME, FRAME_GOODBYE};
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        struct client_bed bed;
        uint64_t request;
        struct bvhd_batch *batch = bed_start_asked(&bed, &request);
        fake_send(&bed.fake, types[i], request, broken);
        expect_violation(&bed, batch, i < 5 ? "not a message of this kind" : "the daemon breaks the protocol");
        assert_true(bed_stop(&bed));
    }
}

/* Frames that come instead of WELCOME: the search for a daemon goes on after GOODBYE, and ends after an answer. */
static void test_instead_of_welcome(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_accept(&bed.fake, NULL) && fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(bed_status(batch, 0), BVHD_PENDING);
    assert_int_equal(bvhd_batch_wait(batch, 50), BVHD_PENDING);
    assert_true(fake_accept(&bed.fake, NULL) && fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send(&bed.fake, FRAME_PONG, 1 << 16, nothing);
    expect_violation(&bed, batch, "an answer before WELCOME");
    assert_true(bed_stop(&bed));
}

/* Sends an ERROR for the connection to a client that waits for a build, and returns what it says of the build. */
static struct bvhd_error last_words(enum bvhd_status status, const char *where, bool is_broken)
{
    struct client_bed bed;
    uint64_t request;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    if (is_broken)
        fake_send(&bed.fake, FRAME_ERROR, 0, broken);
    else
        fake_send_error(&bed.fake, 0, status, where, "because");
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    struct bvhd_error error = bvhd_batch_result(batch, 0)->error;
    bed_end(&bed, batch);
    return error;
}

static void test_last_words(void **state)
{
    (void)state;
    assert_non_null(strstr(last_words(BVHD_CORRUPT, "frame.magic", false).text, "because"));
    assert_string_equal(last_words(BVHD_CORRUPT, "frame.magic", false).where, "frame.magic");
    assert_string_equal(last_words(BVHD_OK, "", false).where, "connection");
    assert_non_null(strstr(last_words(BVHD_OK, "", false).text, "the daemon ended the connection: because"));
    assert_non_null(strstr(last_words(BVHD_OK, "", true).text, "not a message of this kind"));
}

/* A request that fails as a whole keeps the results that came before, and what was cancelled stays cancelled. */
static void test_error_for_the_rest(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 3, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    uint64_t request = frame.header.request;
    fake_send_result(&bed.fake, request, 0, 10);
    fake_send(&bed.fake, FRAME_PROGRESS, request, half); /* it was answered already */
    bvhd_client_dispatch(bed.client);
    bvhd_batch_cancel_item(batch, 1);
    fake_send(&bed.fake, FRAME_PROGRESS, request, half_of_next); /* nobody wants it any more */
    fake_send_error(&bed.fake, request, BVHD_IO, "build", "half of it");
    assert_int_equal(bvhd_batch_wait(batch, 5000), BVHD_OK);
    assert_int_equal(bed_status(batch, 0), BVHD_OK);
    assert_int_equal(bed_status(batch, 1), BVHD_CANCELLED);
    assert_int_equal(bed_status(batch, 2), BVHD_IO);
    bed_end(&bed, batch);
}

/* A daemon may cancel what nobody has cancelled, and not for a deadline. */
static void test_cancelled_by_the_daemon(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_failed(&bed.fake, request, 0, BVHD_CANCELLED, "infos[0]");
    assert_int_equal(bed_outcome(batch), BVHD_CANCELLED);
    assert_string_equal(bvhd_batch_result(batch, 0)->error.where, "infos[0]");
    bed_end(&bed, batch);
}

/* Answers for cancelled items and for batches that are gone are dropped, and the connection lives. */
static void test_answers_that_nobody_wants(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    for (int i = 0; i < 4; i++) {
        uint64_t request;
        struct bvhd_batch *batch = bed_ask(&bed, &request);
        if (i % 2 == 0)
            bvhd_batch_destroy(batch);
        else
            bvhd_batch_cancel(batch);
        assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
        fake_send(&bed.fake, FRAME_PROGRESS, request, half);
        if (i < 2) {
            fake_send_prepared(&bed.fake, request, 0, 1);
            fake_send_failed(&bed.fake, request, 0, BVHD_CANCELLED, "");
        } else {
            fake_send_error(&bed.fake, request, BVHD_CANCELLED, "build", "cancelled");
        }
        bvhd_client_dispatch(bed.client);
        if (i % 2 != 0) {
            assert_int_equal(bed_status(batch, 0), BVHD_CANCELLED);
            bvhd_batch_destroy(batch);
        }
    }
    uint64_t request;
    struct bvhd_batch *batch = bed_ask(&bed, &request); /* on the same connection */
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_result(&bed.fake, request, 0, 10);
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bed_end(&bed, batch);
}

/* A client whose socket is full sends the rest once it hears from the daemon. */
static void test_full_socket(void **state)
{
    (void)state;
    enum { MOST = 200 };
    static struct bvhd_batch *batches[MOST];
    struct client_bed bed;
    struct frame frame;
    int count = 0, received = 0;
    bed_start(&bed);
    bed.fake.welcome.credits = CONTROL_MAX_ITEMS;
    assert_true(bed_connect(&bed));
    while (count < MOST && !bed.client->current->is_blocked)
        batches[count++] = bed_submit(&bed, 5, 200);
    assert_true(bed.client->current->is_blocked);
    fake_send(&bed.fake, (enum frame_type)200, 12345, nothing); /* of a later version */
    while (received < count) {
        bvhd_client_dispatch(bed.client);
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        received++;
        fake_send(&bed.fake, (enum frame_type)200, 12345, nothing);
    }
    assert_false(bed.client->current->is_blocked);
    while (count > 0)
        bvhd_batch_destroy(batches[--count]);
    assert_true(bed_stop(&bed));
}

enum { CALLS = 3 };

/* Makes one of the calls whose answer is more than a PONG, and frees the answer. */
static enum bvhd_status call(struct client_bed *bed, int which, int timeout_ms)
{
    struct bvhd_counters *counters = NULL;
    struct bvhd_connections *connections = NULL;
    struct bvhd_cache_state *cache = NULL;
    enum bvhd_status status = which == 0 ? bvhd_client_counters(bed->client, timeout_ms, &counters, NULL)
                              : which == 1
                                  ? bvhd_client_connections(bed->client, 0, timeout_ms, &connections, NULL)
                                  : bvhd_client_cache(bed->client, BVHD_CACHE_SHOW, 0, timeout_ms, &cache, NULL);
    assert_int_equal(status == BVHD_OK, counters || connections || cache);
    bvhd_counters_destroy(counters);
    bvhd_connections_destroy(connections);
    bvhd_cache_state_destroy(cache);
    return status;
}

/* An answer that comes after its call has given up is dropped. */
static void test_late_answers(void **state)
{
    (void)state;
    static const enum frame_type questions[CALLS] = {FRAME_STATS, FRAME_CLIENTS, FRAME_CACHE},
                                 answers[CALLS] = {FRAME_COUNTERS, FRAME_CLIENT_LIST, FRAME_CACHE_STATE};
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    for (int which = 0; which < CALLS; which++) {
        assert_int_equal(call(&bed, which, 1), BVHD_UNAVAILABLE);
        assert_true(fake_expect(&bed.fake, questions[which], &frame));
        fake_send(&bed.fake, answers[which], frame.header.request, nothing); /* all its numbers are 0 */
        bvhd_client_dispatch(bed.client);
    }
    uint64_t request;
    struct bvhd_batch *batch = bed_ask(&bed, &request); /* on the same connection */
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_result(&bed.fake, request, 0, 10);
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bvhd_batch_destroy(batch);
    for (int which = 0; which < CALLS; which++) {
        assert_int_equal(call(&bed, which, 1), BVHD_UNAVAILABLE);
        assert_true(fake_expect(&bed.fake, questions[which], &frame));
        fake_send(&bed.fake, answers[which], frame.header.request, broken);
        bvhd_client_dispatch(bed.client);
        assert_true(raw_await_close(&bed.fake.peer, 1000, NULL));
        assert_true(bed_connect(&bed));
    }
    assert_true(bed_stop(&bed));
}

/* Each allocation of a call fails once. The call says so, or loses the connection, and holds nothing. */
static void test_calls_without_memory(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    fake_serve(&bed.fake);
    for (int which = 0; which < CALLS; which++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = 0, told = 0;
        for (; status != BVHD_OK; failures++) {
            assert_int_equal(bvhd_client_connect(bed.client, NULL), BVHD_OK);
            uint64_t live = library_memory.live;
            atomic_store(&library_memory.fail_after, failures);
            status = call(&bed, which, 5000);
            atomic_store(&library_memory.fail_after, -1);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY || status == BVHD_UNAVAILABLE);
            assert_true(library_memory.live <= live + (64 << 10));
            told += status == BVHD_NO_MEMORY;
        }
        assert_in_range(failures, 4, 20);
        assert_true(told >= 2); /* at least for the request and for the list */
    }
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_items_of_the_pool),    cmocka_unit_test(test_busy_for_the_pool),
        cmocka_unit_test(test_busy_after_a_result),  cmocka_unit_test(test_broken_answers),
        cmocka_unit_test(test_instead_of_welcome),   cmocka_unit_test(test_last_words),
        cmocka_unit_test(test_error_for_the_rest),   cmocka_unit_test(test_answers_that_nobody_wants),
        cmocka_unit_test(test_full_socket),          cmocka_unit_test(test_late_answers),
        cmocka_unit_test(test_calls_without_memory), cmocka_unit_test(test_cancelled_by_the_daemon),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

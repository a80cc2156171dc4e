/* SPDX-License-Identifier: Apache-2.0 */
/* test_client_link.c - tests the client library with daemons that are missing, come late, fall silent, or leave. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "tests/support/client/client_bed.h"

static const struct bytes nothing = {NULL, 0};

static void test_nobody(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start_impatient(&bed);
    fake_close_listener(&bed.fake);
    double start = bed_now();
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_CONNECT_MS - 1, BED_LATE_MS);
    assert_string_equal(bvhd_batch_result(batch, 1)->error.where, bed.fake.path);
    bvhd_batch_destroy(batch);
    struct bvhd_error error;
    start = bed_now();
    assert_int_equal(bvhd_client_connect(bed.client, &error), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_CONNECT_MS - 1, BED_LATE_MS);
    assert_non_null(strstr(error.text, "No such file or directory; start bvhd, or build"));
    assert_true(bed_stop(&bed));
}

static void test_path_too_long(void **state)
{
    (void)state;
    struct client_bed bed;
    char path[200];
    memset(path, 'x', sizeof path);
    path[199] = 0;
    struct bvhd_client_options options = {.socket_path = path, .local = BVHD_LOCAL_NEVER};
    bed_options(&bed, &options);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_int_equal(bed_outcome(batch), BVHD_INVALID);
    bed_end(&bed, batch);
}

/* The daemon appears while the client searches for one, and again after a restart. */
static void test_comes_and_goes(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start_impatient(&bed);
    fake_close_listener(&bed.fake);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_int_equal(bvhd_batch_wait(batch, 30), BVHD_PENDING);
    for (int i = 0; i < 3; i++) {
        fake_open_listener(&bed.fake);
        fake_serve(&bed.fake);
        assert_int_equal(bed_outcome(batch), BVHD_OK);
        bvhd_batch_destroy(batch);
        fake_serve_end(&bed.fake);
        fake_hang_up(&bed.fake);
        fake_close_listener(&bed.fake);
        batch = bed_submit(&bed, 1, 1); /* the loss is noticed before this batch is sent */
        assert_int_equal(bvhd_batch_wait(batch, 20), BVHD_PENDING);
    }
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    bed_end(&bed, batch);
}

enum { CALLS = 3 };

/* Makes one of the calls that wait for the daemon itself. */
static enum bvhd_status call(struct client_bed *bed, int which)
{
    struct bvhd_counters *counters = NULL;
    enum bvhd_status status = which == 0   ? bvhd_client_connect(bed->client, NULL)
                              : which == 1 ? bvhd_client_ping(bed->client, 5000, NULL, NULL)
                                           : bvhd_client_counters(bed->client, 5000, &counters, NULL);
    bvhd_counters_destroy(counters);
    return status;
}

/* Every call finds a daemon that was restarted since the last call, not only a submission. */
static void test_calls_after_restart(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    fake_serve(&bed.fake);
    assert_int_equal(bvhd_client_connect(bed.client, NULL), BVHD_OK);
    for (int i = 0; i < CALLS; i++) {
        fake_serve_end(&bed.fake);
        fake_hang_up(&bed.fake);
        fake_serve(&bed.fake);
        assert_int_equal(call(&bed, i), BVHD_OK);
    }
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

/* The daemon accepts and sends nothing. */
static void test_silent_at_hello(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start_impatient(&bed);
    double start = bed_now();
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_CONNECT_MS - 1, BED_LATE_MS);
    bed_end(&bed, batch);
}

/* A daemon that is alive but slow answers PING; one that does not answer is lost. */
static void test_silence(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    uint64_t request;
    bed_start_impatient(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_ask(&bed, &request);
    double start = bed_now();
    for (int i = 0; i < 4; i++) {
        assert_int_equal(bvhd_batch_wait(batch, BED_LOST_MS / 2 + 20), BVHD_PENDING);
        assert_true(fake_expect(&bed.fake, FRAME_PING, &frame));
        fake_send(&bed.fake, FRAME_PONG, frame.header.request, nothing);
    }
    assert_true(bed_now() - start > BED_LOST_MS);
    start = bed_now();
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_LOST_MS - 30, BED_LATE_MS);
    assert_non_null(strstr(bed_text(batch), "silent"));
    bed_end(&bed, batch);
}

/* A program that makes no calls for a long time does not lose its daemon. */
static void test_absent_program(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    uint64_t request;
    bed_start_impatient(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_ask(&bed, &request);
    usleep(1000 * (BED_LOST_MS + 50));
    bvhd_client_dispatch(bed.client);
    assert_int_equal(bed_status(batch, 0), BVHD_PENDING);
    assert_true(fake_expect(&bed.fake, FRAME_PING, &frame));
    fake_send(&bed.fake, FRAME_PONG, frame.header.request, nothing);
    usleep(1000 * (BED_LOST_MS + 50));
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_result(&bed.fake, request, 0, 10);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(bed_status(batch, 0), BVHD_OK);
    bed_end(&bed, batch);
}

/* Work under way ends on its own connection; new work goes to the next daemon. */
static void test_goodbye(void **state)
{
    (void)state;
    struct client_bed bed;
    struct raw_client old;
    struct frame frame;
    uint64_t request;
    bed_start_impatient(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *first = bed_ask(&bed, &request);
    fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
    fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
    bvhd_client_dispatch(bed.client);
    struct bvhd_batch *second = bed_submit(&bed, 1, 1);
    assert_true(fake_accept(&bed.fake, &old));
    assert_true(fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send_welcome(&bed.fake);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_result(&bed.fake, frame.header.request, 0, 20);
    assert_int_equal(bed_outcome(second), BVHD_OK);
    assert_int_equal(bed_status(first, 0), BVHD_PENDING);
    struct raw_client fresh = bed.fake.peer;
    bed.fake.peer = old;
    bed.fake.peer.parser.memory = &bed.fake.peer.memory;
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_result(&bed.fake, request, 0, 30);
    assert_int_equal(bed_outcome(first), BVHD_OK);
    assert_int_equal(bvhd_batch_result(first, 0)->size, 30);
    assert_true(raw_await_close(&bed.fake.peer, 1000, NULL));
    raw_close(&bed.fake.peer);
    bed.fake.peer = fresh;
    bed.fake.peer.parser.memory = &bed.fake.peer.memory;
    bvhd_batch_destroy(first);
    bvhd_batch_destroy(second);
    assert_true(bed_stop(&bed));
}

/* A daemon that has no room ends an idle connection; the program's next call does not notice it. */
static void test_dismissed_while_idle(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start_impatient(&bed);
    assert_true(bed_connect(&bed));
    fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
    raw_close(&bed.fake.peer);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_accept(&bed.fake, NULL));
    assert_true(fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send_welcome(&bed.fake);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_result(&bed.fake, frame.header.request, 0, 20);
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bed_end(&bed, batch);
}

/* Makes the fake daemon speak on another connection. */
static void swap_peer(struct client_bed *bed, struct raw_client *other)
{
    struct raw_client peer = bed->fake.peer;
    bed->fake.peer = *other;
    bed->fake.peer.parser.memory = &bed->fake.peer.memory;
    *other = peer;
}

/* A pool that the leaving daemon refuses is still offered to the next one. */
static void test_goodbye_without_pool(void **state)
{
    (void)state;
    struct client_bed bed;
    struct raw_client other;
    struct frame frame;
    bed_start_impatient(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *first = bed_submit(&bed, 1, 3000);
    assert_true(fake_expect(&bed.fake, FRAME_POOL, &frame));
    close(frame.descriptors[0]);
    uint64_t asked = frame.header.request;
    fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_accept(&bed.fake, &other));
    assert_true(fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send_welcome(&bed.fake);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_take_pool(&bed.fake));
    swap_peer(&bed, &other);
    fake_send_error(&bed.fake, asked, BVHD_UNAVAILABLE, "pool", "leaving");
    bvhd_client_dispatch(bed.client);
    raw_close(&bed.fake.peer);
    swap_peer(&bed, &other);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct bvhd_batch *second = bed_submit(&bed, 1, 3000);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_equal(build->items[0].payload_source, SOURCE_POOL);
    fake_free(&bed.fake, build);
    bvhd_batch_destroy(first);
    bvhd_batch_destroy(second);
    assert_true(bed_stop(&bed));
}

/* If each new daemon says GOODBYE after its first request, the one that has been leaving longest is given up. */
static void test_goodbye_again(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct raw_client gone[2];
    struct bvhd_batch *batches[3];
    bed_start_impatient(&bed);
    for (int i = 0; i < 3; i++) {
        batches[i] = bed_submit(&bed, 1, 1);
        assert_true(fake_accept(&bed.fake, i > 0 ? &gone[i - 1] : NULL));
        assert_true(fake_expect(&bed.fake, FRAME_HELLO, &frame));
        fake_send_welcome(&bed.fake);
        bvhd_client_dispatch(bed.client);
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        fake_send(&bed.fake, FRAME_GOODBYE, 0, nothing);
        bvhd_client_dispatch(bed.client);
    }
    assert_int_equal(bed_status(batches[0], 0), BVHD_UNAVAILABLE);
    assert_int_equal(bed_status(batches[1], 0), BVHD_UNAVAILABLE);
    assert_int_equal(bed_status(batches[2], 0), BVHD_PENDING);
    raw_close(&gone[0]);
    raw_close(&gone[1]);
    for (int i = 0; i < 3; i++)
        bvhd_batch_destroy(batches[i]);
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nobody),
        cmocka_unit_test(test_path_too_long),
        cmocka_unit_test(test_comes_and_goes),
        cmocka_unit_test(test_silent_at_hello),
        cmocka_unit_test(test_silence),
        cmocka_unit_test(test_absent_program),
        cmocka_unit_test(test_goodbye),
        cmocka_unit_test(test_dismissed_while_idle),
        cmocka_unit_test(test_goodbye_again),
        cmocka_unit_test(test_calls_after_restart),
        cmocka_unit_test(test_goodbye_without_pool),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

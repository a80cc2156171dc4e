/* SPDX-License-Identifier: Apache-2.0 */
/* test_holdings.c - tests that a client says which results it has released, and holds no more than it may. */
#include "tests/support/unit.h"

#include "tests/support/client/client_bed.h"

enum { RESULT = 200000, MOST = 300000 };

/* Receives RELEASED, and returns its bytes. */
static uint64_t released(struct client_bed *bed)
{
    struct frame frame;
    struct control_released *message;
    bvhd_client_dispatch(bed->client);
    assert_true(fake_expect(&bed->fake, FRAME_RELEASED, &frame));
    assert_int_equal(control_unpack_released(frame.control, &bed->fake.peer.memory, &message, NULL), BVHD_OK);
    uint64_t bytes = message->bytes;
    fake_free(&bed->fake, message);
    return bytes;
}

/* Submits a build of one structure, and returns the number of its request. */
static uint64_t ask(struct client_bed *bed, struct bvhd_batch **ret_batch)
{
    struct frame frame;
    *ret_batch = bed_submit(bed, 1, 1);
    bvhd_client_dispatch(bed->client);
    assert_true(fake_expect(&bed->fake, FRAME_BUILD, &frame));
    return frame.header.request;
}

static struct bvhd_batch *build(struct client_bed *bed, uint64_t size)
{
    struct bvhd_batch *batch;
    uint64_t request = ask(bed, &batch);
    fake_send_prepared(&bed->fake, request, 0, 1);
    fake_send_result(&bed->fake, request, 0, size);
    assert_true(bed_finish(bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_OK);
    return batch;
}

static void what_is_released_is_told(void **state)
{
    struct client_bed bed;
    (void)state;
    bed_start(&bed);
    bed.fake.welcome.max_held = MOST;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *first = build(&bed, RESULT), *small = build(&bed, 1000);
    bvhd_batch_destroy(small); /* it came inline */
    bvhd_client_dispatch(bed.client);
    assert_true(fake_is_quiet(&bed.fake));
    struct bvhd_blob *blob = bvhd_blob_ref(bvhd_batch_result(first, 0)->blob);
    bvhd_batch_destroy(first);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_is_quiet(&bed.fake));
    bvhd_blob_unref(blob);
    assert_int_equal(released(&bed), RESULT);
    assert_true(bed_stop(&bed));
}

/* A result over the limit is copied, and released at once; its bytes are the same. */
static void no_more_is_held_than_allowed(void **state)
{
    struct client_bed bed;
    static unsigned char want[RESULT];
    (void)state;
    bed_start(&bed);
    bed.fake.welcome.max_held = MOST;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *first = build(&bed, RESULT), *second = build(&bed, RESULT);
    assert_int_equal(released(&bed), RESULT);
    fake_fill(want, RESULT);
    assert_memory_equal(bvhd_batch_result(second, 0)->data, want, RESULT);
    bvhd_batch_destroy(second);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_is_quiet(&bed.fake));
    bvhd_batch_destroy(first);
    assert_int_equal(released(&bed), RESULT);
    assert_true(bed_stop(&bed));
}

/* A result that nobody wants any more is released, too; and a result may outlive its client. */
static void declined_results_are_released(void **state)
{
    struct client_bed bed;
    struct bvhd_batch *batch;
    (void)state;
    bed_start(&bed);
    bed.fake.welcome.max_held = MOST;
    assert_true(bed_connect(&bed));
    uint64_t request = ask(&bed, &batch);
    struct frame frame;
    bvhd_batch_cancel(batch);
    bvhd_batch_destroy(batch);
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_result(&bed.fake, request, 0, RESULT); /* it has crossed the CANCEL */
    bvhd_client_dispatch(bed.client);
    assert_int_equal(released(&bed), RESULT);
    struct bvhd_batch *kept = build(&bed, RESULT);
    struct bvhd_blob *blob = bvhd_blob_ref(bvhd_batch_result(kept, 0)->blob);
    bvhd_batch_destroy(kept);
    bvhd_blob_unref(blob);
    assert_true(bed_stop(&bed));
}

/* A program that frees its last batch and makes no more calls owes the daemon nothing. */
static void freed_batches_are_told_at_once(void **state)
{
    struct client_bed bed;
    struct frame frame;
    (void)state;
    bed_start(&bed);
    bed.fake.welcome.max_held = MOST;
    assert_true(bed_connect(&bed));
    bvhd_batch_destroy(build(&bed, RESULT));
    assert_true(fake_expect(&bed.fake, FRAME_RELEASED, &frame));
    assert_true(bed_stop(&bed));
}

/* A daemon that does not know RELEASED is not sent any. */
static void old_daemons_are_told_nothing(void **state)
{
    struct client_bed bed;
    (void)state;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    bvhd_batch_destroy(build(&bed, RESULT));
    bvhd_client_dispatch(bed.client);
    assert_true(fake_is_quiet(&bed.fake));
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_released_is_told),      cmocka_unit_test(no_more_is_held_than_allowed),
        cmocka_unit_test(declined_results_are_released), cmocka_unit_test(freed_batches_are_told_at_once),
        cmocka_unit_test(old_daemons_are_told_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_callback.c - tests that the callbacks of batches are called exactly once, from the calls that may call them, and
 * what callbacks may do.
 */
#include "tests/support/unit.h"

#include <poll.h>

#include "tests/support/client/client_bed.h"

/* The record of a callback, and its orders. */
struct seen {
    struct client_bed *bed;
    atomic_int calls;
    atomic_uint done; /* items that were done at the last call */
    bool destroys, submits, waits;
    int chain; /* how many more batches each submitted one leads to */
};

static void note(struct bvhd_batch *batch, void *user)
{
    struct seen *seen = user;
    seen->calls++;
    seen->done = bvhd_batch_is_done(batch) ? bvhd_batch_count(batch) : 0;
    if (seen->waits)
        assert_int_equal(bvhd_batch_wait(batch, 0), BVHD_OK);
    if (seen->submits && seen->chain-- > 0) {
        struct bvhd_batch *next;
        assert_int_equal(bvhd_batch_submit(seen->bed->client, &seen->bed->asked->build, &next, NULL), BVHD_OK);
        bvhd_batch_set_callback(next, note, user);
    }
    if (seen->destroys)
        bvhd_batch_destroy(batch);
}

static void answer(struct client_bed *bed, uint64_t request)
{
    fake_send_prepared(&bed->fake, request, 0, 1);
    fake_send_result(&bed->fake, request, 0, 10);
}

static void test_dispatch(void **state)
{
    (void)state;
    struct client_bed bed;
    struct seen seen = {.bed = &bed};
    uint64_t request;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    assert_null(bvhd_batch_user(batch));
    bvhd_batch_set_callback(batch, note, &seen);
    assert_ptr_equal(bvhd_batch_user(batch), &seen);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(seen.calls, 0);
    answer(&bed, request);
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(seen.calls, 1);
    assert_int_equal(seen.done, 1);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    assert_int_equal(seen.calls, 1);
    bed_end(&bed, batch);
}

/* A wait calls the callbacks of all batches that are done. One may destroy the batch that the thread waits for. */
static void test_wait(void **state)
{
    (void)state;
    struct client_bed bed;
    struct seen first = {.bed = &bed, .waits = true}, second = {.bed = &bed}, last = {.bed = &bed, .destroys = true};
    bed_start(&bed);
    fake_serve(&bed.fake);
    struct bvhd_batch *other = bed_submit(&bed, 3, 1), *batch = bed_submit(&bed, 3, 1);
    bvhd_batch_set_callback(other, note, &first);
    bvhd_batch_set_callback(batch, note, &second);
    assert_int_equal(bvhd_batch_wait(other, 10000), BVHD_OK);
    assert_int_equal(first.calls, 1);
    assert_int_equal(bvhd_batch_wait(batch, 10000), BVHD_OK);
    assert_int_equal(second.calls, 1);
    assert_int_equal(second.done, 3);
    bvhd_batch_destroy(other);
    bvhd_batch_destroy(batch);
    batch = bed_submit(&bed, 3, 1);
    bvhd_batch_set_callback(batch, note, &last);
    assert_int_equal(bvhd_batch_wait(batch, 10000), BVHD_OK);
    assert_int_equal(last.calls, 1);
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

/* A callback that is set too late is called by the next dispatch, of which the event loop learns. */
static void test_done_before(void **state)
{
    (void)state;
    struct client_bed bed;
    struct seen seen = {.bed = &bed}, replaced = {.bed = &bed};
    bed_start(&bed);
    struct pollfd loop = {.fd = bvhd_client_descriptor(bed.client), .events = POLLIN};
    struct bvhd_batch *batch = bed_submit(&bed, 0, 0);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(poll(&loop, 1, 0), 0);
    bvhd_batch_set_callback(batch, note, &replaced);
    assert_int_equal(poll(&loop, 1, 0), 1);
    bvhd_batch_set_callback(batch, note, &seen);
    assert_int_equal(seen.calls, 0);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(seen.calls, 1);
    assert_int_equal(replaced.calls, 0);
    assert_int_equal(poll(&loop, 1, 0), 0);
    bvhd_batch_set_callback(batch, note, &replaced);
    bvhd_batch_set_callback(batch, NULL, NULL);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(replaced.calls, 0);
    bed_end(&bed, batch);
}

/* Cancelling calls it, with the next dispatch; destroying does not. */
static void test_cancel_and_destroy(void **state)
{
    (void)state;
    struct client_bed bed;
    struct seen cancelled = {.bed = &bed, .destroys = true}, destroyed = {.bed = &bed};
    bed_start(&bed);
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1), *other = bed_submit(&bed, 2, 1);
    bvhd_batch_set_callback(batch, note, &cancelled);
    bvhd_batch_set_callback(other, note, &destroyed);
    bvhd_batch_cancel(batch);
    bvhd_batch_cancel(other);
    assert_int_equal(cancelled.calls, 0);
    bvhd_batch_destroy(other);
    bvhd_client_dispatch(bed.client);
    assert_int_equal(cancelled.calls, 1);
    assert_int_equal(destroyed.calls, 0);
    assert_true(bed_stop(&bed));
}

/* Each callback submits the next batch and destroys its own. */
static void test_chain(void **state)
{
    (void)state;
    struct client_bed bed;
    struct seen seen = {.bed = &bed, .submits = true, .destroys = true, .chain = 20};
    bed_start(&bed);
    fake_serve(&bed.fake);
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    bvhd_batch_set_callback(batch, note, &seen);
    while (seen.calls < 21)
        assert_int_equal(bvhd_client_ping(bed.client, 10000, NULL, NULL), BVHD_OK);
    assert_int_equal(seen.calls, 21);
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

enum { THREADS = 6, ROUNDS = 100 };

static void *work(void *context)
{
    struct seen *seen = context;
    for (int i = 0; i < ROUNDS; i++) {
        struct bvhd_build build = seen->bed->asked->build;
        struct bvhd_batch *batch;
        build.info_count = (uint32_t)i % 3;
        if (bvhd_batch_submit(seen->bed->client, &build, &batch, NULL) != BVHD_OK)
            continue;
        bvhd_batch_set_callback(batch, note, seen);
        if (i % 4 == 0)
            bvhd_batch_cancel(batch);
        if (i % 5 == 0)
            bvhd_client_dispatch(seen->bed->client);
        else
            bvhd_batch_wait(batch, 10000);
        if (i % 7 == 0) /* another thread may be in the callback: this waits for it */
            bvhd_batch_destroy(batch);
        else
            while (bvhd_batch_wait(batch, 10000) != BVHD_OK)
                ;
        if (i % 7 != 0)
            bvhd_batch_destroy(batch);
    }
    return NULL;
}

/* Many threads wait and dispatch at once. No callback is called twice, or after its batch is gone. */
static void test_threads(void **state)
{
    (void)state;
    struct client_bed bed;
    pthread_t threads[THREADS];
    struct seen seen = {.bed = &bed};
    bed_start(&bed);
    fake_serve(&bed.fake);
    bed_describe(bed.asked, 3, 2);
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, work, &seen), 0);
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    assert_in_range(seen.calls, THREADS * ROUNDS / 2, THREADS * ROUNDS);
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_dispatch),           cmocka_unit_test(test_wait),  cmocka_unit_test(test_done_before),
        cmocka_unit_test(test_cancel_and_destroy), cmocka_unit_test(test_chain), cmocka_unit_test(test_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

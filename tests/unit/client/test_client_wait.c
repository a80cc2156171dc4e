/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client_wait.c - tests the client library with several threads and with event loops: waiting together, cancelling
 * each other, waking.
 */
#include "tests/support/unit.h"

#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/client/client_bed.h"

enum { THREADS = 8, ROUNDS = 60 };

/* One of several threads that do everything at the same time. */
struct worker {
    struct client_bed *bed;
    pthread_t thread;
    unsigned seed;
    uint32_t results, cancelled;
    bool failed;
};

static void take(struct worker *worker, struct bvhd_batch *batch, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        if (result->error.status == BVHD_OK)
            worker->results++;
        else if (result->error.status == BVHD_CANCELLED)
            worker->cancelled++;
        else
            worker->failed = true;
        if (result->error.status == BVHD_OK &&
            ((const unsigned char *)result->data)[result->size - 1] != (result->size - 1) % 251)
            worker->failed = true;
    }
}

static void work_once(struct worker *worker)
{
    struct bed_build *asked = worker->bed->asked;
    struct bvhd_batch *batch;
    struct bvhd_build build = asked->build;
    uint32_t count = build.info_count = 1 + (uint32_t)rand_r(&worker->seed) % 20;
    struct bvhd_key key = {{1}};
    bool is_fetch = rand_r(&worker->seed) % 4 == 0;
    enum bvhd_status status = is_fetch ? bvhd_batch_fetch(worker->bed->client, 1, &key, &batch, NULL)
                                       : bvhd_batch_submit(worker->bed->client, &build, &batch, NULL);
    if (status != BVHD_OK) {
        worker->failed = true;
        return;
    }
    int what = rand_r(&worker->seed) % 8;
    if (what == 0)
        bvhd_batch_cancel(batch);
    if (what == 1)
        bvhd_batch_cancel_item(batch, 0);
    if (what == 2)
        bvhd_client_dispatch(worker->bed->client);
    if (what == 3)
        worker->failed |= bvhd_client_ping(worker->bed->client, 5000, NULL, NULL) != BVHD_OK;
    if (what > 4) {
        worker->failed |= bvhd_batch_wait_copied(batch, 5000) != BVHD_OK;
        worker->failed |= bvhd_batch_wait(batch, 5000) != BVHD_OK;
        take(worker, batch, is_fetch ? 1 : count);
    }
    bvhd_batch_destroy(batch);
}

static void *work(void *context)
{
    struct worker *worker = context;
    for (int i = 0; i < ROUNDS; i++)
        work_once(worker);
    return NULL;
}

static void run_workers(struct client_bed *bed)
{
    struct worker workers[THREADS];
    uint32_t results = 0;
    for (unsigned i = 0; i < THREADS; i++) {
        workers[i] = (struct worker){.bed = bed, .seed = i};
        assert_int_equal(pthread_create(&workers[i].thread, NULL, work, &workers[i]), 0);
    }
    for (int i = 0; i < THREADS; i++) {
        pthread_join(workers[i].thread, NULL);
        assert_false(workers[i].failed);
        results += workers[i].results;
    }
    assert_true(results > THREADS * ROUNDS / 8);
}

static void test_many_threads(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    bed.fake.welcome.credits = 40;
    fake_serve(&bed.fake);
    bed_describe(bed.asked, 20, 500);
    bed.asked->infos[19].dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)100000;
    run_workers(&bed);
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

/* The same with a pool that holds only a few items, so that most of them wait in their caller's memory. */
static void test_many_threads_small_pool(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_client_options options = {.pool_size = 200000, .local = BVHD_LOCAL_NEVER};
    bed_options(&bed, &options);
    fake_serve(&bed.fake);
    bed_describe(bed.asked, 20, 800);
    run_workers(&bed);
    fake_serve_end(&bed.fake);
    assert_true(bed_stop(&bed));
}

struct waiter {
    pthread_t thread;
    struct bvhd_batch *batch;
    atomic_int begun;
    int timeout_ms;
    enum bvhd_status status;
    double ended;
};

static void *wait_for(void *context)
{
    struct waiter *waiter = context;
    waiter->begun = 1;
    waiter->status = bvhd_batch_wait(waiter->batch, waiter->timeout_ms);
    waiter->ended = bed_now();
    return NULL;
}

static void begin_waiting(struct waiter *waiter, struct bvhd_batch *batch, int timeout_ms)
{
    *waiter = (struct waiter){.batch = batch, .timeout_ms = timeout_ms};
    assert_int_equal(pthread_create(&waiter->thread, NULL, wait_for, waiter), 0);
    while (!waiter->begun)
        usleep(100);
    usleep(10000);
}

/* Several threads wait, one of which polls. That one is done first, and another one takes over. */
static void test_takes_over(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frames[4];
    uint64_t requests[4];
    struct bvhd_batch *batches[4];
    struct waiter waiters[4];
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    for (int i = 0; i < 4; i++) {
        batches[i] = bed_submit(&bed, 1, 1);
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frames[i]));
        requests[i] = frames[i].header.request;
        begin_waiting(&waiters[i], batches[i], 5000);
    }
    for (int i = 0; i < 4; i++) {
        static const int order[4] = {0, 2, 1, 3};
        struct waiter *waiter = &waiters[order[i]];
        double start = bed_now();
        fake_send_prepared(&bed.fake, requests[order[i]], 0, 1);
        fake_send_result(&bed.fake, requests[order[i]], 0, 10);
        pthread_join(waiter->thread, NULL);
        assert_int_equal(waiter->status, BVHD_OK);
        assert_true(waiter->ended - start < BED_LATE_MS);
    }
    for (int i = 0; i < 4; i++)
        bvhd_batch_destroy(batches[i]);
    assert_true(bed_stop(&bed));
}

/* The polling thread times out without an event: another one polls from then on. */
static void test_hands_over(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct waiter polling, waiting;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    begin_waiting(&polling, batch, 200);
    begin_waiting(&waiting, batch, 5000);
    pthread_join(polling.thread, NULL);
    assert_int_equal(polling.status, BVHD_PENDING);
    double start = bed_now();
    fake_send_result(&bed.fake, frame.header.request, 0, 10);
    pthread_join(waiting.thread, NULL);
    assert_int_equal(waiting.status, BVHD_OK);
    assert_true(waiting.ended - start < BED_LATE_MS);
    bed_end(&bed, batch);
}

struct caller {
    pthread_t thread;
    struct bvhd_client *client;
    enum bvhd_status status;
    double ended;
};

static void *connect_client(void *context)
{
    struct caller *caller = context;
    caller->status = bvhd_client_connect(caller->client, NULL);
    caller->ended = bed_now();
    return NULL;
}

/*
 * A thread polls a daemon that leaves; another thread connects to the next one. The first thread has to watch the new
 * connection from then on.
 */
static void test_connects_while_another_polls(void **state)
{
    (void)state;
    struct client_bed bed;
    struct raw_client old;
    struct frame frame;
    struct waiter polling;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send(&bed.fake, FRAME_GOODBYE, 0, (struct bytes){NULL, 0});
    begin_waiting(&polling, batch, 20000);
    struct caller caller = {.client = bed.client};
    assert_int_equal(pthread_create(&caller.thread, NULL, connect_client, &caller), 0);
    assert_true(fake_accept(&bed.fake, &old));
    assert_true(fake_expect(&bed.fake, FRAME_HELLO, &frame));
    usleep(10000);
    double start = bed_now();
    fake_send_welcome(&bed.fake);
    pthread_join(caller.thread, NULL);
    assert_int_equal(caller.status, BVHD_OK);
    assert_true(caller.ended - start < BED_LATE_MS);
    bvhd_batch_cancel(batch);
    pthread_join(polling.thread, NULL);
    bvhd_batch_destroy(batch);
    raw_close(&old);
    assert_true(bed_stop(&bed));
}

/* The actions of other threads take effect at once: cancelling, submitting, finishing by a dispatch. */
static void test_woken(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct waiter waiters[2];
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batches[2];
    for (int i = 0; i < 2; i++) {
        batches[i] = bed_submit(&bed, 1, 1);
        begin_waiting(&waiters[i], batches[i], 5000);
    }
    double start = bed_now();
    bvhd_batch_cancel(batches[1]); /* it waits on the condition variable */
    pthread_join(waiters[1].thread, NULL);
    assert_true(waiters[1].ended - start < BED_LATE_MS);
    start = bed_now();
    bvhd_batch_cancel_item(batches[0], 0); /* it polls */
    pthread_join(waiters[0].thread, NULL);
    assert_true(waiters[0].ended - start < BED_LATE_MS);
    bvhd_batch_destroy(batches[0]);
    bvhd_batch_destroy(batches[1]);
    batches[0] = bed_submit(&bed, 1, 1);
    begin_waiting(&waiters[0], batches[0], 5000);
    start = bed_now();
    batches[1] = bed_submit(&bed, 1, 1);
    /* There are three BUILDs with a CANCEL each for two of them, then the last. */
    for (int i = 0; i < 6; i++)
        assert_true(raw_receive(&bed.fake.peer, 1000, &frame, NULL));
    assert_int_equal(frame.header.type, FRAME_BUILD);
    assert_true(bed_now() - start < BED_LATE_MS);
    bvhd_batch_cancel(batches[0]);
    pthread_join(waiters[0].thread, NULL);
    bvhd_batch_destroy(batches[0]);
    bvhd_batch_destroy(batches[1]);
    assert_true(bed_stop(&bed));
}

/* A thread that waits without a daemon is woken when another thread's call connects, and by timeouts. */
static void test_timeouts(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    struct frame frame;
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    request = frame.header.request;
    assert_int_equal(bvhd_batch_wait(batch, 0), BVHD_PENDING);
    double start = bed_now();
    assert_int_equal(bvhd_batch_wait(batch, 30), BVHD_PENDING);
    assert_in_range((int)(bed_now() - start), 29, BED_LATE_MS);
    fake_send_result(&bed.fake, request, 0, 10);
    assert_int_equal(bvhd_batch_wait(batch, 0), BVHD_OK); /* a wait looks for results at least once */
    bed_end(&bed, batch);
}

static bool is_readable(int descriptor, int timeout_ms)
{
    struct pollfd poller = {.fd = descriptor, .events = POLLIN};
    return poll(&poller, 1, timeout_ms) == 1;
}

/* Dispatches while the descriptor is readable. */
static void loop(struct client_bed *bed, struct bvhd_batch *batch, int timeout_ms)
{
    double end = bed_now() + timeout_ms;
    while (!bvhd_batch_is_done(batch) && bed_now() < end)
        if (is_readable(bvhd_client_descriptor(bed->client), (int)(end - bed_now()) + 1))
            bvhd_client_dispatch(bed->client);
}

/* An event loop alone completes everything: a late connection, results, BUSY, the loss of a silent daemon. */
static void test_loop(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start_impatient(&bed);
    int descriptor = bvhd_client_descriptor(bed.client);
    fake_close_listener(&bed.fake);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    loop(&bed, batch, 50);
    fake_open_listener(&bed.fake);
    fake_serve(&bed.fake);
    loop(&bed, batch, 2 * BED_LATE_MS);
    assert_int_equal(bed_status(batch, 0), BVHD_OK);
    bvhd_batch_destroy(batch);
    fake_serve_end(&bed.fake);
    assert_int_equal(bvhd_client_descriptor(bed.client), descriptor);
    batch = bed_submit(&bed, 1, 1);
    double start = bed_now();
    loop(&bed, batch, 2 * BED_LATE_MS); /* the daemon has stopped answering */
    assert_int_equal(bed_status(batch, 0), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_LOST_MS - 20, BED_LATE_MS);
    bvhd_batch_destroy(batch);
    fake_hang_up(&bed.fake);
    fake_close_listener(&bed.fake);
    batch = bed_submit(&bed, 1, 1);
    start = bed_now();
    loop(&bed, batch, 2 * BED_LATE_MS);
    assert_int_equal(bed_status(batch, 0), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - start), BED_CONNECT_MS - 20, BED_LATE_MS);
    bvhd_batch_destroy(batch);
    while (is_readable(descriptor, 50))
        bvhd_client_dispatch(bed.client);
    assert_false(is_readable(descriptor, 400)); /* an idle client causes no events */
    assert_true(bed_stop(&bed));
}

/* The descriptor also becomes readable when another thread finishes a batch. */
static void test_loop_notice(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    int descriptor = bvhd_client_descriptor(bed.client);
    while (is_readable(descriptor, 10))
        bvhd_client_dispatch(bed.client);
    struct bvhd_batch *batches[2] = {bed_submit(&bed, 1, 1), bed_submit(&bed, 1, 1)};
    uint64_t requests[2];
    for (int i = 0; i < 2; i++) {
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        requests[i] = frame.header.request;
    }
    while (is_readable(descriptor, 10))
        bvhd_client_dispatch(bed.client);
    for (int i = 0; i < 2; i++)
        fake_send_result(&bed.fake, requests[i], 0, 10);
    assert_int_equal(bvhd_batch_wait(batches[1], 2000), BVHD_OK); /* it reads both results */
    assert_int_equal(bed_status(batches[0], 0), BVHD_OK);
    assert_true(is_readable(descriptor, 0));
    bvhd_client_dispatch(bed.client);
    assert_false(is_readable(descriptor, 10));
    bvhd_batch_destroy(batches[0]);
    bvhd_batch_destroy(batches[1]);
    assert_true(bed_stop(&bed));
}

/* Forks a child process that holds the client's sockets, but not the daemon's, until it is told to end. */
static pid_t fork_holder(struct client_bed *bed, int *ret_leash)
{
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    pid_t child = fork();
    if (child == 0) {
        char byte;
        close(ends[1]);
        close(bed->fake.peer.socket);
        _exit(read(ends[0], &byte, 1) == 0 ? 0 : 1);
    }
    close(ends[0]);
    *ret_leash = ends[1];
    return child;
}

static void end_holder(pid_t child, int leash)
{
    int status;
    close(leash);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
}

/* A child that holds the parent's socket neither keeps the parent's loop awake nor the daemon waiting. */
static void test_fork(void **state)
{
    (void)state;
    struct client_bed bed;
    int leashes[2];
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    int descriptor = bvhd_client_descriptor(bed.client);
    bvhd_client_dispatch(bed.client);
    pid_t first = fork_holder(&bed, &leashes[0]);
    fake_hang_up(&bed.fake);
    assert_true(is_readable(descriptor, BED_LATE_MS));
    for (int i = 0; i < 10 && is_readable(descriptor, 0); i++)
        bvhd_client_dispatch(bed.client);
    assert_false(is_readable(descriptor, 50));
    assert_true(bed_connect(&bed));
    pid_t second = fork_holder(&bed, &leashes[1]);
    bvhd_client_destroy(bed.client);
    bed.client = NULL;
    assert_true(raw_await_close(&bed.fake.peer, BED_LATE_MS, NULL));
    end_holder(second, leashes[1]);
    end_holder(first, leashes[0]);
    assert_true(bed_stop(&bed));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_many_threads), cmocka_unit_test(test_many_threads_small_pool),
        cmocka_unit_test(test_takes_over),   cmocka_unit_test(test_hands_over),
        cmocka_unit_test(test_woken),        cmocka_unit_test(test_timeouts),
        cmocka_unit_test(test_loop),         cmocka_unit_test(test_loop_notice),
        cmocka_unit_test(test_fork),         cmocka_unit_test(test_connects_while_another_polls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

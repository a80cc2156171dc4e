/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client_deadline.c - tests that batches end at their deadline: sent, unsent, or built in this process; and that
 * the daemon learns how much time is left.
 */
#include "tests/support/unit.h"

#include <poll.h>

#include "client/client_batch.h"
#include "tests/support/client/client_bed.h"
#include "tests/support/client/local_bed.h"

enum { SOON_MS = 60, LATER_MS = 3600 * 1000 };

static void expect_late(struct bvhd_batch *batch, uint32_t item, const char *text)
{
    const struct bvhd_error *error = &bvhd_batch_result(batch, item)->error;
    assert_int_equal(error->status, BVHD_CANCELLED);
    assert_string_equal(error->where, "deadline");
    assert_string_equal(error->text, text);
}

static const char soon_text[] = "no result within 60 ms, the deadline of the request";

static struct bvhd_batch *submit(struct client_bed *bed, uint32_t count, uint32_t deadline_ms)
{
    struct bvhd_batch *batch = NULL;
    bed_describe(bed->asked, count, 1);
    bed->asked->build.deadline_ms = deadline_ms;
    assert_int_equal(bvhd_batch_submit(bed->client, &bed->asked->build, &batch, NULL), BVHD_OK);
    return batch;
}

/* Receives a BUILD, and returns its request and how much time it has. */
static uint32_t expect_build(struct client_bed *bed, uint64_t *ret_request)
{
    struct frame frame;
    assert_true(fake_expect(&bed->fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed->fake, &frame);
    uint32_t deadline_ms = build->deadline_ms;
    *ret_request = frame.header.request;
    fake_free(&bed->fake, build);
    return deadline_ms;
}

/* The daemon gets the rest of the time, and a CANCEL; the item that had its result keeps it. */
static void sent_items_end(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = submit(&bed, 2, SOON_MS);
    uint32_t left = expect_build(&bed, &request);
    assert_true(left >= 1 && left <= SOON_MS);
    fake_send_prepared(&bed.fake, request, 0, 2);
    fake_send_result(&bed.fake, request, 1, 10);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    expect_late(batch, 0, soon_text);
    assert_int_equal(bed_status(batch, 1), BVHD_OK);
    assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
    assert_int_equal(frame.header.request, request);
    fake_send_failed(&bed.fake, request, 0, BVHD_CANCELLED, "");
    bed_end(&bed, batch);
}

/* An hour is an hour in the frame, and no deadline is none. */
static void time_is_sent(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *later = submit(&bed, 1, LATER_MS);
    uint32_t left = expect_build(&bed, &request);
    assert_true(left <= LATER_MS && left > LATER_MS / 2);
    struct bvhd_batch *never = submit(&bed, 1, 0);
    assert_int_equal(expect_build(&bed, &request), 0);
    struct bvhd_batch *sooner = submit(&bed, 1, LATER_MS / 2);
    expect_build(&bed, &request);
    bvhd_batch_destroy(later);
    bvhd_batch_destroy(never);
    bvhd_batch_cancel(sooner);
    bvhd_batch_destroy(sooner);
    assert_true(bed_stop(&bed));
}

/* The daemon counts from the frame's arrival, and knows only the rest: the program reads the time that it gave. */
static void daemon_ends_them_first(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = submit(&bed, 1, LATER_MS);
    expect_build(&bed, &request);
    fake_send_prepared(&bed.fake, request, 0, 1);
    fake_send_failed(&bed.fake, request, 0, BVHD_CANCELLED, "deadline");
    assert_true(bed_finish(&bed, batch));
    expect_late(batch, 0, "no result within 3600000 ms, the deadline of the request");
    bed_end(&bed, batch);
}

/* A batch for which there is no connection yet, and one whose daemon is busy. */
static void unsent_items_end(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    bed_start(&bed);
    struct bvhd_batch *batch = submit(&bed, 3, SOON_MS);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    for (uint32_t i = 0; i < 3; i++)
        expect_late(batch, i, soon_text);
    assert_true(bvhd_batch_is_copied(batch));
    bvhd_batch_destroy(batch);
    assert_true(fake_greet(&bed.fake));
    bvhd_client_dispatch(bed.client);
    batch = submit(&bed, 1, SOON_MS);
    expect_build(&bed, &request);
    fake_send_busy(&bed.fake, request, 2000);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    expect_late(batch, 0, soon_text);
    bed_end(&bed, batch);
}

/* An event loop is woken by the deadline alone. */
static void event_loops_wake(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct pollfd watched = {.fd = bvhd_client_descriptor(bed.client), .events = POLLIN};
    struct bvhd_batch *never = submit(&bed, 1, 0), *later = submit(&bed, 1, LATER_MS);
    struct bvhd_batch *batches[2] = {submit(&bed, 1, 2 * SOON_MS), submit(&bed, 1, SOON_MS)};
    for (int i = 0; i < 4; i++)
        expect_build(&bed, &request);
    while (!bvhd_batch_is_done(batches[0])) {
        assert_int_equal(poll(&watched, 1, 2000), 1); /* sooner than the client would ask a silent daemon */
        bvhd_client_dispatch(bed.client);
    }
    assert_true(bvhd_batch_is_done(batches[1]));
    expect_late(batches[1], 0, soon_text);
    assert_int_equal(bed_status(later, 0), BVHD_PENDING);
    assert_int_equal(bed_status(never, 0), BVHD_PENDING);
    for (int i = 0; i < 2; i++)
        bvhd_batch_destroy(batches[i]);
    bvhd_batch_destroy(later);
    bvhd_batch_destroy(never);
    assert_true(bed_stop(&bed));
}

/* The thread that builds, or one of the client, stops; what has time enough is built. */
static void builds_here_end(void **state)
{
    (void)state;
    for (uint32_t threads = 0; threads <= 2; threads++) {
        struct local_bed bed;
        struct terrain mesh;
        local_bed_start(&bed, threads);
        terrain_init(&mesh, 400000, 99);
        struct bvhd_batch *batch = local_bed_submit_long(bed.client, &mesh, BVHD_PRIORITY_NORMAL, SOON_MS);
        struct bvhd_batch *other = local_bed_submit_long(bed.client, bed.meshes, BVHD_PRIORITY_NORMAL, LATER_MS);
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        expect_late(batch, 0, soon_text);
        assert_true(bvhd_batch_progress(batch, 0) == 1);
        assert_int_equal(bvhd_batch_wait(other, -1), BVHD_OK);
        local_bed_expect_ok(other);
        bvhd_batch_destroy(batch);
        bvhd_batch_destroy(other);
        terrain_finish(&mesh);
        local_bed_stop(&bed);
    }
}

/* An item that waits for the same build, and has more time, gets its result. */
static void others_go_on(void **state)
{
    (void)state;
    struct local_bed bed;
    struct terrain mesh;
    struct local_bed_waiting waiting[2];
    local_bed_start(&bed, 0);
    terrain_init(&mesh, 30000, 5);
    for (int i = 0; i < 2; i++) {
        struct bvhd_batch *batch =
            local_bed_submit_long(bed.client, &mesh, BVHD_PRIORITY_NORMAL, i == 0 ? SOON_MS : LATER_MS);
        local_bed_start_waiting(&waiting[i], batch);
    }
    for (int i = 0; i < 2; i++)
        pthread_join(waiting[i].thread, NULL);
    local_bed_expect_ok(waiting[1].batch);
    assert_true(local_bed_status(waiting[0].batch, 0) == BVHD_OK ||
                local_bed_status(waiting[0].batch, 0) == BVHD_CANCELLED);
    for (int i = 0; i < 2; i++)
        bvhd_batch_destroy(waiting[i].batch);
    terrain_finish(&mesh);
    local_bed_stop(&bed);
}

/* A batch that has a deadline can be cancelled and destroyed like any other. */
static void batches_may_go_before(void **state)
{
    (void)state;
    struct local_bed bed;
    struct bvhd_batch *batches[LOCAL_BED_MESHES];
    local_bed_start(&bed, 0);
    for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++)
        batches[i] = local_bed_submit_long(bed.client, &bed.meshes[i], BVHD_PRIORITY_NORMAL,
                                           LATER_MS - (i * 5 % LOCAL_BED_MESHES));
    const struct list_link *link = bed.client->timed.first;
    for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++, link = link->next)
        assert_true(!link->next || link->next->previous == link);
    assert_null(link);
    bvhd_batch_cancel(batches[2]);
    bvhd_batch_destroy(batches[5]);
    assert_int_equal(bvhd_batch_wait(batches[0], -1), BVHD_OK);
    for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++)
        if (i != 5)
            bvhd_batch_destroy(batches[i]);
    assert_null(bed.client->timed.first);
    local_bed_stop(&bed);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(sent_items_end),         cmocka_unit_test(time_is_sent),
        cmocka_unit_test(daemon_ends_them_first), cmocka_unit_test(unsent_items_end),
        cmocka_unit_test(event_loops_wake),       cmocka_unit_test(builds_here_end),
        cmocka_unit_test(others_go_on),           cmocka_unit_test(batches_may_go_before),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client_queue.c - tests the requests that the client library keeps in its queue: for want of pool memory or
 * credits, by priority, with busy daemons and with strange limits.
 */
#include "tests/support/unit.h"

#include <sys/mman.h>
#include <unistd.h>

#include "tests/support/client/client_bed.h"

/* Receives one BUILD with a payload in the pool; returns its offset. */
static uint64_t expect_pooled(struct client_bed *bed, uint64_t *ret_request)
{
    struct frame frame;
    assert_true(fake_expect(&bed->fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed->fake, &frame);
    assert_int_equal(build->item_count, 1);
    assert_int_equal(build->items[0].payload_source, SOURCE_POOL);
    assert_int_equal(frame.inline_bytes.size, 0);
    uint64_t offset = build->items[0].payload_offset, size = build->items[0].payload_size;
    assert_true(size <= bed->fake.pool_size && offset <= bed->fake.pool_size - size);
    assert_memory_equal(bed->fake.pool + offset + 96, bed->asked->vertices, 36);
    *ret_request = frame.header.request;
    fake_free(&bed->fake, build);
    return offset;
}

/* Medium payloads stay in the pool until they are PREPARED, whatever else happens to the item. */
static void test_pool(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_batch *batches[3];
    uint64_t offsets[3], requests[3];
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    batches[0] = bed_submit(&bed, 1, 1000);
    assert_true(bvhd_batch_is_copied(batches[0]));
    assert_true(fake_take_pool(&bed.fake));
    bvhd_client_dispatch(bed.client);
    offsets[0] = expect_pooled(&bed, &requests[0]);
    assert_int_equal(offsets[0], 0);
    fake_send_result(&bed.fake, requests[0], 0, 10);
    assert_true(bed_finish(&bed, batches[0]));
    bvhd_batch_destroy(batches[0]);
    batches[1] = bed_submit(&bed, 1, 1000);
    offsets[1] = expect_pooled(&bed, &requests[1]);
    assert_true(offsets[1] >= 36096);
    bvhd_batch_cancel(batches[1]);
    assert_int_equal(bed_status(batches[1], 0), BVHD_CANCELLED);
    struct frame frame;
    assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
    assert_int_equal(frame.header.request, requests[1]);
    fake_send_prepared(&bed.fake, requests[0], 0, 1);
    bvhd_client_dispatch(bed.client);
    batches[2] = bed_submit(&bed, 1, 1000);
    offsets[2] = expect_pooled(&bed, &requests[2]);
    assert_int_equal(offsets[2], 0);
    fake_send_failed(&bed.fake, requests[1], 0, BVHD_CANCELLED, "");
    fake_send_prepared(&bed.fake, requests[1], 0, 1);
    fake_send_prepared(&bed.fake, requests[2], 0, 1);
    fake_send_result(&bed.fake, requests[2], 0, 10);
    assert_true(bed_finish(&bed, batches[2]));
    bvhd_batch_destroy(batches[1]);
    bvhd_batch_destroy(batches[2]);
    assert_true(bed_stop(&bed));
}

/*
 * With a daemon that has no pool, or refuses it, small payloads travel inline and larger ones in their own memfds, at
 * most four per frame.
 */
static void test_no_pool(void **state)
{
    for (int refuses = 0; refuses < 2; refuses++) {
        struct client_bed bed;
        struct frame frame;
        (void)state;
        bed_start(&bed);
        bed.fake.welcome.max_pool = refuses ? 64 << 20 : 0;
        assert_true(bed_connect(&bed));
        struct bvhd_batch *batch = bed_submit(&bed, 6, 3000);
        if (refuses) {
            assert_true(fake_expect(&bed.fake, FRAME_POOL, &frame));
            close(frame.descriptors[0]);
            fake_send_error(&bed.fake, frame.header.request, BVHD_NO_MEMORY, "pool", "too many pools");
            bvhd_client_dispatch(bed.client);
        }
        uint32_t seen = 0;
        while (seen < 6) {
            assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
            struct control_build *build = fake_build(&bed.fake, &frame);
            assert_int_equal(build->memfd_count, frame.header.descriptors);
            for (uint32_t i = 0; i < build->item_count; i++) {
                assert_int_equal(build->items[i].payload_source, SOURCE_MEMFD);
                uint32_t memfd = build->items[i].memfd;
                assert_in_range(memfd, 0, frame.header.descriptors - 1);
                assert_int_equal(build->memfd_sizes[memfd], build->items[i].payload_size);
                unsigned char *bytes =
                    mmap(NULL, build->items[i].payload_size, PROT_READ, MAP_PRIVATE, frame.descriptors[memfd], 0);
                assert_ptr_not_equal(bytes, MAP_FAILED);
                assert_memory_equal(bytes + 96, bed.asked->vertices + (seen + i) * 27000, 108000);
                munmap(bytes, build->items[i].payload_size);
            }
            for (uint32_t i = 0; i < frame.header.descriptors; i++)
                close(frame.descriptors[i]);
            fake_send_prepared(&bed.fake, frame.header.request, 0, build->item_count);
            for (uint32_t i = 0; i < build->item_count; i++)
                fake_send_result(&bed.fake, frame.header.request, i, 10);
            seen += build->item_count;
            fake_free(&bed.fake, build);
            bvhd_client_dispatch(bed.client);
        }
        assert_true(bed_finish(&bed, batch));
        for (uint32_t i = 0; i < 6; i++)
            assert_int_equal(bed_status(batch, i), BVHD_OK);
        bed_end(&bed, batch);
    }
}

/* Payloads that do not fit into the pool wait in the caller's memory, in order. */
static void test_full_pool(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_client_options options = {.pool_size = 128 << 10, .local = BVHD_LOCAL_NEVER};
    bed_options(&bed, &options);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 5, 1500); /* two of them fit */
    assert_false(bvhd_batch_is_copied(batch));
    assert_true(fake_take_pool(&bed.fake));
    bvhd_client_dispatch(bed.client);
    for (uint32_t seen = 0; seen < 5;) {
        struct frame frame;
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        struct control_build *build = fake_build(&bed.fake, &frame);
        for (uint32_t i = 0; i < build->item_count; i++) {
            assert_int_equal(build->items[i].destination, seen + i + 1);
            assert_memory_equal(bed.fake.pool + build->items[i].payload_offset + 96,
                                bed.asked->vertices + (seen + i) * 13500, 54000);
            fake_send_result(&bed.fake, frame.header.request, i, 10);
        }
        seen += build->item_count;
        if (seen < 4) {
            bvhd_client_dispatch(bed.client);
            assert_true(fake_is_quiet(&bed.fake));
            assert_false(bvhd_batch_is_copied(batch));
        }
        fake_send_prepared(&bed.fake, frame.header.request, 0, build->item_count);
        fake_free(&bed.fake, build);
        bvhd_client_dispatch(bed.client);
    }
    assert_true(bvhd_batch_is_copied(batch));
    assert_true(bed_finish(&bed, batch));
    bed_end(&bed, batch);
}

/* There are never more items under way than the daemon gave credits for, nor more in a request than it accepts. */
static void test_credits(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    bed.fake.welcome.credits = 5;
    bed.fake.welcome.max_items = 3;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 20, 1);
    uint32_t under_way = 0, answered = 0;
    while (answered < 20) {
        struct frame frame;
        while (under_way < 5 && answered + under_way < 20) {
            assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
            struct control_build *build = fake_build(&bed.fake, &frame);
            assert_in_range(build->item_count, 1, 3);
            under_way += build->item_count;
            assert_in_range(under_way, 1, 5);
            fake_send_prepared(&bed.fake, frame.header.request, 0, build->item_count);
            for (uint32_t i = 0; i < build->item_count; i++)
                fake_send_result(&bed.fake, frame.header.request, i, 10);
            under_way -= build->item_count;
            answered += build->item_count;
            fake_free(&bed.fake, build);
            bvhd_client_dispatch(bed.client);
        }
    }
    assert_true(bed_finish(&bed, batch));
    bvhd_batch_destroy(batch);
    batch = bed_submit(&bed, 20, 1);
    struct frame frame;
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    assert_true(fake_is_quiet(&bed.fake));
    assert_true(bvhd_batch_is_copied(batch));
    bed_end(&bed, batch);
}

static void check_first(struct client_bed *bed, uint64_t destination, int32_t priority, uint64_t *ret_request)
{
    struct frame frame;
    assert_true(fake_expect(&bed->fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed->fake, &frame);
    assert_int_equal(build->items[0].destination, destination);
    assert_int_equal(build->priority, priority);
    *ret_request = frame.header.request;
    fake_free(&bed->fake, build);
}

/* Batches that wait in the library are sent by priority, then by age. */
static void test_priority(void **state)
{
    (void)state;
    static const int32_t priorities[5] = {0, 0, -1, 1, 1};
    static const struct {
        uint64_t destination;
        int32_t priority;
    } order[5] = {{100, 0}, {103, 1}, {104, 1}, {101, 0}, {102, -1}};
    struct client_bed bed;
    struct bvhd_batch *batches[5];
    uint64_t request;
    bed_start(&bed);
    bed.fake.welcome.credits = 1;
    assert_true(bed_connect(&bed));
    for (int i = 0; i < 5; i++) {
        bed_describe(bed.asked, 1, 1);
        bed.asked->build.priority = (enum bvhd_priority)priorities[i];
        bed.asked->infos[0].dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)(100 + i);
        assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batches[i], NULL), BVHD_OK);
    }
    for (int i = 0; i < 5; i++) {
        check_first(&bed, order[i].destination, order[i].priority, &request);
        fake_send_prepared(&bed.fake, request, 0, 1);
        fake_send_result(&bed.fake, request, 0, 10);
        bvhd_client_dispatch(bed.client);
    }
    for (int i = 0; i < 5; i++)
        bvhd_batch_destroy(batches[i]);
    assert_true(bed_stop(&bed));
}

/* A busy daemon gets the same request again, after the time that it stated and not before. */
static void test_busy(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    uint64_t request = frame.header.request, size = frame.inline_bytes.size;
    fake_send_busy(&bed.fake, request, 50);
    double start = bed_now();
    bvhd_client_dispatch(bed.client);
    struct bvhd_batch *second = bed_submit(&bed, 1, 1);
    assert_true(fake_is_quiet(&bed.fake));
    bool waiting = true;
    while (waiting && bed_now() < start + BED_LATE_MS) {
        bvhd_client_dispatch(bed.client);
        waiting = !raw_receive(&bed.fake.peer, 1, &frame, NULL);
    }
    assert_in_range((int)(bed_now() - start), 49, BED_LATE_MS);
    assert_int_equal(frame.header.request, request);
    assert_int_equal(frame.inline_bytes.size, size);
    fake_send_prepared(&bed.fake, request, 0, 2);
    fake_send_result(&bed.fake, request, 1, 10);
    fake_send_result(&bed.fake, request, 0, 10);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_prepared(&bed.fake, frame.header.request, 0, 1);
    fake_send_result(&bed.fake, frame.header.request, 0, 10);
    assert_true(bed_finish(&bed, batch) && bed_finish(&bed, second));
    assert_int_equal(bed_status(batch, 0), BVHD_OK);
    bvhd_batch_destroy(batch);
    bvhd_batch_destroy(second);
    assert_true(bed_stop(&bed));
}

/* A batch that is cancelled while the daemon is busy is never sent, or only its rest is. */
static void test_busy_cancelled(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    bed.fake.welcome.credits = 3;
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batches[2] = {bed_submit(&bed, 1, 1), bed_submit(&bed, 2, 1)};
    for (int i = 0; i < 2; i++) {
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        fake_send_busy(&bed.fake, frame.header.request, 0);
    }
    bvhd_client_dispatch(bed.client);
    bvhd_batch_destroy(batches[0]);
    bvhd_batch_cancel_item(batches[1], 0);
    assert_int_equal(bed_status(batches[1], 0), BVHD_CANCELLED);
    bvhd_batch_wait(batches[1], 30);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    uint64_t request = frame.header.request;
    assert_true(fake_expect(&bed.fake, FRAME_CANCEL, &frame));
    assert_int_equal(frame.header.request, request);
    fake_send_prepared(&bed.fake, request, 0, 2);
    fake_send_failed(&bed.fake, request, 0, BVHD_CANCELLED, "");
    fake_send_result(&bed.fake, request, 1, 10);
    assert_true(bed_finish(&bed, batches[1]));
    assert_int_equal(bed_status(batches[1], 1), BVHD_OK);
    bvhd_batch_destroy(batches[1]);
    batches[0] = bed_submit(&bed, 3, 1); /* all credits are back */
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_equal(build->item_count, 3);
    fake_free(&bed.fake, build);
    bvhd_batch_destroy(batches[0]);
    assert_true(bed_stop(&bed));
}

/* A daemon may announce any limits, however strange. */
static void test_strange_limits(void **state)
{
    (void)state;
    static const struct control_welcome welcomes[] = {
        {.version = 1},
        {1, "all the most", UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX,
         UINT32_MAX, true, true},
        {1, "all the least", 1, 1, 1, 1, 1, UINT64_MAX, 1, 1, false, false},
    };
    for (size_t i = 0; i < sizeof welcomes / sizeof welcomes[0]; i++) {
        struct client_bed bed;
        (void)state;
        bed_start(&bed);
        bed.fake.welcome = welcomes[i];
        struct bvhd_batch *batch = bed_submit(&bed, 40, 10);
        fake_serve(&bed.fake);
        assert_int_equal(bvhd_batch_wait(batch, 10000), BVHD_OK);
        for (uint32_t k = 0; k < 40; k++)
            assert_int_equal(bed_status(batch, k), BVHD_OK);
        bvhd_batch_destroy(batch);
        batch = bed_submit(&bed, 3, 3000);
        assert_int_equal(bvhd_batch_wait(batch, 10000), BVHD_OK);
        assert_int_equal(bed_status(batch, 2), BVHD_OK);
        bvhd_batch_destroy(batch);
        fake_serve_end(&bed.fake);
        assert_true(bed_stop(&bed));
    }
}

static void test_max_payload(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    bed.fake.welcome.max_payload = 131;
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_greet(&bed.fake));
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_TOO_LARGE);
    bed_end(&bed, batch);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pool),           cmocka_unit_test(test_no_pool),
        cmocka_unit_test(test_full_pool),      cmocka_unit_test(test_credits),
        cmocka_unit_test(test_priority),       cmocka_unit_test(test_busy),
        cmocka_unit_test(test_busy_cancelled), cmocka_unit_test(test_strange_limits),
        cmocka_unit_test(test_max_payload),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

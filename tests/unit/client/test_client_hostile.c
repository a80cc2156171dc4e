/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client_hostile.c - tests the client library against daemons that break the protocol: it reports errors in time
 * and leaks nothing.
 */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/support/client/client_bed.h"

enum { SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE };

static const struct bytes nothing = {NULL, 0};

/* Answers HELLO with a frame of the test's choice. */
static enum bvhd_status answer_hello(struct client_bed *bed, enum frame_type type, struct bytes control,
                                     struct bvhd_error *ret_error)
{
    struct frame frame;
    struct bvhd_batch *batch = bed_submit(bed, 1, 1);
    assert_true(fake_accept(&bed->fake, NULL) && fake_expect(&bed->fake, FRAME_HELLO, &frame));
    fake_send(&bed->fake, type, 0, control);
    enum bvhd_status status = bed_outcome(batch);
    *ret_error = bvhd_batch_result(batch, 0)->error;
    bvhd_batch_destroy(batch);
    return status;
}

static void test_versions(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct bvhd_error error;
    bed_start(&bed);
    static const uint32_t versions[] = {0, 2, UINT32_MAX};
    for (int i = 0; i < 3; i++) {
        struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
        bed.fake.welcome.version = versions[i];
        assert_true(fake_greet(&bed.fake));
        double start = bed_now();
        assert_int_equal(bed_outcome(batch), BVHD_INCOMPATIBLE);
        assert_true(bed_now() - start < BED_LATE_MS);
        bvhd_batch_destroy(batch);
    }
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_accept(&bed.fake, NULL) && fake_expect(&bed.fake, FRAME_HELLO, &frame));
    struct control_hello *hello;
    assert_int_equal(control_unpack_hello(frame.control, &bed.fake.peer.memory, &hello, NULL), BVHD_OK);
    assert_int_equal(hello->version_min, CONTROL_VERSION);
    assert_int_equal(hello->version_max, CONTROL_VERSION);
    fake_free(&bed.fake, hello);
    fake_send_error(&bed.fake, 0, BVHD_INCOMPATIBLE, "hello", "versions 2 to 3, not 1 to 1");
    assert_int_equal(bed_outcome(batch), BVHD_INCOMPATIBLE);
    assert_non_null(strstr(bed_text(batch), "versions 2 to 3"));
    bvhd_batch_destroy(batch);
    assert_int_equal(answer_hello(&bed, FRAME_PONG, nothing, &error), BVHD_UNAVAILABLE);
    assert_non_null(strstr(error.text, "breaks the protocol"));
    assert_true(bed_stop(&bed));
}

/* A peer whose first frame is not WELCOME is not a daemon. */
static void test_garbage(void **state)
{
    (void)state;
    static const char *const garbage[] = {"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n",
                                          "BVHD, but the rest is something else altogether"};
    struct client_bed bed;
    bed_start(&bed);
    for (int i = 0; i < 2; i++) {
        struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
        assert_true(fake_accept(&bed.fake, NULL));
        raw_send(&bed.fake.peer, garbage[i], strlen(garbage[i]), NULL, 0);
        assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
        assert_int_equal(strncmp(bvhd_batch_result(batch, 0)->error.where, "frame.", 6), 0);
        bvhd_batch_destroy(batch);
    }
    assert_true(bed_stop(&bed));
}

/* Sends everything that a daemon sends from WELCOME to a large result, cut off after `cut` bytes. */
static void send_cut(struct client_bed *bed, uint64_t request, size_t cut)
{
    unsigned char bytes[4096];
    size_t size = 0;
    struct control_items items = {1, (uint32_t[]){0}};
    struct control_result result = {.size = 100};
    for (int i = 0; i < 2; i++) {
        unsigned char data[100] = {0};
        struct raw_frame frame = {.header = {.type = i == 0 ? FRAME_PREPARED : FRAME_RESULT, .request = request}};
        enum bvhd_status status = i == 0 ? control_pack_items(&items, &bed->fake.peer.memory, &frame.control, NULL)
                                         : control_pack_result(&result, &bed->fake.peer.memory, &frame.control, NULL);
        assert_int_equal(status, BVHD_OK);
        if (i == 1)
            frame.inline_bytes = (struct bytes){data, sizeof data};
        size_t frame_size;
        unsigned char *frame_bytes = raw_frame_bytes(&frame, &frame_size);
        memcpy(bytes + size, frame_bytes, frame_size);
        size += frame_size;
        free(frame_bytes);
        fake_free(&bed->fake, (void *)(uintptr_t)frame.control.data);
    }
    raw_send(&bed->fake.peer, bytes, cut < size ? cut : size, NULL, 0);
}

static void test_hangs_up_at_each_byte(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    enum bvhd_status status = BVHD_UNAVAILABLE;
    size_t cut = 0;
    for (; status == BVHD_UNAVAILABLE && cut < 4096; cut++) {
        uint64_t request;
        assert_true(bed_connect(&bed));
        struct bvhd_batch *batch = bed_ask(&bed, &request);
        send_cut(&bed, request, cut);
        fake_hang_up(&bed.fake);
        status = bed_outcome(batch);
        bvhd_batch_destroy(batch);
    }
    assert_int_equal(status, BVHD_OK);
    assert_in_range(cut, 2 * FRAME_HEADER_SIZE + 100, 400);
    assert_true(bed_stop(&bed));
}

/* Before WELCOME the client reacts to a loss by searching further. */
static void test_hangs_up_early(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(fake_accept(&bed.fake, NULL));
    fake_hang_up(&bed.fake);
    assert_int_equal(bvhd_batch_wait(batch, 50), BVHD_PENDING);
    assert_true(fake_accept(&bed.fake, NULL) && fake_expect(&bed.fake, FRAME_HELLO, &frame));
    fake_send_error(&bed.fake, 0, BVHD_BUSY, "connection", "too many connections");
    fake_hang_up(&bed.fake);
    assert_int_equal(bvhd_batch_wait(batch, 50), BVHD_PENDING);
    assert_true(fake_greet(&bed.fake));
    bvhd_client_dispatch(bed.client);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_error(&bed.fake, 0, BVHD_NO_MEMORY, "connection", "no memory for an answer");
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_non_null(strstr(bed_text(batch), "no memory for an answer"));
    bed_end(&bed, batch);
}

/* Answers that a daemon must not give. Each ends the connection. */
enum wrong {
    UNKNOWN_REQUEST,
    OLD_REQUEST,
    ANSWER_WHILE_BUSY,
    UNKNOWN_ITEM,
    SECOND_RESULT,
    SECOND_PREPARED,
    PREPARED_ITEM,
    BUSY_AFTER_PREPARED,
    DONE_FOR_BUILD,
    PONG_FOR_BUILD,
    COUNTERS_FOR_BUILD,
    SECOND_WELCOME,
    CLIENT_FRAME,
    RESULT_OF_CONNECTION,
    ANSWER_WITHOUT_QUESTION,
    PROGRESS_OF_NO_ITEM,
    PROGRESS_BEYOND_THE_END,
    BAD_CONTROL,
    WRONG_COUNT
};

static void send_wrong(struct client_bed *bed, enum wrong wrong, uint64_t request)
{
    struct fake_daemon *fake = &bed->fake;
    switch (wrong) {
    case UNKNOWN_REQUEST:
        fake_send_result(fake, request + 1, 0, 10);
        break;
    case OLD_REQUEST: /* its slot is that of the new request */
        fake_send_result(fake, request - (1 << 16), 0, 10);
        break;
    case ANSWER_WHILE_BUSY:
        fake_send_busy(fake, request, 1000);
        fake_send_result(fake, request, 0, 10);
        break;
    case UNKNOWN_ITEM:
        fake_send_result(fake, request, 2, 10);
        break;
    case SECOND_RESULT:
        fake_send_result(fake, request, 1, 10);
        fake_send_result(fake, request, 1, 10);
        break;
    case SECOND_PREPARED:
        fake_send_prepared(fake, request, 1, 1);
        fake_send_prepared(fake, request, 0, 2);
        break;
    case PREPARED_ITEM:
        fake_send_prepared(fake, request, 1, 2);
        break;
    case BUSY_AFTER_PREPARED:
        fake_send_prepared(fake, request, 0, 1);
        fake_send_busy(fake, request, 1);
        break;
    case DONE_FOR_BUILD:
        fake_send(fake, FRAME_DONE, request, nothing);
        break;
    case PONG_FOR_BUILD:
        fake_send(fake, FRAME_PONG, request, nothing);
        break;
    case COUNTERS_FOR_BUILD:
        fake_send(fake, FRAME_COUNTERS, request, nothing);
        break;
    case SECOND_WELCOME:
        fake_send_welcome(fake);
        break;
    case CLIENT_FRAME:
        fake_send(fake, FRAME_PING, request, nothing);
        break;
    case RESULT_OF_CONNECTION:
        fake_send_result(fake, 0, 0, 10);
        break;
    case ANSWER_WITHOUT_QUESTION:
        fake_send(fake, FRAME_PONG, 1, nothing);
        break;
    case PROGRESS_OF_NO_ITEM: /* item 2 */
        fake_send(fake, FRAME_PROGRESS, request,
                  (struct bytes){(const unsigned char *)"\x0a\x04\x02\0\0\0\x12\x04\x01\0\0\0", 12});
        break;
    case PROGRESS_BEYOND_THE_END: /* 1001 thousandths */
        fake_send(fake, FRAME_PROGRESS, request,
                  (struct bytes){(const unsigned char *)"\x0a\x04\0\0\0\0\x12\x04\xe9\x03\0\0", 12});
        break;
    default:
        fake_send(fake, FRAME_RESULT, request, (struct bytes){(const unsigned char *)"\xff\xff\xff\xff", 4});
    }
}

static void test_wrong_answers(void **state)
{
    (void)state;
    for (int wrong = 0; wrong < WRONG_COUNT; wrong++) {
        struct client_bed bed;
        struct frame frame;
        bed_start(&bed);
        assert_true(bed_connect(&bed));
        struct bvhd_batch *batch = bed_submit(&bed, 2, 1);
        assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
        send_wrong(&bed, (enum wrong)wrong, frame.header.request);
        double start = bed_now();
        assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
        assert_true(bed_now() - start < BED_LATE_MS);
        assert_true(raw_await_close(&bed.fake.peer, 1000, NULL));
        bvhd_batch_destroy(batch);
        assert_true(bed_connect(&bed)); /* and a good daemon may follow */
        assert_true(bed_stop(&bed));
    }
}

/* Descriptors that cannot be results. */
static int no_memfd(void)
{
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    close(ends[1]);
    return ends[0];
}

static int file_on_disk(void)
{
    char path[] = P_tmpdir "/bvhd-test-XXXXXX";
    int descriptor = mkstemp(path);
    unlink(path);
    assert_int_equal(ftruncate(descriptor, 100000), 0);
    return descriptor;
}

static int memfd_of(uint64_t size, unsigned seals)
{
    unsigned char *bytes = calloc(1, size + 1);
    int descriptor = raw_memfd(bytes, size, seals);
    free(bytes);
    return descriptor;
}

/*
 * Checks what a RESULT states about its size, its inline bytes and its descriptor: an error fails the item, and the
 * connection lives.
 */
static void check_bytes(struct client_bed *bed, uint64_t size, uint64_t inline_size, int descriptor,
                        enum bvhd_status expected)
{
    static const unsigned char bytes[1000];
    struct control_result result = {.size = size};
    uint64_t request;
    struct bvhd_batch *batch = bed_ask(bed, &request);
    fake_send_prepared(&bed->fake, request, 0, 1);
    fake_send_result_with(&bed->fake, request, &result, (struct bytes){bytes, inline_size}, descriptor);
    assert_int_equal(bed_outcome(batch), expected);
    bvhd_batch_destroy(batch);
}

static void test_wrong_bytes(void **state)
{
    (void)state;
    struct client_bed bed;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    check_bytes(&bed, 0, 0, -1, BVHD_CORRUPT);
    check_bytes(&bed, 10, 9, -1, BVHD_CORRUPT);
    check_bytes(&bed, 10, 11, -1, BVHD_CORRUPT);
    check_bytes(&bed, UINT64_MAX, 10, -1, BVHD_CORRUPT);
    check_bytes(&bed, 10, 0, -1, BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, no_memfd(), BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, file_on_disk(), BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, memfd_of(100000, 0), BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, memfd_of(100000, SEALS & ~F_SEAL_SHRINK), BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, memfd_of(100000, SEALS & ~F_SEAL_GROW), BVHD_CORRUPT);
    check_bytes(&bed, 100000, 0, memfd_of(100000, SEALS & ~F_SEAL_WRITE), BVHD_CORRUPT);
    check_bytes(&bed, 100001, 0, memfd_of(100000, SEALS), BVHD_CORRUPT);
    check_bytes(&bed, UINT64_MAX, 0, memfd_of(100000, SEALS), BVHD_CORRUPT);
    check_bytes(&bed, 0, 0, memfd_of(100000, SEALS), BVHD_CORRUPT);
    check_bytes(&bed, 10, 10, memfd_of(100000, SEALS), BVHD_CORRUPT);
    check_bytes(&bed, 99999, 0, memfd_of(100000, SEALS), BVHD_OK);
    check_bytes(&bed, 1, 0, memfd_of(1, SEALS), BVHD_OK);
    assert_true(bed_stop(&bed));
}

/* More descriptors than a result has, descriptors where none belong, and none where one is declared. */
static void test_wrong_descriptors(void **state)
{
    (void)state;
    for (uint32_t sent = 0; sent < 4; sent++)
        for (uint8_t declared = 0; declared < 4; declared++) {
            struct client_bed bed;
            struct control_result result = {.size = 100000};
            uint64_t request;
            int descriptors[4];
            struct bvhd_batch *batch = bed_start_asked(&bed, &request);
            for (int i = 0; i < 4; i++)
                descriptors[i] = memfd_of(100000, SEALS);
            struct raw_frame frame = {
                .header = {.type = FRAME_RESULT, .request = request, .descriptors = declared},
                .descriptors = descriptors,
                .descriptor_count = sent,
            };
            assert_int_equal(control_pack_result(&result, &bed.fake.peer.memory, &frame.control, NULL), BVHD_OK);
            raw_send_frame(&bed.fake.peer, &frame);
            fake_free(&bed.fake, (void *)(uintptr_t)frame.control.data);
            for (int i = 0; i < 4; i++)
                close(descriptors[i]);
            enum bvhd_status expected = sent != declared ? BVHD_UNAVAILABLE : sent == 1 ? BVHD_OK : BVHD_CORRUPT;
            assert_int_equal(bed_outcome(batch), expected);
            bed_end(&bed, batch);
        }
}

/* No descriptor is free when a result comes with one. */
static void test_too_many_files(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    struct rlimit before, few = {64, 0};
    int taken[64], count = 0;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    int result = memfd_of(100000, SEALS);
    struct control_result message = {.size = 100000};
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &before), 0);
    few.rlim_max = before.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
    while ((taken[count] = dup(0)) >= 0)
        count++;
    int again = dup2(result, taken[--count]); /* sending closes it, so the new one must take its place */
    close(result);
    result = dup(0);
    fake_send_result_with(&bed.fake, request, &message, nothing, again);
    taken[count++] = dup(0);
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    assert_non_null(strstr(bed_text(batch), "too many files"));
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &before), 0);
    close(result);
    while (count > 0)
        close(taken[--count]);
    bvhd_batch_destroy(batch);
    assert_true(bed_connect(&bed));
    assert_true(bed_stop(&bed));
}

/* Frames of later versions are ignored, and their descriptors closed. */
static void test_unknown_frames(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    int descriptor = memfd_of(10, 0);
    struct raw_frame frame = {
        .header = {.type = 200, .request = 12345, .descriptors = 1},
        .inline_bytes = {(const unsigned char *)"what is it", 10},
        .descriptors = &descriptor,
        .descriptor_count = 1,
    };
    raw_send_frame(&bed.fake.peer, &frame);
    close(descriptor);
    fake_send(&bed.fake, (enum frame_type)UINT16_MAX, request, nothing);
    fake_send_result(&bed.fake, request, 0, 10);
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bed_end(&bed, batch);
}

/* Statuses of later versions are passed on; a result with PENDING is refused. */
static void test_unknown_status(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    struct bvhd_batch *batch = bed_start_asked(&bed, &request);
    fake_send_failed(&bed.fake, request, 0, (enum bvhd_status)99, "infos[0]");
    assert_int_equal(bed_outcome(batch), 99);
    bed_end(&bed, batch);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_versions),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_hangs_up_at_each_byte),
        cmocka_unit_test(test_hangs_up_early),
        cmocka_unit_test(test_wrong_answers),
        cmocka_unit_test(test_wrong_bytes),
        cmocka_unit_test(test_wrong_descriptors),
        cmocka_unit_test(test_too_many_files),
        cmocka_unit_test(test_unknown_frames),
        cmocka_unit_test(test_unknown_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

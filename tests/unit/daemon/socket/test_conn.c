/* SPDX-License-Identifier: Apache-2.0 */
/* test_conn.c - tests the life of a connection: HELLO, frames, broken protocols, failures, and every way to end. */
#include <errno.h>

#include "tests/support/unit.h"

#include "tests/support/daemon/capture_log.h"
#include "tests/support/daemon/conn_bed.h"

static void test_hello_ping_end(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1000);
    assert_int_equal(bed.service.connections, 1);
    for (uint64_t i = 1; i <= 100; i++) {
        assert_true(bed_send(client, FRAME_PING, i));
        bed_expect(&bed, client, FRAME_PONG, i);
    }
    assert_int_equal(bed.service.sent, 101);
    bed_hang_up(client);
    bed_await(&bed, bed.service.closed == 1);
    bed_close(&bed);
}

static void test_byte_by_byte(void **state)
{
    struct bed bed;
    unsigned char bytes[FRAME_HEADER_SIZE];
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_connect(&bed, 1000);
    frame_header_write(&(struct frame_header){.type = FRAME_HELLO}, bytes);
    for (size_t i = 0; i < sizeof bytes; i++) {
        assert_true(bed_send_bytes(client, bytes + i, 1, NULL, 0));
        bed_await(&bed, bed_newest_conn(&bed)->inlet.parser.fed == i + 1);
        assert_int_equal(bed.service.frames, i + 1 == sizeof bytes);
    }
    bed_expect(&bed, client, FRAME_WELCOME, 0);
    bed_close(&bed);
}

static void test_broken_protocol(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *wrong = bed_connect(&bed, 1), *corrupt = bed_connect(&bed, 2), *failing = bed_connect(&bed, 3),
                      *good = bed_connect(&bed, 4);
    bed_hello(&bed, wrong);
    bed_hello(&bed, good);
    bed_hello(&bed, failing);
    bed_send(wrong, FRAME_PING, 1);
    bed_send(wrong, FAKE_WRONG, 2);
    bed_send(wrong, FRAME_PING, 3); /* comes too late */
    bed_expect(&bed, wrong, FRAME_PONG, 1);
    bed_expect_error(&bed, wrong, BVHD_INVALID);
    static const char web[] = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
    bed_send_bytes(corrupt, web, sizeof web - 1, NULL, 0);
    bed_expect_error(&bed, corrupt, BVHD_CORRUPT);
    bed_send(failing, FAKE_FAIL, 1);
    bed_expect_error(&bed, failing, BVHD_NO_MEMORY);
    assert_int_equal(bed.service.closed, 3);
    assert_int_equal(bed.service.broken,
                     1); /* `corrupt`: the session counts what breaks the protocol in whole frames */
    bed_send(good, FRAME_PING, 9);
    bed_expect(&bed, good, FRAME_PONG, 9);
    bed_close(&bed);
}

/* A session goes on when a reply has been written, and fails: the client gets the error at once. */
static void test_fails_while_sending(void **state)
{
    (void)state;
    struct bed bed;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    bed_send(client, FAKE_FAIL_SENT, 1);
    bed_expect(&bed, client, FRAME_PONG, 1);
    bed_expect_error(&bed, client, BVHD_NO_MEMORY);
    bed_close(&bed);
}

/* After a client has broken the protocol, its bytes are read and discarded, so that it can still receive the error. */
static void test_broken_while_sending(void **state)
{
    struct bed bed;
    static char much[64 * 1024];
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    bed_send(client, FAKE_WRONG, 1);
    for (int i = 0; i < 50; i++) {
        while (send(client->socket, much, sizeof much, MSG_NOSIGNAL) > 0)
            continue;
        assert_int_equal(errno, EAGAIN);
        bed_pump(&bed, 0);
    }
    bed_expect_error(&bed, client, BVHD_INVALID);
    bed_close(&bed);
}

static void test_linger_ends(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.linger_ms = 200;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_connect(&bed, 1);
    uint64_t begin = bed_now();
    bed_send(client, FAKE_WRONG, 1);
    bed_await(&bed, bed.service.closed == 1);
    assert_int_equal(bed.group.count, 1);
    bed_await(&bed, bed.group.count == 0);
    assert_true(bed_now() - begin >= limits.linger_ms);
    bed_close(&bed);
}

static void test_no_hello(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.hello_ms = 50;
    bed_open(&bed, &limits);
    uint64_t begin = bed_now();
    struct bed_client *silent = bed_connect(&bed, 1), *talking = bed_connect(&bed, 1);
    bed_hello(&bed, talking);
    bed_expect_error(&bed, silent, BVHD_INVALID);
    assert_true(bed_now() - begin >= limits.hello_ms);
    bed_send(talking, FRAME_PING, 1);
    bed_expect(&bed, talking, FRAME_PONG, 1);
    bed_close(&bed);
}

static void test_large_frame_before_hello(void **state)
{
    struct bed bed;
    unsigned char bytes[FRAME_HEADER_SIZE];
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *early = bed_connect(&bed, 1), *later = bed_connect(&bed, 1);
    frame_header_write(&(struct frame_header){.type = FRAME_BUILD, .request = 1, .control_size = FRAME_MAX_CONTROL},
                       bytes);
    bed_send_bytes(early, bytes, sizeof bytes, NULL, 0);
    bed_expect_error(&bed, early, BVHD_TOO_LARGE);
    bed_hello(&bed, later);
    bed_send_bytes(later, bytes, sizeof bytes, NULL, 0);
    bed_pump(&bed, 0);
    assert_int_equal(bed.service.closed, 1);
    bed_close(&bed);
}

static void test_half_close(void **state)
{
    struct bed bed;
    struct frame frame;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    shutdown(client->socket, SHUT_WR);
    bed_await(&bed, bed.service.closed == 1);
    assert_int_equal(bed.group.count, 0);
    assert_false(bed_receive(&bed, client, &frame));
    bed_close(&bed);
}

/* A client dies after any number of bytes of a frame with descriptors; no descriptor may leak. */
static void test_death_with_descriptors(void **state)
{
    struct bed bed;
    unsigned char bytes[FRAME_HEADER_SIZE];
    (void)state;
    bed_open(&bed, NULL);
    frame_header_write(&(struct frame_header){.type = FRAME_POOL, .request = 1, .descriptors = 2}, bytes);
    for (size_t size = 1; size <= sizeof bytes; size++) {
        struct bed_client *client = bed_connect(&bed, 1);
        int descriptors[2] = {frames_descriptor(NULL), frames_descriptor(NULL)};
        bed_hello(&bed, client);
        bed_send_bytes(client, bytes, size, descriptors, 2);
        close(descriptors[0]);
        close(descriptors[1]);
        if (size % 2)
            bed_pump(&bed, 0);
        bed_hang_up(client);
        bed_await(&bed, bed.service.descriptors.used == 0);
    }
    bed_close(&bed);
}

static void send_many_descriptors(struct bed_client *client, uint32_t count)
{
    unsigned char bytes[FRAME_HEADER_SIZE];
    int descriptors[64];
    frame_header_write(&(struct frame_header){.type = FRAME_POOL, .request = 1, .descriptors = 4}, bytes);
    for (uint32_t i = 0; i < count; i++)
        descriptors[i] = frames_descriptor(NULL);
    bed_send_bytes(client, bytes, sizeof bytes, descriptors, count);
    for (uint32_t i = 0; i < count; i++)
        close(descriptors[i]);
}

static void test_too_many_descriptors(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    for (uint32_t count = INLET_DESCRIPTORS + 1; count <= 64; count += 15) {
        struct bed_client *client = bed_join(&bed, 1);
        send_many_descriptors(client, count);
        bed_expect_error(&bed, client, BVHD_TOO_LARGE);
        bed_hang_up(client);
        bed_await(&bed, bed.service.descriptors.used == 0);
    }
    struct bed_client *client = bed_join(&bed, 1);
    send_many_descriptors(client, 4);
    bed_send(client, FRAME_PING, 5);
    bed_expect(&bed, client, FRAME_PONG, 5);
    bed_close(&bed);
}

static void test_goodbye(void **state)
{
    struct bed bed;
    struct frame frame;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *open = bed_connect(&bed, 1), *silent = bed_connect(&bed, 1);
    bed_hello(&bed, open);
    conn_group_goodbye(&bed.group);
    assert_false(conn_group_is_flushed(&bed.group));
    bed_await(&bed, conn_group_is_flushed(&bed.group));
    bed_expect(&bed, open, FRAME_GOODBYE, 0);
    assert_false(bed_receive(&bed, silent, &frame));
    assert_true(silent->eof);
    bed_send(open, FRAME_PING, 1);
    bed_expect(&bed, open, FRAME_PONG, 1);
    bed_close(&bed);
}

static void test_refused_session(void **state)
{
    struct bed bed;
    int pair[2];
    char byte;
    (void)state;
    bed_open(&bed, NULL);
    bed.service.refuse = true;
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair), 0);
    assert_true(descriptors_take(&bed.service.descriptors, 1, 0));
    const struct session_peer peer = {.share = descriptor_share_open(&bed.service.descriptors, 0)};
    descriptor_share_add(peer.share, 1);
    assert_int_equal(conn_open(&bed.group, pair[0], &peer, NULL), BVHD_NO_MEMORY);
    assert_int_equal(peer.share->used, 0);
    assert_int_equal(peer.share->holders, 0);
    assert_int_equal(bed.service.descriptors.used, 0);
    assert_int_equal(poll(&(struct pollfd){.fd = pair[1], .events = POLLIN}, 1, 2000), 1);
    assert_int_equal(recv(pair[1], &byte, 1, 0), 0);
    close(pair[1]);
    bed_close(&bed);
}

/* Each allocation of a connection fails once: the client gets its reply or an error, or its connection is closed. */
static void test_failing_allocations(void **state)
{
    (void)state;
    bool through = false;
    for (int64_t i = 0; !through && i < 100; i++) {
        struct bed bed;
        struct frame frame;
        struct conn_limits limits = conn_limits_default();
        limits.linger_ms = 20;
        bed_open(&bed, &limits);
        struct bed_client *client = bed_connect(&bed, 1);
        bed.service.memory.fail_after = i;
        bed_send(client, FAKE_WRONG, 1);
        while (bed_receive(&bed, client, &frame))
            continue;
        assert_true(client->eof);
        through = bed.service.memory.fail_after >= 0;
        bed.service.memory.fail_after = -1;
        bed_close(&bed);
    }
    assert_true(through);
}

/* A large frame counts while it is incomplete. Without room for it, it waits, and is not late; small frames do not. */
static void test_unfinished_frame_counts(void **state)
{
    enum { CONTROL = 200000, FIRST = 20000, PART = 4000 }; /* the first part is more than one read takes */
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    static unsigned char bytes[FRAME_HEADER_SIZE + CONTROL];
    (void)state;
    limits.stall_ms = 50;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_connect(&bed, 1);
    const struct frame_parser *parser = &bed_newest_conn(&bed)->inlet.parser;
    struct bed_client *other = bed_connect(&bed, 1);
    bed_hello(&bed, client);
    bed_hello(&bed, other);
    uint64_t fed = parser->fed;
    frame_header_write(&(struct frame_header){.type = FRAME_PING, .control_size = CONTROL, .request = 1}, bytes);
    bed.service.has_no_frames = true;
    assert_true(bed_send_bytes(client, bytes, FIRST, NULL, 0));
    bed_send(other, FRAME_PING, 2);
    bed_expect(&bed, other, FRAME_PONG, 2);
    bed_pump(&bed, 100);
    assert_int_equal(bed.service.closed, 0);
    assert_in_range(bed.service.frame_bytes, 0, 2 * FRAME_KEEP);
    bed.service.has_no_frames = false;
    bed.group.limits.stall_ms = 30000;
    bed_await(&bed, bed.service.frame_bytes >= sizeof bytes);
    for (size_t at = FIRST; at < sizeof bytes; at += PART) {
        size_t left = sizeof bytes - at, size = left < PART ? left : PART;
        assert_true(bed.service.frame_bytes >= sizeof bytes);
        assert_true(bed_send_bytes(client, bytes + at, size, NULL, 0));
        bed_await(&bed, parser->fed == fed + at + size);
    }
    bed_expect(&bed, client, FRAME_PONG, 1);
    assert_in_range(bed.service.frame_bytes, 0, 2 * FRAME_KEEP);
    bed_close(&bed);
}

/* The end of a connection frees what was set aside for its unfinished frame, even while it has an error to read. */
static void test_unfinished_frame_of_the_broken(void **state)
{
    struct bed bed;
    unsigned char bytes[FRAME_HEADER_SIZE];
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    frame_header_write(&(struct frame_header){.type = FRAME_PING, .control_size = 100000, .request = 1}, bytes);
    assert_true(bed_send_bytes(client, bytes, FRAME_HEADER_SIZE, NULL, 0));
    bed_pump(&bed, 0);
    assert_true(bed_send_bytes(client, bytes, 1, NULL, 0));
    bed_await(&bed, bed.service.frame_bytes > 100000 && bed.service.memory.live > 100000);
    int descriptor = frames_descriptor(NULL);
    assert_true(bed_send_bytes(client, bytes, 1, &descriptor, 1)); /* the frame has declared none */
    close(descriptor);
    bed_await(&bed, bed.service.closed == 1);
    assert_int_equal(bed.service.frame_bytes, 0);
    assert_true(bed.service.memory.live < 1000);
    bed_expect_error(&bed, client, BVHD_CORRUPT);
    bed_close(&bed);
}

/* A client begins a frame and does not go on with it, until it is dropped. */
static void stall(struct bed *bed)
{
    uint32_t closed = bed->service.closed;
    struct bed_client *client = bed_connect(bed, 1);
    bed_hello(bed, client);
    assert_true(bed_send_bytes(client, "BVHD", 4, NULL, 0));
    bed_await(bed, bed->service.closed == closed + 1);
    bed_hang_up(client);
}

/* Clients that are dropped within a second have one line in the log, and the next line counts the others. */
static void test_few_lines_for_stalled_clients(void **state)
{
    static char text[CAPTURE_SIZE];
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    struct capture capture = capture_begin();
    (void)state;
    limits.stall_ms = 1;
    bed_open(&bed, &limits);
    stall(&bed);
    bed.group.stalled_log.next_ms = UINT64_MAX; /* as if the second did not end */
    for (int i = 0; i < 30; i++)
        stall(&bed);
    bed.group.stalled_log.next_ms = 0;
    stall(&bed);
    bed_close(&bed);
    capture_end(&capture, text);
    char *first = strstr(text, "event=client_stalled"), *second = first ? strstr(first + 1, "event=client_stalled") : 0;
    assert_non_null(second);
    assert_null(strstr(second + 1, "event=client_stalled"));
    assert_true(strstr(first, " suppressed=0\n") < second);
    assert_non_null(strstr(second, " suppressed=30\n"));
}

enum { RESULTS = 20, SMALL = 64 * 1024 };

/* A client whose socket has a small send buffer. */
struct reader {
    struct bed_client *client;
    const struct conn *conn;
    int small; /* the buffer's size, as the kernel counts it */
};

static struct reader join_reader(struct bed *bed)
{
    const int size = SMALL;
    struct reader reader = {.client = bed_join(bed, 1)};
    reader.conn = bed_newest_conn(bed); /* not in the initializer, whose parts have no order */
    assert_int_equal(setsockopt(reader.conn->socket, SOL_SOCKET, SO_SNDBUF, &size, sizeof size), 0);
    reader.small = bed_send_buffer(reader.conn);
    return reader;
}

static void read_results(struct bed *bed, const struct reader *reader)
{
    struct frame frame;
    for (uint64_t i = 1; i <= RESULTS; i++) {
        assert_true(bed_receive(bed, reader->client, &frame));
        assert_int_equal(frame.header.request, i);
    }
}

static void ask_for_results(const struct reader *reader)
{
    for (uint64_t i = 1; i <= RESULTS; i++)
        bed_send(reader->client, FRAME_STATS, i);
}

/* Only clients that have read much get a larger send buffer, and only some of them at a time. */
static void test_some_readers_get_a_larger_buffer(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.large_from = RESULTS * BLOB_INLINE_MAX;
    limits.large_most = 1;
    bed_open(&bed, &limits);
    const struct reader first = join_reader(&bed), second = join_reader(&bed);
    ask_for_results(&first);
    bed_pump(&bed, 20);
    assert_int_equal(bed_send_buffer(first.conn), first.small);
    read_results(&bed, &first);
    assert_true(bed_send_buffer(first.conn) > first.small);
    ask_for_results(&second);
    read_results(&bed, &second);
    assert_int_equal(bed_send_buffer(second.conn), second.small);
    bed_hang_up(first.client);
    bed_await(&bed, bed.group.count == 1);
    ask_for_results(&second);
    read_results(&bed, &second);
    assert_true(bed_send_buffer(second.conn) > second.small);
    bed_close(&bed);
}

/* A client gets a larger send buffer once it has read the descriptors that it owes; until then the buffer is small. */
static void test_larger_buffer_after_descriptors(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    const struct conn *conn = bed_newest_conn(&bed);
    const int before = bed_send_buffer(conn);
    bed.group.limits.large_from = (uint32_t)conn->outbox.sent + 1;
    bed_send(client, FRAME_GET, 50);
    bed_await(&bed, conn->is_large);
    bed_pump(&bed, 20);
    assert_true(bed_send_buffer(conn) < before);
    assert_false(conn->hint_failed);
    for (uint64_t i = 1; i <= 50; i++)
        bed_expect(&bed, client, FRAME_RESULT, i);
    bed_await(&bed, bed_send_buffer(conn) > before);
    bed_close(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_hello_ping_end),
        cmocka_unit_test(test_byte_by_byte),
        cmocka_unit_test(test_broken_protocol),
        cmocka_unit_test(test_broken_while_sending),
        cmocka_unit_test(test_linger_ends),
        cmocka_unit_test(test_no_hello),
        cmocka_unit_test(test_large_frame_before_hello),
        cmocka_unit_test(test_half_close),
        cmocka_unit_test(test_death_with_descriptors),
        cmocka_unit_test(test_too_many_descriptors),
        cmocka_unit_test(test_goodbye),
        cmocka_unit_test(test_refused_session),
        cmocka_unit_test(test_failing_allocations),
        cmocka_unit_test(test_fails_while_sending),
        cmocka_unit_test(test_unfinished_frame_counts),
        cmocka_unit_test(test_unfinished_frame_of_the_broken),
        cmocka_unit_test(test_some_readers_get_a_larger_buffer),
        cmocka_unit_test(test_larger_buffer_after_descriptors),
        cmocka_unit_test(test_few_lines_for_stalled_clients),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

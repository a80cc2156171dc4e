/* SPDX-License-Identifier: Apache-2.0 */
/* test_conn_limits.c - tests clients that do not read, or send slowly or too much, and shortages of the daemon. */
#include <errno.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "tests/support/unit.h"

#include "tests/support/daemon/conn_bed.h"

static void use_up_descriptors(struct bed *bed, uint32_t left)
{
    struct descriptors *descriptors = &bed->service.descriptors;
    /* Other threads may still be about to uncount descriptors that they have closed. */
    bed_await(bed, descriptors_left(descriptors) == descriptors->limit - descriptors->used);
    assert_true(descriptors_take(descriptors, descriptors_left(descriptors) - left, 0));
}

static void test_descriptors_in_order(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    int before = bed_send_buffer(bed_newest_conn(&bed));
    bed_send(client, FRAME_GET, 50);
    bed_await(&bed, bed.service.sent >= 1 + OUTBOX_MAX_UNREAD);
    bed_pump(&bed, 5);
    assert_int_equal(bed.service.sent, 1 + OUTBOX_MAX_UNREAD);
    assert_int_equal(bed.service.descriptors.unread, OUTBOX_MAX_UNREAD);
    for (uint64_t i = 1; i <= 50; i++) {
        struct frame frame;
        struct stat about;
        unsigned char byte = 0;
        assert_true(bed_receive(&bed, client, &frame));
        assert_int_equal(frame.header.request, i);
        assert_int_equal(frame.header.descriptors, 1);
        assert_int_equal(fstat(frame.descriptors[0], &about), 0);
        assert_int_equal(about.st_size, 2 * BLOB_INLINE_MAX);
        assert_int_equal(pread(frame.descriptors[0], &byte, 1, 1001), 1);
        assert_int_equal(byte, (unsigned char)(1001 * 7));
        close(frame.descriptors[0]);
    }
    /* The kernel has no event for what a client has read. */
    bed_await(&bed, bed.service.read_bytes >= 50 * 2 * BLOB_INLINE_MAX);
    assert_int_equal(bed.service.read_bytes, 50 * 2 * BLOB_INLINE_MAX);
    assert_int_equal(bed_send_buffer(bed_newest_conn(&bed)), before);
    bed_close(&bed);
}

/* A stalled client loses its session, but counts as a connection until it has read or closed its descriptors. */
static void test_stalled_with_descriptors(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 200;
    limits.held_ms = 50;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_connect(&bed, 1), *other = bed_connect(&bed, 1);
    bed_hello(&bed, client);
    bed_hello(&bed, other);
    uint64_t begin = bed_now();
    bed_send(client, FRAME_GET, 10);
    bed_await(&bed, bed.service.closed > 0);
    assert_true(bed_now() - begin >= limits.stall_ms);
    assert_int_equal(bed.service.closed, 1);
    assert_int_equal(bed.service.sent, 2 + OUTBOX_MAX_UNREAD);
    assert_int_equal(bed.group.count, 2);
    assert_int_equal(bed.service.descriptors.unread, OUTBOX_MAX_UNREAD);
    bed_send(other, FRAME_PING, 1);
    bed_expect(&bed, other, FRAME_PONG, 1);
    bed_hang_up(client);
    bed_await(&bed, bed.group.count < 2);
    assert_int_equal(bed.group.count, 1);
    assert_int_equal(bed.service.descriptors.unread, 0);
    bed_close(&bed);
}

/*
 * A client that leaves results unread, all of which were sent, may take its time, unless others of its user wait for
 * the memory.
 */
static void test_unread_results_that_others_wait_for(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 200;
    limits.held_ms = 20;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    bed_send(client, FRAME_GET, 2);
    bed_await(&bed, bed.service.sent == 1 + 2);
    bed_pump(&bed, 300);
    assert_int_equal(bed.service.closed, 0);
    assert_int_equal(bed.service.read_bytes, 0);
    bed.service.is_behind = true;
    bed_await(&bed, bed.service.closed == 1);
    bed_hang_up(client);
    bed_await(&bed, bed.service.descriptors.unread == 0);
    bed_close(&bed);
}

/* A client is not read from while its replies exceed its user's share, until it has read them. */
static void test_a_talkative_client_has_to_read(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    bed_send(client, FRAME_GET, 10); /* more than may be unread */
    bed_await(&bed, bed.service.sent == 1 + OUTBOX_MAX_UNREAD);
    bed.service.is_talkative = true;
    uint32_t frames = bed.service.frames;
    bed_send(client, FRAME_PING, 100);
    bed_pump(&bed, 50);
    assert_int_equal(bed.service.frames, frames);
    for (uint64_t i = 1; i <= 10; i++)
        bed_expect(&bed, client, FRAME_RESULT, i);
    bed_expect(&bed, client, FRAME_PONG, 100);
    bed_close(&bed);
}

/* Replies with and without descriptors alternate; a client that reads one at a time gets them in order. */
static void test_reads_one_at_a_time(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    for (uint64_t i = 0; i < 20; i++) {
        bed_send(client, FRAME_GET, 1);
        bed_send(client, FRAME_PING, 1000 + i);
        bed_send(client, FRAME_STATS, 2000 + i);
    }
    bed_await(&bed, bed.service.descriptors.unread >= OUTBOX_MAX_UNREAD);
    bed_pump(&bed, 20);
    assert_int_equal(bed.service.descriptors.unread, OUTBOX_MAX_UNREAD);
    for (uint64_t i = 0; i < 20; i++) {
        bed_expect(&bed, client, FRAME_RESULT, 1);
        bed_expect(&bed, client, FRAME_PONG, 1000 + i);
        bed_expect(&bed, client, FRAME_RESULT, 2000 + i);
    }
    bed_close(&bed);
}

static void count_iteration(void *context)
{
    ++*(int *)context;
}

/* The loop does not spin, however many of its descriptors a client leaves unread. */
static void test_waiting_is_quiet(void **state)
{
    (void)state;
    for (int read = 0; read <= OUTBOX_MAX_UNREAD; read++) {
        struct bed bed;
        int iterations = 0;
        bed_open(&bed, NULL);
        struct bed_client *client = bed_join(&bed, 1);
        bed_send(client, FRAME_GET, 20);
        bed_await(&bed, bed.service.sent == 1 + OUTBOX_MAX_UNREAD);
        for (int i = 0; i < read; i++)
            bed_expect(&bed, client, FRAME_RESULT, (uint64_t)i + 1);
        bed.group.changed = count_iteration;
        bed.group.context = &iterations;
        uint64_t end = bed_now() + 150;
        do
            uv_run(&bed.loop, UV_RUN_ONCE);
        while (bed_now() < end);
        assert_in_range(iterations, 1, 30);
        bed_close(&bed);
    }
}

/*
 * All clients together have at most half of the limit unread, and those of one user as many as are left for others: of
 * seven, the first user gets four, and the second one two of the other three. Further replies wait until some are read.
 */
static void test_descriptors_of_all(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    atomic_store(&bed.service.descriptors.unread, bed.service.descriptors.limit / 2 - 7);
    struct bed_client *first = bed_connect(&bed, 1), *second = bed_connect(&bed, 2);
    bed_hello(&bed, first);
    bed_hello(&bed, second);
    bed_send(first, FRAME_GET, 5);
    bed_await(&bed, bed.service.sent >= 2 + 4);
    bed_send(second, FRAME_GET, 5);
    bed_await(&bed, bed.service.sent >= 2 + 6);
    bed_pump(&bed, 2);
    assert_int_equal(bed.service.sent, 2 + 6);
    for (uint64_t i = 1; i <= 5; i++)
        bed_expect(&bed, first, FRAME_RESULT, i);
    for (uint64_t i = 1; i <= 5; i++)
        bed_expect(&bed, second, FRAME_RESULT, i);
    bed_hang_up(first);
    bed_hang_up(second);
    bed_await(&bed, bed.group.count == 0);
    assert_int_equal(bed.service.descriptors.unread, bed.service.descriptors.limit / 2 - 7);
    atomic_store(&bed.service.descriptors.unread, 0);
    bed_close(&bed);
}

/* A client sends requests and never reads: after a while no more requests are read from it, then it is dropped. */
static void test_asks_and_never_reads(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 200;
    limits.queue_bytes = 1 << 20;
    limits.share_us = UINT32_MAX;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    uint64_t begin = bed_now();
    for (int i = 0; i < 200; i++)
        bed_send(client, FRAME_STATS, 1);
    bed_await(&bed, bed.service.closed == 1);
    assert_true(bed_now() - begin >= limits.stall_ms);
    assert_in_range(bed.service.frames, 17, 30);
    assert_int_equal(bed.group.count, 0);
    bed_close(&bed);
}

/* A client with as many requests reads slowly: every reply arrives, and the client is not dropped. */
static void test_reads_slowly(void **state)
{
    struct bed bed;
    struct frame frame;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 1000; /* shorter than all the pauses together, and long compared with each */
    limits.queue_bytes = 1 << 20;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    for (uint64_t i = 1; i <= 60; i++)
        bed_send(client, FRAME_STATS, i);
    for (uint64_t i = 1; i <= 60; i++) {
        bed_pump(&bed, 20);
        assert_true(bed_receive(&bed, client, &frame));
        assert_int_equal(frame.header.request, i);
        assert_int_equal(frame.inline_bytes.size, BLOB_INLINE_MAX);
        for (uint64_t at = 0; at < frame.inline_bytes.size; at++)
            if (frame.inline_bytes.data[at] != (unsigned char)(at * 7))
                fail_msg("byte %llu is another", (unsigned long long)at);
    }
    bed_close(&bed);
}

/* A client that stops in the middle of a frame is dropped; one that sends it slowly, or sends nothing, is not. */
static void test_unfinished_frame(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    unsigned char bytes[FRAME_HEADER_SIZE + 20] = {0};
    (void)state;
    limits.stall_ms = 800; /* shorter than all the pauses together, and long compared with each */
    bed_open(&bed, &limits);
    struct bed_client *stopped = bed_connect(&bed, 1), *slow = bed_connect(&bed, 1), *idle = bed_connect(&bed, 1);
    bed_hello(&bed, stopped);
    bed_hello(&bed, slow);
    bed_hello(&bed, idle);
    frame_header_write(&(struct frame_header){.type = FRAME_PING, .request = 1, .control_size = 20}, bytes);
    bed_send_bytes(stopped, bytes, 10, NULL, 0);
    for (size_t i = 0; i < sizeof bytes; i++) {
        bed_send_bytes(slow, bytes + i, 1, NULL, 0);
        bed_pump(&bed, 20);
    }
    bed_expect(&bed, slow, FRAME_PONG, 1);
    bed_await(&bed, bed.service.closed >= 1);
    bed_pump(&bed, 40);
    assert_int_equal(bed.service.closed, 1);
    assert_int_equal(bed.group.count, 2);
    bed_close(&bed);
}

/* A client that sends a frame a byte at a time, for too long, is dropped although it makes progress. */
static void test_frame_that_trickles(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    unsigned char bytes[FRAME_HEADER_SIZE + 1000] = {0};
    (void)state;
    limits.frame_ms = 200;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    frame_header_write(&(struct frame_header){.type = FRAME_PING, .request = 1, .control_size = 1000}, bytes);
    size_t sent = 0;
    for (; sent < sizeof bytes && bed.service.closed == 0; sent++) {
        bed_send_bytes(client, bytes + sent, 1, NULL, 0);
        bed_pump(&bed, 2);
    }
    assert_int_equal(bed.service.closed, 1);
    assert_in_range(sent, 1, sizeof bytes - 1);
    bed_close(&bed);
}

/* A client that reads at once is not dropped for having to wait until others have read. */
static void test_waits_for_others(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 50;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    atomic_store(&bed.service.descriptors.unread, bed.service.descriptors.limit / 2);
    bed_send(client, FRAME_GET, 1);
    bed_await(&bed, bed_newest_conn(&bed)->writing == OUTBOX_WAITING);
    bed_pump(&bed, 150);
    assert_int_equal(bed.service.closed, 0);
    atomic_store(&bed.service.descriptors.unread, 0);
    bed_expect(&bed, client, FRAME_RESULT, 1);
    bed_close(&bed);
}

/* A client that floods the daemon gets its share of each iteration only, and all its frames are handled in the end. */
static void test_share_of_frames(void **state)
{
    struct bed bed;
    struct frame frame;
    struct conn_limits limits = conn_limits_default();
    unsigned char bytes[200 * FRAME_HEADER_SIZE];
    (void)state;
    limits.share_frames = 4;
    limits.share_us = UINT32_MAX;
    bed_open(&bed, &limits);
    struct bed_client *flood = bed_connect(&bed, 1);
    struct conn *flooded = bed_newest_conn(&bed);
    struct bed_client *other = bed_connect(&bed, 1);
    bed_hello(&bed, flood);
    bed_hello(&bed, other);
    flooded->cost_ns = bed_newest_conn(&bed)->cost_ns = 0; /* as if nothing had interrupted their HELLO */
    uint32_t before = bed.service.frames;
    for (uint64_t i = 0; i < 200; i++)
        frame_header_write(&(struct frame_header){.type = FRAME_PING, .request = i + 1}, bytes + i * FRAME_HEADER_SIZE);
    bed_send_bytes(flood, bytes, sizeof bytes, NULL, 0);
    bed_send(other, FRAME_PING, 1);
    uv_run(&bed.loop, UV_RUN_NOWAIT);
    uv_run(&bed.loop, UV_RUN_NOWAIT);
    assert_in_range(bed.service.frames - before, 5, 9);
    bed_read(other);
    bool found;
    assert_int_equal(frame_parser_next(&other->parser, &frame, &found, NULL), BVHD_OK);
    assert_true(found);
    for (uint64_t i = 1; i <= 200; i++)
        bed_expect(&bed, flood, FRAME_PONG, i);
    bed_close(&bed);
}

/* Frames that take long are handled one in each iteration. The first iteration only notices them. */
static void test_share_of_time(void **state)
{
    struct bed bed;
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.share_us = 1;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    for (uint64_t i = 1; i <= 10; i++)
        bed_send(client, FAKE_COSTLY, i);
    uint32_t before = bed.service.frames;
    for (uint32_t handled = 0, iterations = 0; handled < 3;) {
        uint64_t begin = uv_hrtime();
        uv_run(&bed.loop, UV_RUN_NOWAIT);
        assert_in_range(bed.service.frames - before, handled, handled + 1);
        /* An iteration that is interrupted for the whole share of the costly ones serves none of them. */
        bool is_interrupted = bed.service.frames - before == handled && uv_hrtime() - begin > 1000 * 1000;
        handled = bed.service.frames - before;
        iterations += !is_interrupted;
        assert_in_range(handled, iterations ? iterations - 1 : 0, 3);
    }
    for (uint64_t i = 1; i <= 10; i++)
        bed_expect(&bed, client, FRAME_PONG, i);
    bed_close(&bed);
}

/* Costly connections wait for one another, and no other connection waits for all of them. */
static void test_costly_ones_come_last(void **state)
{
    struct bed bed;
    struct bed_client *clients[BED_CLIENTS];
    struct frame frame;
    bool found;
    (void)state;
    bed_open(&bed, NULL);
    for (int i = 0; i < BED_CLIENTS; i++) {
        clients[i] = bed_connect(&bed, 1);
        bed_hello(&bed, clients[i]);
    }
    for (int i = 0; i < BED_CLIENTS - 1; i++) {
        bed_send(clients[i], FAKE_COSTLY, 1);
        bed_expect(&bed, clients[i], FRAME_PONG, 1);
    }
    uint32_t before = bed.service.frames;
    bed_newest_conn(&bed)->cost_ns = 0; /* as if nothing had interrupted the HELLO of the last client */
    for (int i = 0; i < BED_CLIENTS - 1; i++)
        bed_send(clients[i], FAKE_COSTLY, 2);
    bed_send(clients[BED_CLIENTS - 1], FRAME_PING, 2);
    /* An iteration that is interrupted for the whole share of the costly ones serves none of them. */
    while (bed.service.frames - before < 2)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    assert_int_equal(bed.service.frames - before, 2);
    bed_read(clients[BED_CLIENTS - 1]);
    assert_int_equal(frame_parser_next(&clients[BED_CLIENTS - 1]->parser, &frame, &found, NULL), BVHD_OK);
    assert_true(found);
    bed_hang_up(clients[1]); /* while it is still in the list of costly ones */
    bed_expect(&bed, clients[0], FRAME_PONG, 2);
    bed_expect(&bed, clients[2], FRAME_PONG, 2);
    bed_close(&bed);
}

/* Sends more unread descriptors of this user than the kernel will allow. Returns the sending socket. */
static int use_up_unread(int *ret_reader)
{
    enum { SENT = 64 };
    int pair[2], same[SENT];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    for (int i = 0; i < SENT; i++)
        same[i] = pair[0];
    struct bed_client sender = {.socket = pair[0]};
    assert_true(bed_send_bytes(&sender, "", 1, same, SENT));
    *ret_reader = pair[1];
    return pair[0];
}

/* Runs in a child process, which gives up its privileges, because the kernel has no such limit for root. */
static void refused_by_the_kernel(void)
{
    struct bed bed;
    struct rlimit limit;
    char byte;
    int reader;
    if (geteuid() == 0)
        assert_int_equal(setresuid(64321, 64321, 64321), 0);
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    int sender = use_up_unread(&reader);
    getrlimit(RLIMIT_NOFILE, &limit);
    setrlimit(RLIMIT_NOFILE, &(struct rlimit){.rlim_cur = 60, .rlim_max = limit.rlim_max});
    bed_send(client, FRAME_GET, 2);
    bed_await(&bed, bed_newest_conn(&bed)->writing == OUTBOX_WAITING);
    bed_pump(&bed, 30);
    assert_int_equal(bed.service.sent, 1);
    assert_int_equal(bed.service.descriptors.unread, 0);
    assert_int_equal(bed_newest_conn(&bed)->writing, OUTBOX_WAITING);
    assert_int_equal(recv(reader, &byte, 1, 0), 1); /* there is no room for descriptors, so the kernel drops them */
    bed_expect(&bed, client, FRAME_RESULT, 1);
    bed_expect(&bed, client, FRAME_RESULT, 2);
    close(sender);
    close(reader);
    bed_close(&bed);
}

static void test_refused_by_the_kernel(void **state)
{
    int status;
    (void)state;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        refused_by_the_kernel();
        _exit(0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

/* While the daemon has too few descriptors to receive any, nothing is read from clients. */
static void test_short_of_descriptors(void **state)
{
    struct bed bed;
    unsigned char bytes[FRAME_HEADER_SIZE];
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    use_up_descriptors(&bed, DESCRIPTORS_RESERVE + 1 + INLET_DESCRIPTORS - 1); /* the user holds one: its socket */
    uint32_t used = bed.service.descriptors.used, frames = bed.service.frames;
    int descriptors[4] = {frames_descriptor(NULL), frames_descriptor(NULL), frames_descriptor(NULL),
                          frames_descriptor(NULL)};
    frame_header_write(&(struct frame_header){.type = FRAME_POOL, .request = 1, .descriptors = 4}, bytes);
    bed_send_bytes(client, bytes, sizeof bytes, descriptors, 4);
    bed_send(client, FRAME_PING, 2);
    bed_pump(&bed, 60);
    assert_int_equal(bed.service.frames, frames);
    assert_int_equal(bed.service.descriptors.used, used);
    descriptors_give(&bed.service.descriptors, 1);
    bed_expect(&bed, client, FRAME_PONG, 2);
    for (int i = 0; i < 4; i++)
        close(descriptors[i]);
    use_up_descriptors(&bed, 0);
    bed_hang_up(client); /* the end of the connection is noticed even now */
    bed_await(&bed, bed.service.closed == 1);
    descriptors_give(&bed.service.descriptors, bed.service.descriptors.used);
    bed_close(&bed);
}

static void test_short_of_memory(void **state)
{
    struct bed bed;
    static unsigned char bytes[FRAME_HEADER_SIZE + 60000];
    struct conn_limits limits = conn_limits_default();
    (void)state;
    limits.stall_ms = 50;
    bed_open(&bed, &limits);
    struct bed_client *client = bed_join(&bed, 1);
    bed.service.memory.limit = bed.service.memory.live + 40000;
    frame_header_write(&(struct frame_header){.type = FRAME_PING, .request = 1, .control_size = 60000}, bytes);
    bed_send_bytes(client, bytes, sizeof bytes, NULL, 0);
    bed_await(&bed, bed_newest_conn(&bed)->reading_waits);
    bed_pump(&bed, 120); /* longer than stall_ms, which does not apply while the daemon itself is short of memory */
    assert_int_equal(bed.service.closed, 0);
    bed.service.memory.limit = UINT64_MAX;
    bed_expect(&bed, client, FRAME_PONG, 1);
    bed_close(&bed);
}

/* The loop sleeps without a timeout once no connection has anything to do and clients have read their results. */
static void test_idle_costs_nothing(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    struct bed_client *client = bed_join(&bed, 1);
    bed_send(client, FRAME_GET, 10);
    for (uint64_t i = 1; i <= 10; i++)
        bed_expect(&bed, client, FRAME_RESULT, i);
    bed_await(&bed, uv_backend_timeout(&bed.loop) == -1); /* It is noticed that the client has read everything. */
    bed_close(&bed);
}

static void test_closing_all(void **state)
{
    struct bed bed;
    (void)state;
    bed_open(&bed, NULL);
    for (int i = 0; i < BED_CLIENTS; i++) {
        struct bed_client *client = bed_connect(&bed, 1);
        if (i > 0)
            bed_hello(&bed, client);
        if (i > 1)
            bed_send(client, FRAME_GET, 10);
        if (i > 2)
            bed_pump(&bed, 0);
    }
    conn_group_close(&bed.group);
    assert_int_equal(bed.group.count, 0);
    assert_int_equal(bed.service.memory.live, 0);
    bed_close(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_refused_by_the_kernel), /* it forks, so it comes before tests that start threads */
        cmocka_unit_test(test_descriptors_in_order),
        cmocka_unit_test(test_stalled_with_descriptors),
        cmocka_unit_test(test_unread_results_that_others_wait_for),
        cmocka_unit_test(test_a_talkative_client_has_to_read),
        cmocka_unit_test(test_reads_one_at_a_time),
        cmocka_unit_test(test_waiting_is_quiet),
        cmocka_unit_test(test_descriptors_of_all),
        cmocka_unit_test(test_asks_and_never_reads),
        cmocka_unit_test(test_reads_slowly),
        cmocka_unit_test(test_unfinished_frame),
        cmocka_unit_test(test_frame_that_trickles),
        cmocka_unit_test(test_waits_for_others),
        cmocka_unit_test(test_share_of_frames),
        cmocka_unit_test(test_share_of_time),
        cmocka_unit_test(test_costly_ones_come_last),
        cmocka_unit_test(test_short_of_descriptors),
        cmocka_unit_test(test_short_of_memory),
        cmocka_unit_test(test_idle_costs_nothing),
        cmocka_unit_test(test_closing_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

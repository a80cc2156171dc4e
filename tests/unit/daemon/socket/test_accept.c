/* SPDX-License-Identifier: Apache-2.0 */
/* test_accept.c - tests that clients are accepted, refused when there are too many, and kept waiting in a shortage. */
#include <errno.h>
#include <sys/un.h>

#include "tests/support/unit.h"

#include "daemon/socket/accept.h"
#include "daemon/system/detached.h"
#include "tests/support/daemon/conn_bed.h"
#include "daemon/socket/listen.h"

/* No thread can be started: neither accepting nor refusing a client needs one. */
bool detached_start(void *(*run)(void *context), void *context)
{
    (void)run;
    (void)context;
    return false;
}

struct accept_test {
    struct bed bed;
    char directory[64], path[80];
    struct listener listener;
    struct acceptor acceptor;
};

static void accept_test_open(struct accept_test *test, uint32_t max_connections)
{
    bed_open(&test->bed, NULL);
    strcpy(test->directory, "/tmp/bvhd-accept-XXXXXX");
    assert_non_null(mkdtemp(test->directory));
    snprintf(test->path, sizeof test->path, "%s/s", test->directory);
    assert_int_equal(listen_bind(test->path, &test->listener, NULL), BVHD_OK);
    assert_int_equal(accept_open(&test->acceptor, &test->bed.group, test->listener.socket, max_connections, NULL),
                     BVHD_OK);
}

static void accept_test_close(struct accept_test *test)
{
    accept_close(&test->acceptor);
    accept_close(&test->acceptor);
    bed_pump(&test->bed, 0);
    listen_close(&test->listener);
    rmdir(test->directory);
    bed_close(&test->bed);
}

static struct bed_client *connect_client(struct accept_test *test)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int i = 0;
    while (test->bed.clients[i].socket >= 0)
        i++;
    struct bed_client *client = &test->bed.clients[i];
    *client = (struct bed_client){.socket = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)};
    frame_parser_init(&client->parser, &test->bed.memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    strcpy(address.sun_path, test->path);
    assert_int_equal(connect(client->socket, (struct sockaddr *)&address, sizeof address), 0);
    return client;
}

static void test_clients_come_and_go(void **state)
{
    struct accept_test test;
    (void)state;
    accept_test_open(&test, 100);
    for (int i = 0; i < 20; i++) {
        struct bed_client *client = connect_client(&test);
        bed_hello(&test.bed, client);
        assert_int_equal(bed_newest_conn(&test.bed)->peer.uid, getuid());
        assert_int_equal(bed_newest_conn(&test.bed)->peer.pid, getpid());
        assert_int_equal(test.bed.service.descriptors.used, 1);
        bed_hang_up(client);
        bed_await(&test.bed, test.bed.group.count == 0);
    }
    accept_test_close(&test);
}

static void test_full(void **state)
{
    struct accept_test test;
    (void)state;
    accept_test_open(&test, 2); /* one user may have both */
    struct bed_client *first = connect_client(&test), *second = connect_client(&test);
    bed_hello(&test.bed, first);
    bed_hello(&test.bed, second);
    struct bed_client *third = connect_client(&test);
    bed_expect_error(&test.bed, third, BVHD_BUSY);
    bed_hang_up(first);
    bed_await(&test.bed, test.bed.group.count == 1);
    struct bed_client *fourth = connect_client(&test);
    bed_hello(&test.bed, fourth);
    accept_test_close(&test);
}

/* Above seven eighths of what one user may have, the client that has been idle longest leaves for each that comes. */
static void test_idle_clients_make_room(void **state)
{
    struct accept_test test;
    struct bed_client *clients[9];
    struct frame frame;
    (void)state;
    accept_test_open(&test, 12); /* one user may have 9 of them, and room is short with 8 */
    test.bed.group.limits.idle_ms = 20;
    test.bed.group.limits.linger_ms = 600;
    for (int i = 0; i < 8; i++) {
        clients[i] = connect_client(&test);
        bed_hello(&test.bed, clients[i]);
        bed_pump(&test.bed, 2);
    }
    bed_pump(&test.bed, 30);
    bed_send(clients[0], FRAME_PING, 1);
    bed_expect(&test.bed, clients[0], FRAME_PONG, 1);
    clients[8] = connect_client(&test);
    bed_hello(&test.bed, clients[8]);
    bed_send(clients[1], FRAME_PING, 2); /* sent before the client has read that it has to leave */
    bed_expect(&test.bed, clients[1], FRAME_GOODBYE, 0);
    bed_expect(&test.bed, clients[1], FRAME_PONG, 2);
    assert_false(bed_receive(&test.bed, clients[1], &frame));
    assert_true(clients[1]->eof);
    bed_await(&test.bed, test.bed.group.count == 8);
    for (int i = 0; i < 9; i++)
        if (i != 1) {
            bed_send(clients[i], FRAME_PING, 3);
            bed_expect(&test.bed, clients[i], FRAME_PONG, 3);
        }
    accept_test_close(&test);
}

/* A client that waits for something or holds something stays, and the newcomer is refused. */
static void test_busy_clients_stay(void **state)
{
    struct accept_test test;
    struct bed_client *clients[3];
    (void)state;
    accept_test_open(&test, 4);
    test.bed.group.limits.idle_ms = 20;
    for (int i = 0; i < 3; i++) {
        clients[i] = connect_client(&test);
        bed_hello(&test.bed, clients[i]);
    }
    test.bed.service.is_behind = true; /* the fake sessions hold results */
    bed_pump(&test.bed, 30);
    struct bed_client *fourth = connect_client(&test);
    bed_expect_error(&test.bed, fourth, BVHD_BUSY);
    for (int i = 0; i < 3; i++) {
        bed_send(clients[i], FRAME_PING, 1);
        bed_expect(&test.bed, clients[i], FRAME_PONG, 1);
    }
    accept_test_close(&test);
}

static void test_share_of_a_user(void **state)
{
    struct accept_test test;
    (void)state;
    accept_test_open(&test, 4);
    struct bed_client *clients[3];
    for (int i = 0; i < 3; i++) {
        clients[i] = connect_client(&test);
        bed_hello(&test.bed, clients[i]);
    }
    struct bed_client *fourth = connect_client(&test);
    assert_int_equal(test.bed.service.refused, 0);
    bed_expect_error(&test.bed, fourth, BVHD_BUSY);
    assert_int_equal(test.bed.service.refused, 1);
    bed_hang_up(fourth);
    bed_hang_up(clients[0]);
    bed_await(&test.bed, test.bed.group.count == 2);
    struct bed_client *other = bed_connect(&test.bed, getuid() + 1); /* does not count for this user */
    struct bed_client *again = connect_client(&test);
    bed_hello(&test.bed, other);
    bed_hello(&test.bed, again);
    accept_test_close(&test);
}

/* A client that connects while there are no descriptors waits in the socket's queue, and is accepted later. */
static void test_no_descriptors(void **state)
{
    struct accept_test test;
    (void)state;
    accept_test_open(&test, 100);
    struct bed_client *inside = connect_client(&test);
    bed_hello(&test.bed, inside);
    uint32_t count = descriptors_left(&test.bed.service.descriptors) - (DESCRIPTORS_RESERVE + 10);
    assert_true(descriptors_take(&test.bed.service.descriptors, count, 0));
    struct bed_client *waiting = connect_client(&test);
    bed_pump(&test.bed, 250);
    assert_int_equal(test.bed.group.count, 1);
    bed_send(inside, FRAME_PING, 1);
    bed_expect(&test.bed, inside, FRAME_PONG, 1);
    descriptors_give(&test.bed.service.descriptors, count);
    bed_hello(&test.bed, waiting);
    accept_test_close(&test);
}

static void test_session_refused(void **state)
{
    struct accept_test test;
    struct frame frame;
    (void)state;
    accept_test_open(&test, 100);
    test.bed.service.refuse = true;
    struct bed_client *client = connect_client(&test);
    assert_false(bed_receive(&test.bed, client, &frame));
    assert_true(client->eof);
    assert_int_equal(test.bed.service.refused, 1);
    assert_int_equal(test.bed.group.count, 0);
    accept_test_close(&test);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clients_come_and_go), cmocka_unit_test(test_full),
        cmocka_unit_test(test_share_of_a_user),     cmocka_unit_test(test_idle_clients_make_room),
        cmocka_unit_test(test_busy_clients_stay),   cmocka_unit_test(test_no_descriptors),
        cmocka_unit_test(test_session_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <sys/un.h>

#include "tests/support/unit.h"

#include "daemon/socket/accept.h"
#include "tests/support/daemon/conn_bed.h"
#include "daemon/socket/listen.h"

struct door {
    struct bed bed;
    char directory[64], path[80];
    struct listener listener;
    struct acceptor acceptor;
};

static void door_open(struct door *door, uint32_t max_connections)
{
    bed_open(&door->bed, NULL);
    strcpy(door->directory, "/tmp/bvhd-accept-XXXXXX");
    assert_non_null(mkdtemp(door->directory));
    snprintf(door->path, sizeof door->path, "%s/s", door->directory);
    assert_int_equal(listen_bind(door->path, &door->listener, NULL), BVHD_OK);
    assert_int_equal(accept_open(&door->acceptor, &door->bed.group, door->listener.socket, max_connections, NULL),
                     BVHD_OK);
}

static void door_close(struct door *door)
{
    accept_close(&door->acceptor);
    accept_close(&door->acceptor);
    bed_pump(&door->bed, 0);
    listen_close(&door->listener);
    rmdir(door->directory);
    bed_close(&door->bed);
}

static struct bed_client *knock(struct door *door)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int i = 0;
    while (door->bed.clients[i].socket >= 0)
        i++;
    struct bed_client *client = &door->bed.clients[i];
    *client = (struct bed_client){.socket = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)};
    frame_parser_init(&client->parser, &door->bed.memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    strcpy(address.sun_path, door->path);
    assert_int_equal(connect(client->socket, (struct sockaddr *)&address, sizeof address), 0);
    return client;
}

static void test_clients_come_and_go(void **state)
{
    struct door door;
    (void)state;
    door_open(&door, 100);
    for (int i = 0; i < 20; i++) {
        struct bed_client *client = knock(&door);
        bed_hello(&door.bed, client);
        assert_int_equal(bed_newest_conn(&door.bed)->peer.uid, getuid());
        assert_int_equal(bed_newest_conn(&door.bed)->peer.pid, getpid());
        assert_int_equal(door.bed.service.descriptors.used, 1);
        bed_hang_up(client);
        bed_pump(&door.bed, 0);
        assert_int_equal(door.bed.group.count, 0);
    }
    door_close(&door);
}

static void test_full(void **state)
{
    struct door door;
    (void)state;
    door_open(&door, 2); /* a user's share: 2, too */
    struct bed_client *first = knock(&door), *second = knock(&door);
    bed_hello(&door.bed, first);
    bed_hello(&door.bed, second);
    struct bed_client *third = knock(&door);
    bed_expect_error(&door.bed, third, BVHD_BUSY);
    bed_hang_up(first);
    bed_pump(&door.bed, 0);
    struct bed_client *fourth = knock(&door);
    bed_hello(&door.bed, fourth);
    door_close(&door);
}

static void test_share_of_a_user(void **state)
{
    struct door door;
    (void)state;
    door_open(&door, 4);
    struct bed_client *clients[3];
    for (int i = 0; i < 3; i++) {
        clients[i] = knock(&door);
        bed_hello(&door.bed, clients[i]);
    }
    struct bed_client *fourth = knock(&door);
    bed_expect_error(&door.bed, fourth, BVHD_BUSY);
    bed_hang_up(fourth);
    bed_hang_up(clients[0]);
    bed_pump(&door.bed, 0);
    struct bed_client *other = bed_connect(&door.bed, getuid() + 1); /* counts for another user */
    struct bed_client *again = knock(&door);
    bed_hello(&door.bed, other);
    bed_hello(&door.bed, again);
    door_close(&door);
}

/* Nobody is lost: who comes while there are no descriptors waits in the queue. */
static void test_no_descriptors(void **state)
{
    struct door door;
    (void)state;
    door_open(&door, 100);
    struct bed_client *inside = knock(&door);
    bed_hello(&door.bed, inside);
    uint32_t count = descriptors_left(&door.bed.service.descriptors) - 20;
    assert_true(descriptors_take(&door.bed.service.descriptors, count, 0));
    struct bed_client *waiting = knock(&door);
    bed_pump(&door.bed, 250);
    assert_int_equal(door.bed.group.count, 1);
    bed_send(inside, FRAME_PING, 1);
    bed_expect(&door.bed, inside, FRAME_PONG, 1);
    descriptors_give(&door.bed.service.descriptors, count);
    bed_hello(&door.bed, waiting);
    door_close(&door);
}

static void test_session_refused(void **state)
{
    struct door door;
    struct frame frame;
    (void)state;
    door_open(&door, 100);
    door.bed.service.refuse = true;
    struct bed_client *client = knock(&door);
    assert_false(bed_receive(&door.bed, client, &frame));
    assert_true(client->eof);
    assert_int_equal(door.bed.group.count, 0);
    door_close(&door);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clients_come_and_go), cmocka_unit_test(test_full),
        cmocka_unit_test(test_share_of_a_user),     cmocka_unit_test(test_no_descriptors),
        cmocka_unit_test(test_session_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

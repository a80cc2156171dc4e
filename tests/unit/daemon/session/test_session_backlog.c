/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_session_backlog.c - tests backpressure: clients that do not read their results are held, and so is their user.
 */
#include "tests/support/unit.h"

#include "tests/support/daemon/session_world.h"

/* All sessions together may be ahead by a half of MEMORY. A user gets three quarters of what others leave of that. */
enum { MEMORY = 32 << 20, ALL = MEMORY / 2, LONG = ALL };

static struct session_world world;
static struct world_mesh mesh;

static int set_up(void **state)
{
    (void)state;
    struct service_options options = world_options();
    options.memory = MEMORY;
    world_init(&world, &options);
    world_mesh_init(&mesh, 100, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    world_mesh_finish(&mesh);
    return 0;
}

static void test_results_count_until_they_leave(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    client->hold = true;
    world_build_mesh(client, 1, &mesh);
    world_await_result(client, 1, 0);
    assert_true(session_uses(client->session, SHARE_RESULTS) > 1000);
    assert_int_equal(service_uses(world.service, SHARE_RESULTS), session_uses(client->session, SHARE_RESULTS));
    client->hold = false;
    world_iterate(&world);
    assert_int_equal(session_uses(client->session, SHARE_AHEAD), 0);
    assert_int_equal(service_uses(world.service, SHARE_RESULTS), 0);
}

static void prepares_stop(void)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_give(&world.service->admission.prepares[class], MEMORY);
}

static void prepares_go(void)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_end(&world.service->admission.prepares[class], MEMORY);
    service_collect(world.service);
}

static void test_who_does_not_read_gets_nothing_more_to_do(void **state)
{
    (void)state;
    struct world_client *client = world_join_as(&world, 1), *other = world_join_as(&world, 2);
    prepares_stop();
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_WAITING);
    session_add_result(client->session, LONG);
    prepares_go();
    world_build_mesh(client, 2, &mesh);
    world_get(client, 3, &(struct key){{1}}, 1);
    world_iterate(&world);
    assert_non_null(world_find(client, FRAME_BUSY, 2, 0));
    assert_non_null(world_find(client, FRAME_BUSY, 3, 0));
    world_build_mesh(other, 1, &mesh);
    world_check_bytes(world_await_result(other, 1, 0), &mesh.input);
    world_await_state(client, 1, 0, ITEM_WAITING);
    assert_null(world_result(client, 1, 0));
    session_take_result(client->session, LONG);
    world_check_bytes(world_await_result(client, 1, 0), &mesh.input);
    world_build_mesh(client, 2, &mesh);
    world_check_bytes(world_await_result(client, 2, 0), &mesh.input);
}

static void test_who_is_held_can_cancel_and_leave(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    struct world_client *both[] = {client, other};
    prepares_stop();
    for (int i = 0; i < 2; i++) {
        world_build_mesh(both[i], 1, &mesh);
        session_add_result(both[i]->session, LONG);
    }
    prepares_go();
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    assert_int_equal(world_status(client, 1, 0), BVHD_CANCELLED);
    world_leave(other);
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    assert_int_equal(service_uses(world.service, SHARE_RESULTS), LONG);
}

static uint64_t room_of(const struct world_client *client)
{
    return share_room(&client->session->client.member.share, SHARE_AHEAD);
}

/* Items that have started count as the results that they will have. */
static void test_nobody_starts_more_than_its_share(void **state)
{
    (void)state;
    struct world_client *client = world_join_as(&world, 1), *other = world_join_as(&world, 2);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct world_mesh meshes[6];
    for (uint32_t i = 0; i < 6; i++) {
        world_mesh_init(&meshes[i], 1500, i + 10);
        world_build_mesh(client, i + 1, &meshes[i]);
    }
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    assert_int_equal(session_uses(client->session, SHARE_AHEAD), client->session->client.started_bytes);
    session_add_result(client->session, room_of(client) - client->session->client.started_bytes); /* all it may have */
    world_build_mesh(client, 7, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    world_build_mesh(client, 8, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 1);
    world_build_mesh(other, 1, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 1);
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    for (uint32_t i = 1; i <= 7; i++)
        world_check_bytes(world_await_result(client, i, 0), i > 6 ? &mesh.input : &meshes[i - 1].input);
    world_iterate(&world);
    session_take_result(client->session, session_uses(client->session, SHARE_RESULTS));
    world_check_bytes(world_await_result(client, 8, 0), &mesh.input);
    world_iterate(&world);
    assert_int_equal(client->session->client.started_bytes, 0);
    for (uint32_t i = 0; i < 6; i++)
        world_mesh_finish(&meshes[i]);
}

/*
 * Connections of one user that read nothing hold the user's other connections, but no other user, however many they
 * are. As they read, the others go on, without anything that they do themselves: small items before large ones.
 */
static void test_a_user_is_held_as_a_whole(void **state)
{
    (void)state;
    enum { CROWD = 8, EACH = ALL / 4 }; /* the user's room is three quarters of ALL */
    struct world_client *crowd[CROWD], *same = world_join_as(&world, 1), *other = world_join_as(&world, 2);
    struct world_mesh large;
    world_mesh_init(&large, 1500, 3);
    for (int i = 0; i < CROWD; i++) {
        crowd[i] = world_join_as(&world, 1);
        session_add_result(crowd[i]->session, EACH);
    }
    assert_true(session_is_behind(crowd[0]->session));
    assert_false(session_is_behind(same->session)); /* it has read everything */
    world_build_mesh(same, 1, &mesh);
    world_build_mesh(same, 2, &large);
    world_build_mesh(other, 1, &mesh);
    world_check_bytes(world_await_result(other, 1, 0), &mesh.input);
    for (int i = 0; i < 3; i++)
        session_read(crowd[i]->session, EACH);
    world_await_state(same, 1, 0, ITEM_WAITING);
    session_read(crowd[3]->session, EACH);
    world_check_bytes(world_await_result(same, 1, 0), &mesh.input);
    world_await_state(same, 2, 0, ITEM_WAITING);
    session_read(crowd[4]->session, EACH);
    world_check_bytes(world_await_result(same, 2, 0), &large.input);
    assert_true(session_is_behind(crowd[7]->session)); /* it has more than what two others leave it */
    session_read(crowd[5]->session, EACH);
    assert_false(session_is_behind(crowd[7]->session));
    world_mesh_finish(&large);
}

/* Nobody is dropped for what others leave unread, and a user that reads has room while others fill theirs. */
static void test_users_that_read_nothing_leave_room_for_others(void **state)
{
    (void)state;
    struct world_client *clients[9];
    for (uint32_t i = 0; i < 9; i++) {
        clients[i] = world_join_as(&world, 10 + i);
        uint64_t room = room_of(clients[i]);
        assert_true(room > 0);
        session_add_result(clients[i]->session, room + 1);
        assert_true(session_is_behind(clients[i]->session));
    }
    struct world_client *reader = world_join_as(&world, 1);
    world_build_mesh(reader, 1, &mesh);
    world_check_bytes(world_await_result(reader, 1, 0), &mesh.input);
    for (uint32_t i = 0; i < 9; i++)
        assert_false(clients[i]->failed);
}

static bool starts_more(const struct world_client *client)
{
    const struct user_member *member = &client->session->client.member;
    return !memory_lanes_are_held(&member->preparing) && !member->user->preparing.nodes[ADMISSION_LARGE].held;
}

/* Users come one after the other, and none of them reads: together they get what there is, and one result each more. */
static void test_users_that_read_nothing_stay_within_the_limit(void **state)
{
    (void)state;
    enum { USERS = 9, EACH = ALL / 64 };
    for (uint32_t i = 0; i < USERS; i++) {
        struct world_client *client = world_join_as(&world, 10 + i);
        assert_true(starts_more(client));
        while (starts_more(client))
            session_add_result(client->session, EACH);
        assert_true(service_uses(world.service, SHARE_AHEAD) <= ALL + (i + 1) * EACH);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_results_count_until_they_leave, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_who_does_not_read_gets_nothing_more_to_do, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_who_is_held_can_cancel_and_leave, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_nobody_starts_more_than_its_share, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_user_is_held_as_a_whole, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_users_that_read_nothing_leave_room_for_others, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_users_that_read_nothing_stay_within_the_limit, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

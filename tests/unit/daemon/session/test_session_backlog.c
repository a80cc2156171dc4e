/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_session_backlog.c - tests backpressure: clients that do not read their results are held, and in the end dropped.
 */
#include "tests/support/unit.h"

#include "tests/support/daemon/session_world.h"

/* The share of one session is an eighth of MEMORY, that of all sessions together a half. */
enum { MEMORY = 32 << 20, LONG = MEMORY / 8 + 1 };

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
    assert_true(client->session->backlog.bytes > 1000);
    assert_int_equal(world.service->sessions.backlog_bytes, client->session->backlog.bytes);
    client->hold = false;
    world_iterate(&world);
    assert_int_equal(client->session->backlog.bytes, 0);
    assert_int_equal(world.service->sessions.backlog_bytes, 0);
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
    struct world_client *client = world_join(&world), *other = world_join(&world);
    prepares_stop();
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_WAITING);
    session_backlog_add(client->session, LONG);
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
    session_backlog_take(client->session, LONG);
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
        session_backlog_add(both[i]->session, LONG);
    }
    prepares_go();
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    assert_int_equal(world_status(client, 1, 0), BVHD_CANCELLED);
    world_leave(other);
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    assert_int_equal(world.service->sessions.backlog_bytes, LONG);
}

/* Items that have started count as the results that they will have. */
static void test_nobody_starts_more_than_its_share(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct world_mesh meshes[6];
    for (uint32_t i = 0; i < 6; i++) {
        world_mesh_init(&meshes[i], 1500, i + 10);
        world_build_mesh(client, i + 1, &meshes[i]);
    }
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    session_backlog_add(client->session,
                        MEMORY / 8 - client->session->client.started_bytes); /* as much as is allowed */
    world_build_mesh(client, 7, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 0);
    world_build_mesh(client, 8, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 1);
    world_build_mesh(other, 1, &mesh);
    assert_int_equal(world_counters(&world).prepares_waiting, 1);
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    for (uint32_t i = 1; i <= 8; i++)
        world_check_bytes(world_await_result(client, i, 0), i > 6 ? &mesh.input : &meshes[i - 1].input);
    world_iterate(&world);
    session_backlog_take(client->session, client->session->backlog.bytes);
    assert_int_equal(client->session->client.started_bytes, 0);
    for (uint32_t i = 0; i < 6; i++)
        world_mesh_finish(&meshes[i]);
}

/* While all sessions together exceed their share, any backlog is too long. */
static void test_a_crowd_is_held(void **state)
{
    (void)state;
    struct world_client *clients[6];
    for (int i = 0; i < 6; i++)
        clients[i] = world_join(&world);
    session_backlog_add(clients[0]->session, 1);
    assert_false(session_backlog_is_long(clients[0]->session));
    for (int i = 1; i < 5; i++)
        session_backlog_add(clients[i]->session, MEMORY / 8);
    assert_true(session_backlog_is_long(clients[0]->session));
    assert_true(session_backlog_is_long(clients[4]->session));
    assert_false(session_backlog_is_long(clients[5]->session));
    world_leave(clients[4]);
    assert_false(session_backlog_is_long(clients[0]->session));
    assert_false(session_backlog_is_long(clients[3]->session));
}

static void test_the_one_furthest_behind_has_to_go(void **state)
{
    (void)state;
    struct world_client *clients[9];
    atomic_fetch_add(&world.service->account.live_bytes, MEMORY + 1); /* as if all results were different */
    for (int i = 0; i < 9; i++) {
        clients[i] = world_join(&world);
        session_backlog_add(clients[i]->session, i == 3 ? MEMORY / 8 : MEMORY / 8 - 100);
        for (int k = 0; k <= i; k++)
            assert_int_equal(clients[k]->failed, i == 8 && k == 3);
    }
    assert_int_equal(clients[3]->session->failure.status, BVHD_TOO_LARGE);
    assert_true(world.service->sessions.backlog_bytes <= MEMORY);
    session_backlog_take(clients[3]->session, 1); /* it does not count any more */
    assert_int_equal(world.service->sessions.backlog_bytes, 8 * (MEMORY / 8 - 100));
    atomic_fetch_sub(&world.service->account.live_bytes, MEMORY + 1);
}

/* One result that all clients wait for lies in memory once. */
static void test_nobody_has_to_go_for_the_same_result(void **state)
{
    (void)state;
    struct world_client *clients[12];
    for (int i = 0; i < 12; i++) {
        clients[i] = world_join(&world);
        session_backlog_add(clients[i]->session, MEMORY / 8);
    }
    assert_true(world.service->sessions.backlog_bytes > MEMORY);
    for (int i = 0; i < 12; i++)
        assert_false(clients[i]->failed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_results_count_until_they_leave, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_who_does_not_read_gets_nothing_more_to_do, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_who_is_held_can_cancel_and_leave, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_nobody_starts_more_than_its_share, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_crowd_is_held, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_one_furthest_behind_has_to_go, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_nobody_has_to_go_for_the_same_result, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_flight.c - tests that equal builds are done once: clients that join and leave, cancellations, shortages. */
#include <sched.h>

#include "tests/support/unit.h"

#include "tests/support/daemon/session_world.h"

static struct session_world world;
static struct world_mesh mesh;

static int set_up(void **state)
{
    (void)state;
    world_init(&world, NULL);
    world_mesh_init(&mesh, 300, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    world_mesh_finish(&mesh);
    return 0;
}

static bool is_idle(void *context)
{
    (void)context;
    struct counters counters = world_counters(&world);
    return counters.builds_running == 0 && counters.jobs_queued == 0 && counters.jobs_running == 0;
}

static void build_equal_items(struct world_client *client, uint64_t request, uint32_t count)
{
    struct control_item items[64];
    for (uint32_t i = 0; i < count; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = count, .items = items};
    world_build(client, request, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
}

static void test_equal_items_are_built_once(void **state)
{
    (void)state;
    enum { CLIENTS = 4, ITEMS = 50 };
    struct world_client *clients[CLIENTS];
    uint32_t built = 0, others = 0;
    for (int i = 0; i < CLIENTS; i++) {
        clients[i] = world_join(&world);
        build_equal_items(clients[i], 1, ITEMS);
    }
    world_settle(&world);
    for (int i = 0; i < CLIENTS; i++)
        for (uint32_t k = 0; k < ITEMS; k++) {
            const struct world_event *event = world_result(clients[i], 1, k);
            world_check_bytes(event, &mesh.input);
            built += event->result->origin == ORIGIN_BUILT;
            others += event->result->origin == ORIGIN_COALESCED || event->result->origin == ORIGIN_MEMORY;
            assert_int_equal(world_prepared(clients[i], 1, k), 1);
        }
    struct counters counters = world_counters(&world);
    assert_int_equal(built, 1);
    assert_int_equal(others, CLIENTS * ITEMS - 1);
    assert_int_equal(counters.builds_started, 1);
    assert_int_equal(counters.coalesced + counters.hits_memory, CLIENTS * ITEMS - 1);
    assert_int_equal(counters.misses, 1);
}

/* Equal builds that wait at the same time are done once even without a cache. */
static void test_waiters_need_no_cache(void **state)
{
    (void)state;
    struct service_options options = world_options();
    world_finish(&world);
    options.cache = 0;
    world_init(&world, &options);
    struct world_client *client = world_join(&world);
    world_hold_builds(&world);
    build_equal_items(client, 1, 3);
    for (uint32_t i = 0; i < 3; i++)
        world_await_state(client, 1, i, ITEM_JOINED);
    world_release_builds(&world);
    world_settle(&world);
    assert_int_equal(world_counters(&world).builds_started, 1);
    assert_int_equal(world_counters(&world).cache_entries, 0);
    build_equal_items(client, 2, 1);
    world_settle(&world);
    assert_int_equal(world_result(client, 2, 0)->result->origin, ORIGIN_BUILT);
    assert_int_equal(world_counters(&world).builds_started, 2);
}

/* ---- one of two clients leaves ---- */

enum leaving { CANCELS, DIES };

static void leave(struct world_client *client, enum leaving how)
{
    if (how == CANCELS)
        assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    else
        world_leave(client);
}

/* Two clients wait for one build; the one that started it, or the other, leaves before the build has memory. */
static void check_leaving_early(enum leaving how, bool starter_leaves)
{
    struct world_client *first = world_join(&world), *second = world_join(&world);
    world_hold_builds(&world);
    world_build_mesh(first, 1, &mesh);
    world_await_state(first, 1, 0, ITEM_JOINED);
    world_build_mesh(second, 1, &mesh);
    world_await_state(second, 1, 0, ITEM_JOINED);
    struct world_client *leaver = starter_leaves ? first : second, *stayer = starter_leaves ? second : first;
    leave(leaver, how);
    assert_int_equal(world_counters(&world).builds_waiting, 1);
    world_release_builds(&world);
    world_check_bytes(world_await_result(stayer, 1, 0), &mesh.input);
    assert_int_equal(world_result(stayer, 1, 0)->result->origin, starter_leaves ? ORIGIN_COALESCED : ORIGIN_BUILT);
    assert_int_equal(world_counters(&world).builds_started, 1);
    assert_int_equal(world_counters(&world).cancelled, 1);
}

static void test_the_starter_cancels_early(void **state)
{
    (void)state;
    check_leaving_early(CANCELS, true);
}

static void test_the_starter_dies_early(void **state)
{
    (void)state;
    check_leaving_early(DIES, true);
}

static void test_the_other_cancels_early(void **state)
{
    (void)state;
    check_leaving_early(CANCELS, false);
}

static void test_the_other_dies_early(void **state)
{
    (void)state;
    check_leaving_early(DIES, false);
}

/* The starter leaves after the build was given to the pool. */
static void check_leaving_late(enum leaving how)
{
    struct world_client *first = world_join(&world), *second = world_join(&world);
    world_hold_builds(&world);
    world_build_mesh(first, 1, &mesh);
    world_build_mesh(second, 1, &mesh);
    world_await_state(first, 1, 0, ITEM_JOINED);
    world_await_state(second, 1, 0, ITEM_JOINED);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_release_builds(&world);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, 1);
    leave(first, how);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, 1);
    world_open(gates[0]);
    world_open(gates[1]);
    world_check_bytes(world_await_result(second, 1, 0), &mesh.input);
    assert_int_equal(world_counters(&world).builds_started, 1);
    assert_int_equal(world_counters(&world).builds_cancelled, 0);
}

static void test_the_starter_cancels_late(void **state)
{
    (void)state;
    check_leaving_late(CANCELS);
}

static void test_the_starter_dies_late(void **state)
{
    (void)state;
    check_leaving_late(DIES);
}

/* Either of two clients dies while the items of both are being prepared. */
static void test_one_dies_while_both_prepare(void **state)
{
    (void)state;
    for (int dying = 0; dying < 2; dying++) {
        struct world_client *clients[] = {world_join(&world), world_join(&world)};
        struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
        world_build_mesh(clients[0], 1, &mesh);
        world_build_mesh(clients[1], 1, &mesh);
        world_leave(clients[dying]);
        world_open(gates[0]);
        world_open(gates[1]);
        world_check_bytes(world_await_result(clients[1 - dying], 1, 0), &mesh.input);
    }
    world_await(&world, is_idle, NULL);
    assert_int_equal(world_counters(&world).sessions, 2);
}

/* ---- nobody inherits a cancellation ---- */

static void test_a_cancelled_build_is_not_inherited(void **state)
{
    (void)state;
    struct world_client *first = world_join(&world), *second = world_join(&world);
    struct world_mesh large;
    world_mesh_init(&large, 100000, 9);
    struct control_item item = world_item(&large.input, large.size, SOURCE_MEMFD, 0);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {large.size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(large.payload, large.size, WORLD_SEALS_ONCE);
    world_build(first, 1, &build, (struct bytes){0}, &descriptor);
    world_await_state(first, 1, 0, ITEM_JOINED);
    struct key key = session_find(first->session, 1)->items[0].key;
    assert_non_null(flights_find(&world.service->flights, &key));
    assert_int_equal(world_cancel(first, 1, NULL, 0), BVHD_OK);
    assert_null(flights_find(&world.service->flights, &key));
    assert_int_equal(world_counters(&world).builds_running, 1); /* the abandoned one still ends */
    descriptor = world_memfd(large.payload, large.size, WORLD_SEALS_ONCE);
    world_build(second, 1, &build, (struct bytes){0}, &descriptor);
    world_check_bytes(world_await_result(second, 1, 0), &large.input);
    assert_int_equal(world_status(first, 1, 0), BVHD_CANCELLED);
    world_mesh_finish(&large);
}

/* The same build is asked for again before a worker has begun with the cancelled one. */
static void test_a_withdrawn_build_is_not_inherited(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    world_hold_builds(&world);
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_JOINED);
    world_release_builds(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, 1);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    world_build_mesh(client, 2, &mesh);
    world_open(gates[0]);
    world_open(gates[1]);
    world_check_bytes(world_await_result(client, 2, 0), &mesh.input);
    assert_int_equal(world_counters(&world).builds_cancelled, 1);
    assert_int_equal(world_counters(&world).builds_done, 1);
}

/* ---- GET ---- */

static void test_get_joins_a_build(void **state)
{
    (void)state;
    struct world_client *builder = world_join(&world), *getter = world_join(&world);
    world_hold_builds(&world);
    world_build_mesh(builder, 1, &mesh);
    world_await_state(builder, 1, 0, ITEM_JOINED);
    struct key key = session_find(builder->session, 1)->items[0].key;
    world_get(getter, 1, &key, 1);
    assert_null(world_result(getter, 1, 0));
    assert_int_equal(session_find(getter->session, 1)->items[0].state, ITEM_JOINED);
    world_leave(builder); /* the getter keeps the build alive */
    world_release_builds(&world);
    world_check_bytes(world_await_result(getter, 1, 0), &mesh.input);
    assert_int_equal(world_result(getter, 1, 0)->result->origin, ORIGIN_COALESCED);
    assert_null(session_find(getter->session, 1));
}

static void test_get_can_be_cancelled(void **state)
{
    (void)state;
    struct world_client *builder = world_join(&world), *getter = world_join(&world);
    world_hold_builds(&world);
    world_build_mesh(builder, 1, &mesh);
    world_await_state(builder, 1, 0, ITEM_JOINED);
    struct key key = session_find(builder->session, 1)->items[0].key;
    world_get(getter, 1, &key, 1);
    assert_int_equal(world_cancel(getter, 1, NULL, 0), BVHD_OK);
    assert_int_equal(world_status(getter, 1, 0), BVHD_CANCELLED);
    assert_null(session_find(getter->session, 1));
    world_release_builds(&world);
    world_check_bytes(world_await_result(builder, 1, 0), &mesh.input);
}

/* ---- shortages ---- */

static void ask(struct world_client *client, uint64_t request, const struct world_mesh *asked)
{
    struct control_item item = world_item(&asked->input, asked->size, SOURCE_MEMFD, 0);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {asked->size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(asked->payload, asked->size, WORLD_SEALS_ONCE);
    world_build(client, request, &build, (struct bytes){0}, &descriptor);
}

/* Estimates keep builds that run side by side within the budget. */
static void test_builds_do_not_push_each_other_over(void **state)
{
    (void)state;
    enum { MESHES = 6 };
    struct service_options options = world_options();
    struct world_mesh meshes[MESHES];
    world_finish(&world);
    options.workers = 4;
    options.memory = 16 << 20;
    world_init(&world, &options);
    struct world_client *clients[] = {world_join(&world), world_join(&world)};
    for (uint32_t i = 0; i < MESHES; i++) {
        world_mesh_init(&meshes[i], 30000, i); /* a build takes 4.3 MiB, its copy 1 MiB */
        ask(clients[i % 2], i + 1, &meshes[i]);
    }
    for (uint32_t i = 0; i < MESHES; i++) {
        world_check_bytes(world_await_result(clients[i % 2], i + 1, 0), &meshes[i].input);
        world_mesh_finish(&meshes[i]);
    }
    assert_int_equal(world_counters(&world).builds_retried, 0);
}

/* A build that gets less than was promised, since something else took it, is tried again alone. */
static void test_a_shortage_beside_others_is_tried_again(void **state)
{
    (void)state;
    struct world_mesh meshes[2];
    world_restart(&world, 32 << 20);
    struct world_client *client = world_join(&world);
    world_mesh_init(&meshes[0], 20000, 1);
    world_mesh_init(&meshes[1], 20000, 2);
    struct memory *memory = &world.service->memory;
    world_hold_builds(&world);
    ask(client, 1, &meshes[0]);
    ask(client, 2, &meshes[1]);
    world_await_state(client, 1, 0, ITEM_JOINED);
    world_await_state(client, 2, 0, ITEM_JOINED);
    void *block =
        memory_alloc(memory, memory->limit - atomic_load(&memory->live) - (1 << 20)); /* a build takes 2.9 MiB */
    assert_non_null(block);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_release_builds(&world);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, 2);
    world_open(gates[0]);
    world_open(gates[1]);
    while (world_counters(&world).jobs_running + world_counters(&world).jobs_queued > 0)
        ;
    memory_free(memory, block); /* before the loop collects the failed builds */
    world_check_bytes(world_await_result(client, 1, 0), &meshes[0].input);
    world_check_bytes(world_await_result(client, 2, 0), &meshes[1].input);
    assert_int_equal(world_counters(&world).builds_retried, 2);
    world_mesh_finish(&meshes[0]);
    world_mesh_finish(&meshes[1]);
}

static void test_a_shortage_alone_is_an_error_and_not_kept(void **state)
{
    (void)state;
    struct world_mesh large;
    world_restart(&world, 16 << 20);
    struct world_client *client = world_join(&world);
    world_mesh_init(&large, 100000, 1); /* a build takes 14 MB, its copy 3.6 MB */
    ask(client, 1, &large);
    assert_int_equal(world_await_result(client, 1, 0)->result->error.status, BVHD_NO_MEMORY);
    assert_int_equal(world_prepared(client, 1, 0), 1);
    assert_int_equal(world_counters(&world).builds_retried, 0);
    assert_int_equal(world_counters(&world).builds_failed, 1);
    struct world_client *other = world_join(&world);
    world_build_mesh(other, 1, &mesh);
    world_check_bytes(world_await_result(other, 1, 0), &mesh.input);
    ask(client, 2, &large);
    world_await_result(client, 2, 0);
    assert_int_equal(world_counters(&world).builds_started, 3);
    world_mesh_finish(&large);
}

/*
 * Each of these builds fits, but not beside the copies of the others that half of the budget has room for. What is
 * admitted can be built, so all of them end, and none is begun in vain.
 */
static void test_what_is_admitted_can_be_built(void **state)
{
    (void)state;
    enum { CLIENTS = 4, EACH = 2 };
    struct world_mesh meshes[CLIENTS * EACH];
    struct world_client *clients[CLIENTS];
    world_restart(&world, 16 << 20);
    for (uint32_t i = 0; i < CLIENTS * EACH; i++) {
        world_mesh_init(&meshes[i], 48000, i); /* with its copy it takes 10.7 MiB of 12, and the copy 2.3 */
        if (i < CLIENTS)
            clients[i] = world_join_as(&world, i);
        ask(clients[i % CLIENTS], i + 1, &meshes[i]);
    }
    world_settle(&world);
    for (uint32_t i = 0; i < CLIENTS * EACH; i++) {
        assert_int_equal(world_status(clients[i % CLIENTS], i + 1, 0), BVHD_OK);
        world_mesh_finish(&meshes[i]);
    }
    assert_int_equal(world_counters(&world).builds_started, CLIENTS * EACH);
}

/* A build that ran short of memory waits until no copies are left but its own; meanwhile nothing large is prepared. */
static void test_a_build_is_tried_again_when_it_is_alone(void **state)
{
    (void)state;
    struct admission *admission = &world.service->admission;
    struct memory *memory = &world.service->memory;
    struct world_client *client = world_join(&world), *other = world_join_as(&world, 2);
    struct world_mesh large, small_copy;
    world_mesh_init(&large, 20000, 1);
    world_mesh_init(&small_copy, 20000, 2);
    world_hold_builds(&world);
    ask(client, 1, &large);
    world_await_state(client, 1, 0, ITEM_JOINED);
    admission_give(&admission->prepares[ADMISSION_LARGE], 1); /* a copy of somebody else */
    void *block = memory_alloc(memory, memory->limit - atomic_load(&memory->live) - (1 << 20));
    assert_non_null(block);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_release_builds(&world);
    world_iterate(&world);
    world_open(gates[0]);
    world_open(gates[1]);
    while (world_counters(&world).jobs_running + world_counters(&world).jobs_queued > 0)
        ;
    memory_free(memory, block);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_retried, 1);
    assert_int_equal(world_counters(&world).builds_waiting, 1);
    ask(other, 1, &small_copy);
    world_iterate(&world);
    world_await_state(other, 1, 0, ITEM_WAITING);
    assert_int_equal(world_counters(&world).builds_running, 0);
    admission_end(&admission->prepares[ADMISSION_LARGE], 1);
    world_check_bytes(world_await_result(client, 1, 0), &large.input);
    world_check_bytes(world_await_result(other, 1, 0), &small_copy.input);
    assert_int_equal(admission->alone + admission->alone_copies, 0);
    world_mesh_finish(&large);
    world_mesh_finish(&small_copy);
}

/* ---- turns ---- */

/* Lets a flight that both wait for go on, and returns the flow in which it does. */
static struct pool_flow *flow_of_flight(const struct world_client *client, uint64_t request)
{
    const struct item *item = &session_find(client->session, request)->items[0];
    return flight_flow(&item->waiter);
}

/* A build that many wait for goes on in the turn of whoever is served earliest, not of whoever asked first. */
static void test_a_shared_build_has_the_earliest_turn(void **state)
{
    (void)state;
    struct world_client *busy = world_join_as(&world, 1), *idle = world_join_as(&world, 2),
                        *third = world_join_as(&world, 3);
    struct world_client *all[] = {busy, idle, third};
    world_hold_builds(&world);
    for (int i = 0; i < 3; i++) {
        world_build_mesh(all[i], 2, &mesh);
        world_await_state(all[i], 2, 0, ITEM_JOINED);
    }
    struct pool_flow *flow = busy->session->client.member.flow;
    struct world_gate *gates[] = {world_shut_for(&world, flow), world_shut_for(&world, flow)};
    uint64_t before = pool_load(world.service->pool).busy_ns; /* no flow's time is above that */
    while (pool_flow_load(world.service->pool, flow).busy_ns <= 2 * before)
        sched_yield();
    world_release_builds(&world);
    world_iterate(&world);
    assert_ptr_not_equal(flow_of_flight(busy, 2), busy->session->client.member.flow);
    world_leave(idle); /* while the job is queued */
    assert_ptr_equal(flow_of_flight(busy, 2), third->session->client.member.flow);
    assert_int_equal(world_cancel(third, 2, NULL, 0), BVHD_OK);
    assert_ptr_equal(flow_of_flight(busy, 2), busy->session->client.member.flow);
    world_open(gates[0]);
    world_open(gates[1]);
    world_check_bytes(world_await_result(busy, 2, 0), &mesh.input);
}

/* Among requests of one connection the highest priority decides. */
static void test_a_shared_build_has_the_highest_priority(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    world_hold_builds(&world);
    for (int priority = PRIORITY_LOW; priority <= PRIORITY_HIGH; priority++) {
        uint64_t request = (uint64_t)(priority + 2);
        struct control_build build = {.priority = priority, .item_count = 1, .items = &item};
        world_build(client, request, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
        world_await_state(client, request, 0, ITEM_JOINED);
        assert_int_equal(flight_priority(&session_find(client->session, 1)->items[0].waiter), priority);
    }
    world_release_builds(&world);
    world_settle(&world);
    assert_int_equal(world_counters(&world).builds_started, 1);
}

/* A small request does not have to wait for all large requests of another client. */
static void test_waiting_for_memory_is_fair(void **state)
{
    (void)state;
    struct world_mesh meshes[12];
    world_restart(&world, 16 << 20);
    struct world_client *greedy = world_join(&world), *modest = world_join(&world);
    greedy->hold = true;
    for (uint32_t i = 0; i < 12; i++) {
        world_mesh_init(&meshes[i], 40000, i);
        ask(greedy, i + 1, &meshes[i]);
    }
    world_build_mesh(modest, 1, &mesh);
    world_check_bytes(world_await_result(modest, 1, 0), &mesh.input);
    uint32_t done = 0;
    for (uint32_t i = 0; i < 12; i++)
        done += world_result(greedy, i + 1, 0) != NULL;
    assert_true(done < 8);
    greedy->hold = false;
    world_settle(&world);
    for (uint32_t i = 0; i < 12; i++) {
        assert_int_equal(world_status(greedy, i + 1, 0), BVHD_OK);
        world_mesh_finish(&meshes[i]);
    }
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_equal_items_are_built_once),
        TEST(test_waiters_need_no_cache),
        TEST(test_the_starter_cancels_early),
        TEST(test_the_starter_dies_early),
        TEST(test_the_other_cancels_early),
        TEST(test_the_other_dies_early),
        TEST(test_the_starter_cancels_late),
        TEST(test_the_starter_dies_late),
        TEST(test_one_dies_while_both_prepare),
        TEST(test_a_cancelled_build_is_not_inherited),
        TEST(test_a_withdrawn_build_is_not_inherited),
        TEST(test_get_joins_a_build),
        TEST(test_get_can_be_cancelled),
        TEST(test_builds_do_not_push_each_other_over),
        TEST(test_a_shortage_beside_others_is_tried_again),
        TEST(test_a_shortage_alone_is_an_error_and_not_kept),
        TEST(test_what_is_admitted_can_be_built),
        TEST(test_a_build_is_tried_again_when_it_is_alone),
        TEST(test_a_shared_build_has_the_earliest_turn),
        TEST(test_a_shared_build_has_the_highest_priority),
        TEST(test_waiting_for_memory_is_fair),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

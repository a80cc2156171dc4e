/* SPDX-License-Identifier: Apache-2.0 */
/* test_session_clients.c - tests the list of clients: what each client holds, and who may see whom. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "daemon/session/management.h"
#include "tests/support/daemon/session_world.h"

enum { OTHER = 1, THIRD = 2, POOL = 1 << 20 };

static struct session_world world;

static int set_up(void **state)
{
    (void)state;
    world_init(&world, NULL);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

/* Adds a client of a user who is not root, and who differs from the one that the test runs as by `offset`. */
static struct world_client *join(unsigned offset)
{
    return world_join_as(&world, geteuid() + offset);
}

static void ask(struct world_client *client, uint64_t request, bool all)
{
    struct control_clients message = {all};
    struct frame frame = {.header = {.type = FRAME_CLIENTS, .request = request}};
    assert_int_equal(control_pack_clients(&message, &client->memory, &frame.control, NULL), BVHD_OK);
    assert_int_equal(world_send(client, &frame, NULL), BVHD_OK);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
}

static const struct control_client_list *list(struct world_client *client, uint64_t request)
{
    ask(client, request, false);
    const struct world_event *event = world_find(client, FRAME_CLIENT_LIST, request, 0);
    assert_non_null(event);
    return event->clients;
}

static void the_owner_sees_everybody(void **state)
{
    (void)state;
    struct world_client *owner = join(0);
    join(OTHER);
    join(THIRD);
    const struct control_client_list *clients = list(owner, 1);
    assert_int_equal(clients->total, 3);
    assert_int_equal(clients->hidden, 0);
    assert_int_equal(clients->count, 3);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(clients->clients[i].uid, geteuid() + THIRD - i); /* the newest first */
    ask(owner, 2, true);
    assert_int_equal(world_find(owner, FRAME_CLIENT_LIST, 2, 0)->clients->count, 3);
}

static void root_sees_everybody(void **state)
{
    (void)state;
    struct world_client *root = world_join_as(&world, 0);
    join(OTHER);
    ask(root, 1, true);
    assert_int_equal(world_find(root, FRAME_CLIENT_LIST, 1, 0)->clients->count, 2);
}

static void others_see_themselves_alone(void **state)
{
    (void)state;
    struct world_client *one = join(OTHER), *two = join(THIRD);
    join(0);
    join(OTHER);
    const struct control_client_list *clients = list(one, 1);
    assert_int_equal(clients->total, 4);
    assert_int_equal(clients->hidden, 2);
    assert_int_equal(clients->count, 2);
    for (uint32_t i = 0; i < 2; i++)
        assert_int_equal(clients->clients[i].uid, geteuid() + OTHER);
    assert_int_equal(list(two, 1)->count, 1);
}

static void who_may_not_see_all_is_refused_by_name(void **state)
{
    (void)state;
    struct world_client *client = join(OTHER);
    char rule[64];
    ask(client, 1, true);
    const struct bvhd_error *error = world_find(client, FRAME_ERROR, 1, 0)->error;
    assert_int_equal(error->status, BVHD_UNSUPPORTED);
    assert_string_equal(error->where, "clients");
    snprintf(rule, sizeof rule, "only root and the user whom the daemon runs as (uid %u)", (unsigned)geteuid());
    assert_non_null(strstr(error->text, rule));
    assert_null(world_find(client, FRAME_CLIENT_LIST, 1, 0));
    assert_int_equal(list(client, 2)->count, 1);
}

static void rows_say_what_a_client_holds(void **state)
{
    (void)state;
    struct world_client *owner = join(0), *busy = join(OTHER);
    static const unsigned char zeros[POOL];
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    world_pool(busy, 1, world_memfd(zeros, POOL, WORLD_SEALS_POOL), POOL);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_build_mesh(busy, 7, &mesh);
    const struct control_client *row = &list(owner, 1)->clients[0];
    assert_int_equal(row->uid, geteuid() + OTHER);
    assert_int_equal(row->pid, 4711);
    assert_string_equal(row->software, "a test");
    assert_int_equal(row->pool_bytes, POOL);
    assert_int_equal(row->requests, 1);
    assert_int_equal(row->items, 1);
    assert_true(row->memory_bytes > 0);
    assert_int_equal(row->threads, 0);
    busy->hold = true;
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    uint64_t size = world_await_result(busy, 7, 0)->result->size;
    row = &list(owner, 2)->clients[0];
    assert_int_equal(row->result_bytes, size);
    assert_int_equal(row->memory_bytes, 0);
    assert_int_equal(row->requests, 0);
    assert_int_equal(row->items, 1); /* until its result has left */
    busy->hold = false;
    world_settle(&world);
    row = &list(owner, 3)->clients[0];
    assert_int_equal(row->result_bytes + row->items, 0);
    world_mesh_finish(&mesh);
}

static void a_list_needs_no_descriptors_and_a_whole_message(void **state)
{
    (void)state;
    struct world_client *client = join(0);
    struct bvhd_error error;
    struct frame broken = {.header = {.type = FRAME_CLIENTS, .request = 3, .control_size = 1},
                           .control = {(const unsigned char *)"\xff", 1}};
    assert_int_equal(world_send(client, &broken, &error), BVHD_CORRUPT);
    struct frame carrying = {.header = {.type = FRAME_CLIENTS, .request = 4, .descriptors = 1},
                             .descriptors = {dup(STDIN_FILENO)}};
    assert_int_equal(world_send(client, &carrying, &error), BVHD_INVALID);
    assert_string_equal(error.where, "frame.descriptors");
}

/* Each allocation fails once: the client gets its list, or its connection ends. */
static void without_memory_the_connection_ends(void **state)
{
    (void)state;
    struct memory *memory = service_frame_memory(world.service);
    struct control_clients message = {true};
    bool answered = false;
    int failures = 0;
    for (; !answered; failures++) {
        struct world_client *client = join(0);
        struct frame frame = {.header = {.type = FRAME_CLIENTS, .request = 1}};
        assert_int_equal(control_pack_clients(&message, &client->memory, &frame.control, NULL), BVHD_OK);
        atomic_store(&memory->fail_after, failures);
        enum bvhd_status status = world_send(client, &frame, NULL);
        atomic_store(&memory->fail_after, -1);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        answered = world_find(client, FRAME_CLIENT_LIST, 1, 0) != NULL;
        assert_true(answered != client->failed);
        memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
        world_leave(client);
    }
    assert_true(failures > 4);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(the_owner_sees_everybody),
        TEST(root_sees_everybody),
        TEST(others_see_themselves_alone),
        TEST(who_may_not_see_all_is_refused_by_name),
        TEST(rows_say_what_a_client_holds),
        TEST(without_memory_the_connection_ends),
        TEST(a_list_needs_no_descriptors_and_a_whole_message),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

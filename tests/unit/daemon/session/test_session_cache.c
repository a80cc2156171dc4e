/* SPDX-License-Identifier: Apache-2.0 */
/* test_session_cache.c - tests FRAME_CACHE: what the caches hold, trim and clear, and who may ask for these. */
#include "tests/support/unit.h"

#include "tests/support/daemon/session_world.h"
#include "tests/support/scratch.h"

enum { OTHER = 1, MESHES = 6 };

static struct session_world world;
static char directory[128];
static struct world_client *owner;

static void begin(bool has_disk)
{
    static int count;
    struct service_options options = world_options();
    snprintf(directory, sizeof directory, "%s/%d", scratch_folder, count++);
    options.disk_directory = has_disk ? directory : NULL;
    options.disk_budget = 64 << 20;
    world_init(&world, &options);
    owner = world_join_as(&world, geteuid());
}

static int set_up(void **state)
{
    (void)state;
    begin(true);
    return 0;
}

static int set_up_without_disk(void **state)
{
    (void)state;
    begin(false);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

static bool are_written(void *context)
{
    const uint32_t *count = context;
    return world_counters(&world).disk_written == *count;
}

static void build_without_waiting(uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        struct world_mesh mesh;
        world_mesh_init(&mesh, 100, i);
        world_build_mesh(owner, 100 + i, &mesh);
        world_await_result(owner, 100 + i, 0);
        world_mesh_finish(&mesh);
    }
}

/* Builds `count` meshes, and waits until they are on disk if there is one. */
static void build_meshes(uint32_t count)
{
    build_without_waiting(count);
    if (world.service->disk)
        world_await(&world, are_written, &count);
}

static void send_cache(struct world_client *client, uint64_t request, uint32_t action, uint64_t bytes)
{
    const struct control_cache message = {action, bytes};
    struct frame frame = {.header = {.type = FRAME_CACHE, .request = request}};
    assert_int_equal(control_pack_cache(&message, &client->memory, &frame.control, NULL), BVHD_OK);
    assert_int_equal(world_send(client, &frame, NULL), BVHD_OK);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
}

struct awaited {
    struct world_client *client;
    uint64_t request;
};

static bool is_answered(void *context)
{
    const struct awaited *awaited = context;
    return world_find(awaited->client, FRAME_CACHE_STATE, awaited->request, 0) ||
           world_find(awaited->client, FRAME_ERROR, awaited->request, 0);
}

static const struct control_cache_state *await_state(struct world_client *client, uint64_t request)
{
    struct awaited awaited = {client, request};
    world_await(&world, is_answered, &awaited);
    const struct world_event *event = world_find(client, FRAME_CACHE_STATE, request, 0);
    assert_non_null(event);
    return event->cache;
}

static void anybody_may_look(void **state)
{
    (void)state;
    build_meshes(3);
    struct world_client *other = world_join_as(&world, geteuid() + OTHER);
    send_cache(other, 1, CACHE_SHOW, 0);
    const struct control_cache_state *shown = await_state(other, 1);
    assert_non_null(strstr(shown->directory, directory));
    assert_int_equal(*shown->directory, '/');
    assert_int_equal(shown->entries, 3);
    assert_true(shown->bytes >= 3 * 4096);
    assert_int_equal(shown->budget, 64 << 20);
    assert_int_equal(shown->memory_entries, 3);
    assert_true(shown->memory_bytes > 0);
    assert_int_equal(shown->memory_budget, 64 << 20);
}

static void trim_leaves_what_was_used_last(void **state)
{
    (void)state;
    build_meshes(MESHES);
    send_cache(owner, 1, CACHE_SHOW, 0);
    uint64_t all = await_state(owner, 1)->bytes;
    send_cache(owner, 2, CACHE_TRIM, all / 2);
    const struct control_cache_state *left = await_state(owner, 2);
    assert_int_equal(left->entries, MESHES / 2);
    assert_true(left->bytes <= all / 2);
    assert_int_equal(left->memory_entries, MESHES);
    assert_int_equal(world_counters(&world).disk_evicted, MESHES / 2);
}

static bool is_memory_empty(void *context)
{
    (void)context;
    return world_counters(&world).cache_entries == 0;
}

/* After a clear the same is built again. */
static void clear_forgets_everything(void **state)
{
    (void)state;
    build_meshes(MESHES);
    send_cache(owner, 1, CACHE_CLEAR, 0);
    const struct control_cache_state *left = await_state(owner, 1);
    assert_int_equal(left->entries, 0);
    assert_int_equal(left->bytes, 0);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 0);
    world_build_mesh(owner, 2, &mesh);
    assert_int_equal(world_await_result(owner, 2, 0)->result->origin, ORIGIN_BUILT);
    world_mesh_finish(&mesh);
    send_cache(owner, 3, CACHE_CLEAR, 0);
    await_state(owner, 3);
    world_await(&world, is_memory_empty, NULL);
}

/* Results that still wait to be written do not come after a clear. */
static void clear_waits_for_the_writer(void **state)
{
    (void)state;
    build_without_waiting(MESHES);
    send_cache(owner, 1, CACHE_CLEAR, 0);
    assert_int_equal(await_state(owner, 1)->entries, 0);
    assert_int_equal(world_counters(&world).disk_written, MESHES);
}

static void expect_refusal(const struct world_client *client, uint64_t request, const char *text)
{
    const struct world_event *event = world_find(client, FRAME_ERROR, request, 0);
    assert_non_null(event);
    assert_int_equal(event->error->status, BVHD_UNSUPPORTED);
    assert_string_equal(event->error->where, "cache.action");
    assert_non_null(strstr(event->error->text, text));
}

static void others_may_not_change_anything(void **state)
{
    (void)state;
    build_meshes(1);
    struct world_client *other = world_join_as(&world, geteuid() + OTHER), *root = world_join_as(&world, 0);
    send_cache(other, 1, CACHE_TRIM, 0);
    expect_refusal(other, 1, "only root");
    send_cache(other, 2, CACHE_CLEAR, 0);
    expect_refusal(other, 2, "only root");
    send_cache(owner, 1, CACHE_SHOW, 0);
    assert_int_equal(await_state(owner, 1)->entries, 1);
    send_cache(root, 1, CACHE_CLEAR, 0);
    assert_int_equal(await_state(root, 1)->entries, 0);
}

static void unknown_actions_are_unsupported(void **state)
{
    (void)state;
    send_cache(owner, 1, CACHE_CLEAR + 1, 0);
    expect_refusal(owner, 1, "not known");
    send_cache(owner, 2, UINT32_MAX, 0);
    expect_refusal(owner, 2, "not known");
}

/* While a worker trims, the connection gets BUSY for another one; one that leaves is not answered. */
static void one_at_a_time(void **state)
{
    (void)state;
    build_meshes(1);
    struct world_client *leaving = world_join_as(&world, 0);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    send_cache(owner, 1, CACHE_TRIM, 0);
    send_cache(owner, 2, CACHE_CLEAR, 0);
    assert_non_null(world_find(owner, FRAME_BUSY, 2, 0));
    send_cache(owner, 3, CACHE_SHOW, 0);
    assert_int_equal(await_state(owner, 3)->entries, 1);
    send_cache(leaving, 1, CACHE_TRIM, 0);
    assert_int_equal(world.service->cache_tasks, 2);
    world_leave(leaving);
    world_open(gates[0]);
    world_open(gates[1]);
    assert_int_equal(await_state(owner, 1)->entries, 0);
    send_cache(owner, 4, CACHE_CLEAR, 0);
    await_state(owner, 4);
}

static void without_a_disk_there_is_memory(void **state)
{
    (void)state;
    build_meshes(2);
    send_cache(owner, 1, CACHE_SHOW, 0);
    const struct control_cache_state *shown = await_state(owner, 1);
    assert_string_equal(shown->directory, "");
    assert_int_equal(shown->budget, 0);
    assert_int_equal(shown->memory_entries, 2);
    send_cache(owner, 2, CACHE_TRIM, 0);
    expect_refusal(owner, 2, "nothing on disk");
    send_cache(owner, 3, CACHE_CLEAR, 0);
    await_state(owner, 3);
    world_await(&world, is_memory_empty, NULL);
}

static void broken_messages_break_the_connection(void **state)
{
    (void)state;
    static const unsigned char garbage[] = {0xff, 0xff, 0xff};
    const struct frame frame = {.header = {.type = FRAME_CACHE, .request = 1, .control_size = sizeof garbage},
                                .control = {garbage, sizeof garbage}};
    assert_int_equal(world_send(owner, &frame, NULL), BVHD_CORRUPT);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(anybody_may_look),
        TEST(trim_leaves_what_was_used_last),
        TEST(clear_forgets_everything),
        TEST(clear_waits_for_the_writer),
        TEST(others_may_not_change_anything),
        TEST(unknown_actions_are_unsupported),
        TEST(one_at_a_time),
        cmocka_unit_test_setup_teardown(without_a_disk_there_is_memory, set_up_without_disk, tear_down),
        TEST(broken_messages_break_the_connection),
    };
    return cmocka_run_group_tests_name("session_cache", tests, scratch_make, scratch_remove);
}

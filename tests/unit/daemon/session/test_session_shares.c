/* SPDX-License-Identifier: Apache-2.0 */
/* test_session_shares.c - tests RELEASED, deadlines, unread answers, and unfinished frames. */
#include "tests/support/unit.h"

#include "tests/support/daemon/session_world.h"

enum { MEMORY = 64 << 20 };

static struct session_world world;
static struct world_mesh large; /* its result comes in a descriptor */

static int set_up(void **state)
{
    (void)state;
    struct service_options options = world_options();
    options.memory = MEMORY;
    world_init(&world, &options);
    world_mesh_init(&large, 3000, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    world_mesh_finish(&large);
    return 0;
}

static struct world_client *join_releasing(uint32_t uid)
{
    struct world_client *client = world_join_as(&world, uid);
    client->session->releases = true;
    return client;
}

static enum bvhd_status say_hello(struct world_client *client, bool releases)
{
    struct control_hello hello = {CONTROL_VERSION, CONTROL_VERSION, "a test", 0, releases};
    struct frame frame = {.header = {.type = FRAME_HELLO}};
    assert_int_equal(control_pack_hello(&hello, &client->memory, &frame.control, NULL), BVHD_OK);
    frame.header.control_size = (uint32_t)frame.control.size;
    enum bvhd_status status = world_send(client, &frame, NULL);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    return status;
}

static enum bvhd_status release(struct world_client *client, uint64_t bytes)
{
    struct control_released message = {bytes};
    struct frame frame = {.header = {.type = FRAME_RELEASED}};
    assert_int_equal(control_pack_released(&message, &client->memory, &frame.control, NULL), BVHD_OK);
    frame.header.control_size = (uint32_t)frame.control.size;
    enum bvhd_status status = world_send(client, &frame, NULL);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    return status;
}

static uint64_t build_large(struct world_client *client, uint64_t request)
{
    struct control_item item = world_item(&large.input, large.size, SOURCE_MEMFD, 0);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {large.size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(large.payload, large.size, WORLD_SEALS_ONCE);
    world_build(client, request, &build, (struct bytes){0}, &descriptor);
    uint64_t size = world_await_result(client, request, 0)->result->size;
    world_iterate(&world);
    assert_true(size > BLOB_INLINE_MAX);
    return size;
}

static void results_are_charged_until_they_are_released(void **state)
{
    (void)state;
    struct world_client *reader = world_join_as(&world, 1), *holder = join_releasing(2);
    uint64_t size = build_large(reader, 1);
    assert_int_equal(session_uses(reader->session, SHARE_RESULTS), 0); /* it has read it */
    build_large(holder, 1);
    build_large(holder, 2);
    assert_int_equal(session_uses(holder->session, SHARE_RESULTS), 2 * size);
    assert_int_equal(world_counters(&world).results_held_bytes, 2 * size);
    assert_int_equal(release(holder, size), BVHD_OK);
    assert_int_equal(session_uses(holder->session, SHARE_RESULTS), size);
    assert_int_equal(release(holder, size), BVHD_OK);
    assert_int_equal(session_uses(holder->session, SHARE_AHEAD), 0);
    build_large(holder, 3);
    world_leave(holder); /* nobody can tell any more what it holds */
    assert_int_equal(service_uses(world.service, SHARE_RESULTS), 0);
}

static void more_than_is_held_cannot_be_released(void **state)
{
    (void)state;
    struct world_client *reader = world_join_as(&world, 1), *holder = join_releasing(2);
    uint64_t size = build_large(holder, 1);
    assert_int_equal(release(holder, size + 1), BVHD_INVALID);
    assert_int_equal(session_uses(holder->session, SHARE_RESULTS), size);
    build_large(reader, 1);
    assert_int_equal(release(reader, 1), BVHD_INVALID);
}

/* Whatever the connections of a user hold, as far as they were told that they may, leaves room for the user. */
static void what_clients_may_hold_leaves_room(void **state)
{
    (void)state;
    enum { CLIENTS = 14 };
    uint64_t sum = 0, room = 0;
    for (uint64_t i = 0; i < CLIENTS; i++) {
        struct world_client *client = world_join_silent(&world);
        assert_int_equal(say_hello(client, true), BVHD_OK);
        uint64_t held = world_find(client, FRAME_WELCOME, 0, 0)->welcome->max_held;
        room = share_room(&client->session->client.member.user->share, SHARE_RESULTS);
        assert_true(held > 0 && held <= room / 8 + 1);
        sum += held;
        assert_true(sum < room);
    }
    world_leave(&world.clients[0]);
    struct world_client *plain = world_join_silent(&world);
    assert_int_equal(say_hello(plain, false), BVHD_OK);
    assert_int_equal(world_find(plain, FRAME_WELCOME, 0, 0)->welcome->max_held, 0);
    assert_true(plain->session->client.member.user->promised < sum);
}

/* Items that wait for memory, and one that has its result, when the deadline of their requests passes. */
static void late_items_are_cancelled(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 50, 7);
    struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = 1, .items = &item, .deadline_ms = 60000};
    struct bytes bytes = {mesh.payload, mesh.size};
    world_build(client, 1, &build, bytes, NULL);
    world_await_result(client, 1, 0);
    world_settle(&world);
    assert_false(service_has_deadlines(world.service));
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_give(&world.service->admission.prepares[class], MEMORY);
    world_build(client, 2, &build, bytes, NULL);
    build.deadline_ms = 0;
    world_build(client, 3, &build, bytes, NULL);
    assert_true(service_has_deadlines(world.service));
    uint64_t deadline = session_find(client->session, 2)->deadline_ns;
    session_check_deadlines(client->session, deadline - 1);
    assert_null(world_result(client, 2, 0));
    session_check_deadlines(client->session, deadline);
    world_iterate(&world);
    assert_int_equal(world_status(client, 2, 0), BVHD_CANCELLED);
    assert_string_equal(world_result(client, 2, 0)->result->error.where, "deadline");
    assert_int_equal(world_prepared(client, 2, 0), 1);
    assert_null(world_result(client, 3, 0));
    assert_false(service_has_deadlines(world.service));
    session_check_deadlines(client->session, UINT64_MAX);
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_end(&world.service->admission.prepares[class], MEMORY);
    service_collect(world.service);
    assert_int_equal(world_await_result(client, 3, 0)->result->error.status, BVHD_OK);
    world_mesh_finish(&mesh);
}

static void a_session_with_deadlines_can_end(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct control_item item = world_item(&large.input, large.size, SOURCE_MEMFD, 0);
    struct control_build build = {
        .memfd_count = 1, .memfd_sizes = {large.size}, .item_count = 1, .items = &item, .deadline_ms = 1};
    int descriptor = world_memfd(large.payload, large.size, WORLD_SEALS_ONCE);
    world_build(client, 1, &build, (struct bytes){0}, &descriptor);
    world_leave(client); /* while its item is with a worker */
    world_open(gates[0]);
    world_open(gates[1]);
    world_settle(&world);
    while (service_has_deadlines(world.service))
        world_iterate(&world);
}

/* Answers that a client does not read count in its user's share; one that has read all of them is always heard. */
static void unread_answers_have_a_share(void **state)
{
    (void)state;
    struct world_client *silent = world_join_as(&world, 1), *same = world_join_as(&world, 1),
                        *other = world_join_as(&world, 2);
    silent->hold = true;
    for (uint64_t i = 1; !session_is_talkative(silent->session); i++) {
        assert_int_equal(world_say(silent, FRAME_STATS, i, NULL), BVHD_OK);
        assert_true(service_uses(world.service, SHARE_REPLIES) < MEMORY / 16);
    }
    assert_false(session_is_talkative(same->session));
    assert_false(session_is_talkative(other->session));
    silent->hold = false;
    world_iterate(&world);
    assert_int_equal(service_uses(world.service, SHARE_REPLIES), 0);
    assert_false(session_is_talkative(silent->session));
}

/* Returns how many of the user's connections may each have an unfinished frame of the largest size. */
static uint32_t begin_frames(struct world_client **clients, uint32_t count, uint64_t size)
{
    uint32_t begun = 0;
    while (begun < count && session_set_frame(clients[begun]->session, size))
        begun++;
    for (uint32_t i = begun; i < count; i++)
        assert_false(session_set_frame(clients[i]->session, size));
    return begun;
}

/* The buffers of unfinished frames have a share, and one user's frames never keep another user from having one. */
static void unfinished_frames_have_a_share(void **state)
{
    enum { WHOLE = FRAME_HEADER_SIZE + FRAME_MAX_CONTROL + FRAME_MAX_INLINE, EACH = 7 };
    struct world_client *greedy[EACH], *others[EACH], *modest;
    (void)state;
    for (int i = 0; i < EACH; i++) {
        greedy[i] = world_join_as(&world, 1);
        others[i] = world_join_as(&world, 2);
    }
    uint32_t first = begin_frames(greedy, EACH, WHOLE), second = begin_frames(others, EACH, WHOLE);
    assert_in_range(first, 3, EACH - 2);
    assert_in_range(second, 1, 3);
    assert_in_range((first + second) * (uint64_t)WHOLE, 1, MEMORY / 8);
    assert_true(session_set_frame(greedy[first]->session, FRAME_KEEP));
    modest = world_join_as(&world, 3);
    assert_true(session_set_frame(modest->session, WHOLE)); /* the first of its user, whatever others have */
    assert_int_equal(service_uses(world.service, SHARE_FRAMES), (first + second + 1) * (uint64_t)WHOLE);
    assert_true(session_set_frame(greedy[0]->session, FRAME_KEEP)); /* its frame is complete */
    assert_int_equal(session_uses(greedy[0]->session, SHARE_FRAMES), 0);
    world_leave(greedy[1]);
    world_leave(greedy[2]);
    world_leave(others[0]);
    assert_true(session_set_frame(greedy[first]->session, WHOLE));
    assert_int_equal(service_uses(world.service, SHARE_FRAMES), (first + second - 2) * (uint64_t)WHOLE);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(results_are_charged_until_they_are_released),
        TEST(more_than_is_held_cannot_be_released),
        TEST(what_clients_may_hold_leaves_room),
        TEST(late_items_are_cancelled),
        TEST(a_session_with_deadlines_can_end),
        TEST(unread_answers_have_a_share),
        TEST(unfinished_frames_have_a_share),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

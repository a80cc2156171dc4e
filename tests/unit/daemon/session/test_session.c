/* SPDX-License-Identifier: Apache-2.0 */
/* test_session.c - tests the frames of a session: versions, errors, pools, credits, queues, draining, progress. */
#include "tests/support/unit.h"

#include <sched.h>

#include "tests/support/daemon/session_world.h"
#include "tests/support/open_descriptors.h"

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

/* ---- the start of a connection ---- */

static enum bvhd_status say_hello(struct world_client *client, uint32_t least, uint32_t most, struct bvhd_error *error)
{
    struct control_hello hello = {least, most, "versions", 0, false};
    struct frame frame = {.header = {.type = FRAME_HELLO, .request = 5}};
    assert_int_equal(control_pack_hello(&hello, &client->memory, &frame.control, NULL), BVHD_OK);
    enum bvhd_status status = world_send(client, &frame, error);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    return status;
}

static void test_hello_is_answered_with_limits(void **state)
{
    (void)state;
    struct world_client *client = world_join_silent(&world);
    assert_false(session_is_open(client->session));
    assert_int_equal(say_hello(client, 0, 7, NULL), BVHD_OK);
    assert_true(session_is_open(client->session));
    const struct world_event *event = world_find(client, FRAME_WELCOME, 5, 0);
    assert_non_null(event);
    assert_int_equal(event->welcome->version, CONTROL_VERSION);
    assert_int_equal(event->welcome->credits, 64);
    assert_int_equal(event->welcome->max_items, 64);
    assert_int_equal(event->welcome->max_pool, 4 << 20);
    assert_int_equal(event->welcome->max_payload, 256 << 20);
    assert_int_equal(event->welcome->max_inline, FRAME_MAX_INLINE);
}

static void test_other_versions_are_incompatible(void **state)
{
    (void)state;
    static const uint32_t ranges[][2] = {{CONTROL_VERSION + 1, 9}, {0, 0}, {CONTROL_VERSION + 1, CONTROL_VERSION - 1}};
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        struct world_client *client = world_join_silent(&world);
        struct bvhd_error error;
        char range[32];
        assert_int_equal(say_hello(client, ranges[i][0], ranges[i][1], &error), BVHD_INCOMPATIBLE);
        snprintf(range, sizeof range, "%u to %u", ranges[i][0], ranges[i][1]);
        assert_non_null(strstr(error.text, range));
        snprintf(range, sizeof range, "%d to %d", CONTROL_VERSION, CONTROL_VERSION);
        assert_non_null(strstr(error.text, range));
        assert_false(session_is_open(client->session));
        assert_int_equal(client->event_count, 0);
    }
}

static void test_nothing_comes_before_hello(void **state)
{
    (void)state;
    static const enum frame_type types[] = {FRAME_POOL,  FRAME_BUILD, FRAME_GET,          FRAME_CANCEL,
                                            FRAME_STATS, FRAME_PING,  (enum frame_type)40};
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        struct world_client *client = world_join_silent(&world);
        struct bvhd_error error;
        assert_int_equal(world_say(client, types[i], 1, &error), BVHD_INVALID);
        assert_string_equal(error.where, "frame.type");
        assert_int_equal(client->event_count, 0);
    }
}

/* ---- errors that end a connection ---- */

static enum bvhd_status send_bare(struct world_client *client, enum frame_type type, uint64_t request,
                                  uint32_t descriptors, struct bytes control)
{
    struct frame frame = {.header = {.type = (uint16_t)type, .request = request, .descriptors = (uint8_t)descriptors},
                          .control = control};
    for (uint32_t i = 0; i < descriptors; i++)
        frame.descriptors[i] = world_memfd("x", 1, WORLD_SEALS_ONCE);
    return world_send(client, &frame, NULL);
}

static void test_broken_frames_end_the_connection(void **state)
{
    (void)state;
    static const struct {
        enum frame_type type;
        uint64_t request;
        uint32_t descriptors;
        const char *control;
    } broken[] = {
        {FRAME_HELLO, 0, 0, ""},    {FRAME_PING, 0, 0, ""},   {FRAME_PING, 1, 1, ""},     {FRAME_STATS, 1, 2, ""},
        {FRAME_GET, 1, 1, ""},      {FRAME_CANCEL, 1, 4, ""}, {FRAME_POOL, 1, 0, ""},     {FRAME_POOL, 1, 2, ""},
        {FRAME_BUILD, 1, 1, ""},    {FRAME_BUILD, 0, 2, ""},  {FRAME_GET, 1, 0, "\n"},    {FRAME_BUILD, 1, 3, "\xff"},
        {FRAME_POOL, 1, 1, "\xff"}, {FRAME_HELLO, 1, 2, ""},  {FRAME_CANCEL, 1, 0, "\n"},
    };
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        struct world_client *client = world_join(&world);
        uint32_t before = client->event_count;
        int descriptors = open_descriptors();
        struct bytes control = {(const unsigned char *)broken[i].control, strlen(broken[i].control)};
        assert_int_not_equal(send_bare(client, broken[i].type, broken[i].request, broken[i].descriptors, control),
                             BVHD_OK);
        assert_int_equal(client->event_count, before);
        world_await_descriptors(descriptors);
        world_leave(client);
        world.client_count--;
        for (uint32_t k = 0; k < client->event_count; k++)
            memory_free(&client->memory, client->events[k].welcome);
        free(client->events);
    }
    assert_int_equal(world_counters(&world).protocol_errors, sizeof broken / sizeof *broken);
}

static void test_a_number_in_use_ends_the_connection(void **state)
{
    (void)state;
    struct world_mesh mesh;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct bvhd_error error;
    world_mesh_init(&mesh, 50, 1);
    world_build_mesh(client, 8, &mesh);
    assert_int_equal(world_say(client, FRAME_GET, 8, &error), BVHD_INVALID);
    assert_string_equal(error.where, "frame.request");
    world_open(gates[0]);
    world_open(gates[1]);
    world_mesh_finish(&mesh);
}

/* ---- requests that are answered with an error ---- */

static void test_unknown_types_are_unsupported(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    int descriptors = open_descriptors();
    assert_int_equal(send_bare(client, (enum frame_type)40, 3, 2, (struct bytes){(const unsigned char *)"hello", 5}),
                     BVHD_OK);
    assert_int_equal(send_bare(client, FRAME_RESULT, 4, 0, (struct bytes){0}), BVHD_OK);
    assert_int_equal(world_find(client, FRAME_ERROR, 3, 0)->error->status, BVHD_UNSUPPORTED);
    assert_int_equal(world_find(client, FRAME_ERROR, 4, 0)->error->status, BVHD_UNSUPPORTED);
    world_await_descriptors(descriptors);
    assert_int_equal(world_say(client, FRAME_PING, 5, NULL), BVHD_OK);
    assert_non_null(world_find(client, FRAME_PONG, 5, 0));
}

/* Rows of items are longer, with a field that this version does not know. */
static void test_rows_of_later_versions_are_unsupported(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    unsigned char control[180] = {0x18, 0xa4, 1, 0x22, 0xa4, 1}; /* item_size and items: 164 (PROTOCOL.md) */
    struct bytes bytes = {control, 6 + 164};
    control[6] = 1;
    assert_int_equal(send_bare(client, FRAME_BUILD, 1, 0, bytes), BVHD_OK);
    assert_null(world_find(client, FRAME_ERROR, 1, 0));
    control[6 + 162] = 1;
    int descriptors = open_descriptors();
    assert_int_equal(send_bare(client, FRAME_BUILD, 2, 0, bytes), BVHD_OK);
    assert_int_equal(world_find(client, FRAME_ERROR, 2, 0)->error->status, BVHD_UNSUPPORTED);
    assert_int_equal(send_bare(client, FRAME_BUILD, 3, 2, bytes), BVHD_OK);
    assert_int_equal(world_find(client, FRAME_ERROR, 3, 0)->error->status, BVHD_UNSUPPORTED);
    world_await_descriptors(descriptors);
    world_settle(&world);
}

/* Rows of items are shorter, from clients that know no native targets. */
static void test_rows_of_earlier_versions_are_taken(void **state)
{
    (void)state;
    struct world_mesh mesh;
    struct world_client *client = world_join(&world);
    unsigned char control[4 + 80] = {0x18, 80, 0x22, 80};
    unsigned char *row = control + 4;
    world_mesh_init(&mesh, 20, 1);
    bytes_put32(row, STRUCTURE_BOTTOM);
    bytes_put32(row + 16, TARGET_PORTABLE);
    bytes_put32(row + 24, 1);
    bytes_put32(row + 28, ROWS_GEOMETRY_LEAST);
    bytes_put64(row + 72, mesh.size);
    struct frame frame = {.header = {.type = FRAME_BUILD,
                                     .request = 1,
                                     .control_size = sizeof control,
                                     .inline_size = (uint32_t)mesh.size},
                          .control = {control, sizeof control},
                          .inline_bytes = {mesh.payload, mesh.size}};
    assert_int_equal(world_send(client, &frame, NULL), BVHD_OK);
    world_settle(&world);
    world_check_bytes(world_result(client, 1, 0), &mesh.input);
    world_mesh_finish(&mesh);
}

static void test_requests_without_items_are_refused(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct control_build build = {0};
    world_build(client, 1, &build, (struct bytes){0}, NULL);
    world_get(client, 2, NULL, 0);
    assert_int_equal(world_find(client, FRAME_ERROR, 1, 0)->error->status, BVHD_INVALID);
    assert_int_equal(world_find(client, FRAME_ERROR, 2, 0)->error->status, BVHD_INVALID);
}

static void test_stats_name_every_counter(void **state)
{
    (void)state;
    static const char *const wanted[] = {"builds_started", "builds_done",       "hits_memory", "hits_disk",
                                         "misses",         "coalesced",         "refused",     "cancelled",
                                         "queue_depth",    "live_result_bytes", "connections"};
    struct world_client *client = world_join(&world);
    service_count_connections(world.service, 3);
    assert_int_equal(world_say(client, FRAME_STATS, 9, NULL), BVHD_OK);
    const struct control_counters *counters = world_find(client, FRAME_COUNTERS, 9, 0)->counters;
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        uint32_t k = 0;
        while (k < counters->count && strcmp(counters->counters[k].name, wanted[i]) != 0)
            k++;
        assert_true(k < counters->count);
        if (strcmp(wanted[i], "connections") == 0)
            assert_int_equal(counters->counters[k].value, 3);
    }
}

static void test_goodbye_is_said_once(void **state)
{
    struct bvhd_error reason;
    (void)state;
    bvhd_error_set(&reason, BVHD_UNAVAILABLE, "", "told to leave");
    struct world_client *client = world_join(&world), *silent = world_join_silent(&world);
    session_goodbye(client->session, &reason);
    session_goodbye(client->session, &reason);
    session_goodbye(silent->session, &reason);
    assert_non_null(world_find(client, FRAME_GOODBYE, 0, 0));
    assert_null(world_find(client, FRAME_GOODBYE, 0, 1));
    assert_true(session_is_idle(client->session));
    assert_false(session_is_idle(silent->session));
    assert_int_equal(session_siblings(client->session), 2);
    assert_int_equal(silent->event_count, 0);
}

static void test_a_draining_service_takes_nothing_new(void **state)
{
    (void)state;
    struct world_mesh mesh;
    struct world_client *client = world_join(&world);
    struct key key = {{1}};
    world_mesh_init(&mesh, 200, 3);
    world_build_mesh(client, 1, &mesh);
    service_drain(world.service);
    world_build_mesh(client, 2, &mesh);
    world_get(client, 3, &key, 1);
    world_pool(client, 4, world_memfd("0123456789abcdef", 16, WORLD_SEALS_POOL), 16);
    for (uint64_t request = 2; request <= 4; request++)
        assert_int_equal(world_find(client, FRAME_ERROR, request, 0)->error->status, BVHD_UNAVAILABLE);
    world_check_bytes(world_await_result(client, 1, 0), &mesh.input);
    world_settle(&world);
    assert_int_equal(service_pending(world.service), 0);
    assert_int_equal(world_say(client, FRAME_PING, 5, NULL), BVHD_OK);
    world_mesh_finish(&mesh);
}

/* ---- pools ---- */

static int pool_of(uint64_t size)
{
    unsigned char *bytes = calloc(1, size);
    int descriptor = world_memfd(bytes, size, WORLD_SEALS_POOL);
    free(bytes);
    return descriptor;
}

static void test_pools_are_replaced_when_nothing_needs_them(void **state)
{
    (void)state;
    struct world_mesh mesh;
    struct world_client *client = world_join(&world);
    world_mesh_init(&mesh, 300, 4);
    world_pool(client, 1, world_memfd(mesh.payload, mesh.size, WORLD_SEALS_POOL), mesh.size);
    assert_non_null(world_find(client, FRAME_DONE, 1, 0));
    assert_int_equal(world_counters(&world).pool_bytes, mesh.size);

    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_POOL, 0);
    struct control_build build = {.item_count = 1, .items = &item};
    world_build(client, 2, &build, (struct bytes){0}, NULL);
    world_pool(client, 3, pool_of(4096), 4096);
    assert_int_equal(world_find(client, FRAME_ERROR, 3, 0)->error->status, BVHD_INVALID);
    world_open(gates[0]);
    world_open(gates[1]);
    world_check_bytes(world_await_result(client, 2, 0), &mesh.input);
    world_settle(&world);
    assert_int_equal(world_prepared(client, 2, 0), 1);
    world_pool(client, 4, pool_of(4096), 4096);
    assert_non_null(world_find(client, FRAME_DONE, 4, 0));
    assert_int_equal(world_counters(&world).pool_bytes, 4096);
    world_mesh_finish(&mesh);
}

static void test_bad_pools_leave_the_old_one(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    world_pool(client, 1, pool_of(8192), 8192);
    world_pool(client, 2, world_memfd("no seals", 8, 0), 8);
    world_pool(client, 3, pool_of(4096), 4097);
    world_pool(client, 4, pool_of(4096), UINT64_C(1) << 40);
    assert_int_equal(world_find(client, FRAME_ERROR, 2, 0)->error->status, BVHD_INVALID);
    assert_int_equal(world_find(client, FRAME_ERROR, 3, 0)->error->status, BVHD_INVALID);
    assert_int_equal(world_find(client, FRAME_ERROR, 4, 0)->error->status, BVHD_TOO_LARGE);
    assert_int_equal(world_counters(&world).pool_bytes, 8192);
}

static void test_pools_together_have_a_limit(void **state)
{
    (void)state;
    world_restart(&world, 16 << 20);
    struct world_client *first = world_join_as(&world, 1), *second = world_join_as(&world, 1);
    struct world_client *other = world_join_as(&world, 2);
    world_pool(first, 1, pool_of(2 << 20), 2 << 20);
    world_pool(second, 1, pool_of(2 << 20), 2 << 20); /* of 3 MiB that the user may have */
    world_pool(other, 1, pool_of(1 << 20), 1 << 20);
    assert_non_null(world_find(first, FRAME_DONE, 1, 0));
    assert_non_null(world_find(second, FRAME_BUSY, 1, 0));
    assert_non_null(world_find(other, FRAME_DONE, 1, 0));
    world_leave(first);
    world_leave(other);
    world_pool(second, 2, pool_of(2 << 20), 2 << 20);
    assert_non_null(world_find(second, FRAME_DONE, 2, 0));
    world_pool(second, 3, pool_of(4096), 4096); /* in place of the other one, which is not counted any more */
    assert_int_equal(world_counters(&world).pool_bytes, 4096);
}

/* ---- credits and queues ---- */

static void build_many(struct world_client *client, uint64_t request, const struct world_mesh *mesh, uint32_t count)
{
    struct control_item items[256];
    assert_true(count <= 256);
    for (uint32_t i = 0; i < count; i++)
        items[i] = world_item(&mesh->input, mesh->size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = count, .items = items};
    world_build(client, request, &build, (struct bytes){mesh->payload, mesh->size}, NULL);
}

static void test_credits_are_kept(void **state)
{
    (void)state;
    struct world_mesh mesh;
    struct world_client *client = world_join(&world);
    world_mesh_init(&mesh, 20, 5);
    build_many(client, 1, &mesh, 65);
    assert_int_equal(world_find(client, FRAME_ERROR, 1, 0)->error->status, BVHD_TOO_LARGE);
    client->hold = true;
    build_many(client, 2, &mesh, 60);
    for (uint32_t i = 0; i < 60; i++)
        world_await_result(client, 2, i);
    assert_int_equal(session_uses(client->session, SHARE_ITEMS), 60);
    build_many(client, 3, &mesh, 5);
    assert_int_equal(world_find(client, FRAME_ERROR, 3, 0)->error->status, BVHD_TOO_LARGE);
    build_many(client, 4, &mesh, 4);
    assert_null(world_find(client, FRAME_ERROR, 4, 0));
    client->hold = false;
    world_settle(&world);
    assert_int_equal(session_uses(client->session, SHARE_ITEMS), 0);
    build_many(client, 5, &mesh, 64);
    world_settle(&world);
    assert_int_equal(world_status(client, 5, 63), BVHD_OK);
    world_mesh_finish(&mesh);
}

static bool is_busy(struct world_client *client, uint64_t request, const struct world_mesh *mesh, uint32_t count)
{
    client->hold = true;
    build_many(client, request, mesh, count);
    return world_find(client, FRAME_BUSY, request, 0) != NULL;
}

/* The queue has 64 places: a user alone gets three quarters of them, and a connection of it three quarters of that. */
static void test_full_queues_are_busy(void **state)
{
    (void)state;
    struct service_options options = world_options();
    struct world_mesh mesh;
    world_finish(&world);
    options.max_queue = 64;
    world_init(&world, &options);
    world_mesh_init(&mesh, 20, 5);
    struct world_client *greedy = world_join_as(&world, 1);
    assert_true(is_busy(greedy, 1, &mesh, 37));
    assert_true(world_find(greedy, FRAME_BUSY, 1, 0)->busy->retry_ms > 0);
    assert_false(is_busy(greedy, 2, &mesh, 36));
    struct world_client *second = world_join_as(&world, 1); /* an equal part of what the user may have, of 48 */
    assert_true(is_busy(second, 1, &mesh, 17));
    assert_false(is_busy(second, 2, &mesh, 16));
    assert_true(is_busy(second, 3, &mesh, 1));
    assert_true(is_busy(greedy, 3, &mesh, 1));
    assert_int_equal(world_counters(&world).refused, 4);
    struct world_client *other = world_join_as(&world, 2); /* a part of the whole, whatever the first user has */
    assert_false(is_busy(other, 1, &mesh, 12));
    assert_true(is_busy(other, 2, &mesh, 8));
    greedy->hold = second->hold = other->hold = false;
    world_settle(&world);
    assert_false(is_busy(other, 3, &mesh, 36));
    other->hold = false;
    world_settle(&world);
    assert_int_equal(world_status(other, 3, 35), BVHD_OK);
    world_mesh_finish(&mesh);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

/* ---- progress ---- */

static uint32_t thousandths_of(const struct world_client *client, uint64_t request)
{
    const struct request *found = session_find(client->session, request);
    return found ? flight_thousandths(&found->items[0].waiter) : 0;
}

/*
 * The build's end is not noticed before the next iteration of the loop, so that the flight is under way however fast
 * the worker is.
 */
static void progress_is_reported(void **state)
{
    struct world_client *client = world_join(&world), *slow = world_join(&world), *plain = world_join(&world);
    struct world_mesh mesh;
    (void)state;
    world_mesh_init(&mesh, 1000, 77);
    plain->session->progress_ms = 0;
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_JOINED);
    const struct flight_waiter *waiter = &session_find(client->session, 1)->items[0].waiter;
    session_report_progress(client->session, 1000);
    while (flight_thousandths(waiter) == 0)
        sched_yield();
    assert_in_range(thousandths_of(client, 1), 1, CONTROL_DONE);
    session_report_progress(client->session, 1249); /* too early */
    assert_null(world_find(client, FRAME_PROGRESS, 1, 1));
    while (flight_thousandths(waiter) < CONTROL_DONE)
        sched_yield();
    client->hold = true;
    session_report_progress(client->session, 1250);
    session_report_progress(client->session, 9000); /* the last one has not been sent */
    session_report_progress(plain->session, 1250);
    session_report_progress(slow->session, 1250);
    client->hold = false;
    world_settle(&world);
    session_report_progress(client->session, 20000); /* there is nothing new */
    world_iterate(&world);
    uint32_t count = 0, last = 0;
    for (const struct world_event *event; (event = world_find(client, FRAME_PROGRESS, 1, count)); count++) {
        assert_int_equal(event->progress->count, 1);
        assert_int_equal(event->progress->items[0], 0);
        assert_true(event->progress->thousandths[0] > last);
        last = event->progress->thousandths[0];
    }
    assert_in_range(count, 1, 2);
    assert_int_equal(last, CONTROL_DONE);
    assert_null(world_find(plain, FRAME_PROGRESS, 1, 0));
    assert_null(world_find(slow, FRAME_PROGRESS, 1, 0));
    world_build_mesh(client, 2, &mesh); /* from the cache */
    world_settle(&world);
    assert_null(world_find(client, FRAME_PROGRESS, 2, 0));
    assert_int_equal(world_status(client, 2, 0), BVHD_OK);
    world_mesh_finish(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_hello_is_answered_with_limits),
        TEST(test_other_versions_are_incompatible),
        TEST(test_nothing_comes_before_hello),
        TEST(test_broken_frames_end_the_connection),
        TEST(test_a_number_in_use_ends_the_connection),
        TEST(test_unknown_types_are_unsupported),
        TEST(test_rows_of_later_versions_are_unsupported),
        TEST(test_rows_of_earlier_versions_are_taken),
        TEST(test_requests_without_items_are_refused),
        TEST(test_stats_name_every_counter),
        TEST(test_goodbye_is_said_once),
        TEST(test_a_draining_service_takes_nothing_new),
        TEST(test_pools_are_replaced_when_nothing_needs_them),
        TEST(test_bad_pools_leave_the_old_one),
        TEST(test_pools_together_have_a_limit),
        TEST(test_credits_are_kept),
        TEST(test_full_queues_are_busy),
        TEST(progress_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

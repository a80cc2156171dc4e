/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_request_update.c - tests updates through a session: what they start from, and that they are refits, shared,
 * cancelled and tried again as builds are.
 */
#include "tests/support/unit.h"

#include <ftw.h>
#include <unistd.h>

#include "builder/content_key.h"
#include "builder/store/generation.h"
#include "tests/support/daemon/update_request.h"
#include "tests/support/random.h"

static struct session_world world;
static char directory[] = "/tmp/bvhd-update-XXXXXX";
static bool with_disk; /* until tear_down */

static void start(uint64_t cache)
{
    struct service_options options = world_options();
    options.cache = cache;
    options.disk_directory = with_disk ? directory : NULL;
    world_init(&world, &options);
}

static int set_up(void **state)
{
    (void)state;
    start(world_options().cache);
    return 0;
}

static int remove_one(const char *path, const struct stat *about, int type, struct FTW *at)
{
    (void)about, (void)type, (void)at;
    return remove(path);
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    if (with_disk)
        nftw(directory, remove_one, 8, FTW_DEPTH | FTW_PHYS);
    with_disk = false;
    return 0;
}

static void updatable_mesh(struct world_mesh *mesh, uint32_t triangles)
{
    world_mesh_init(mesh, triangles, 5);
    mesh->input.flags = BUILD_ALLOW_UPDATE;
}

/* Moves every corner by its own amount, the same for the same step. */
static void move(const struct world_mesh *mesh, uint32_t step)
{
    struct random random = {step};
    for (uint32_t i = 0; i < 9 * mesh->geometry.range.primitive_count; i++) {
        double by[3];
        random_point(&random, by);
        mesh->vertices[i] += 0.05f * (float)by[0];
    }
}

/* ---- updates that succeed ---- */

/* A chain of updates: each has the bytes of a refit of the one before, and none is a build. */
static void test_updates_are_refits(void **state)
{
    (void)state;
    enum { STEPS = 3 };
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    struct update_made made[STEPS + 1];
    updatable_mesh(&mesh, 3000);
    struct key key = update_build(client, &mesh.input);
    update_make(&mesh.input, NULL, &made[0]);
    assert_true(key_equal(&key, &made[0].entry.key));
    const struct build_input update = update_of(&mesh.input);
    for (uint32_t step = 1; step <= STEPS; step++) {
        move(&mesh, step);
        update_make(&update, &made[step - 1], &made[step]);
        const struct world_event *event = update_await(client, update_ask(client, &update, &key));
        update_check_same(event, &made[step]);
        assert_int_equal(event->result->origin, ORIGIN_BUILT);
        assert_int_equal(event->result->summary.refits, step);
        assert_true(event->result->summary.decay > 0);
        assert_string_equal(event->result->summary.method, "refit");
        struct counters counters = world_counters(&world);
        assert_int_equal(counters.builds_started, 1);
        assert_int_equal(counters.refits_started, step);
        assert_int_equal(counters.refits_done, step);
        key = event->result->key;
    }
    for (int i = 0; i <= STEPS; i++)
        update_made_finish(&made[i]);
    world_mesh_finish(&mesh);
}

/* A rebuild would give other bytes, and another key. */
static void test_updates_are_no_builds(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 500);
    struct key key = update_build(client, &mesh.input);
    for (uint32_t i = 0; i < 9 * 500; i++)
        mesh.vertices[i] = mesh.vertices[9 * 500 - 1 - i] + (float)(i % 7);
    const struct build_input update = update_of(&mesh.input);
    const struct control_result *updated = update_await(client, update_ask(client, &update, &key))->result;
    const struct world_event *built = update_await(client, update_ask(client, &mesh.input, NULL));
    assert_int_equal(updated->error.status, BVHD_OK);
    assert_false(key_equal(&updated->key, &built->result->key));
    assert_true(updated->summary.decay > 1);
    assert_true(built->result->summary.decay == 0 && built->result->summary.refits == 0);
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.builds_started, 2);
    assert_int_equal(counters.refits_done, 1);
    world_mesh_finish(&mesh);
}

/* Results of updates are found again as others are: by the same request, and by GET. The source stays what it is. */
static void test_results_are_kept(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 200);
    struct key source = update_build(client, &mesh.input);
    move(&mesh, 1);
    const struct build_input update = update_of(&mesh.input);
    struct key keys[2] = {source, update_await(client, update_ask(client, &update, &source))->result->key};
    assert_int_equal(update_await(client, update_ask(client, &update, &source))->result->origin, ORIGIN_MEMORY);
    world_get(client, ++update_requests, keys, 2);
    assert_int_equal(world_await_result(client, update_requests, 0)->result->summary.refits, 0);
    assert_int_equal(world_await_result(client, update_requests, 1)->result->summary.refits, 1);
    assert_int_equal(world_counters(&world).refits_done, 1);
    world_mesh_finish(&mesh);
}

/* ---- where the source is ---- */

static struct key key_of_number(uint8_t number)
{
    struct key key;
    memset(&key, number, sizeof key);
    return key;
}

static void expect_lost(const struct world_event *event, const struct key *key)
{
    char text[KEY_TEXT_SIZE];
    key_to_text(key, text);
    update_expect(event, BVHD_SOURCE_LOST, BVHD_VUID_NONE, "infos[0].srcAccelerationStructure");
    assert_non_null(strstr(event->result->error.text, text));
}

static void test_lost_sources(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 50);
    const struct build_input update = update_of(&mesh.input);
    struct key unknown = key_of_number(1), none = key_of_number(0), source = update_build(client, &mesh.input);
    expect_lost(update_await(client, update_ask(client, &update, &unknown)), &unknown);
    update_expect(update_await(client, update_ask(client, &update, &none)), BVHD_INVALID, BVHD_VUID_04629,
                  "infos[0].srcAccelerationStructure");
    cache_clear(world.service->cache);
    expect_lost(update_await(client, update_ask(client, &update, &source)), &source);
    assert_int_equal(world_counters(&world).refits_started, 0);
    world_mesh_finish(&mesh);
}

/* An update that has started has its source, whatever the cache does. */
static void test_sources_are_held(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 1000);
    struct key source = update_build(client, &mesh.input);
    move(&mesh, 1);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    const struct build_input update = update_of(&mesh.input);
    uint64_t request = update_ask(client, &update, &source), late = update_ask(client, &update, NULL);
    cache_clear(world.service->cache);
    cache_trim(world.service->cache);
    assert_int_equal(cache_load(world.service->cache).entries, 0);
    world_open(gates[0]);
    world_open(gates[1]);
    assert_int_equal(update_await(client, request)->result->error.status, BVHD_OK);
    update_expect(update_await(client, late), BVHD_INVALID, BVHD_VUID_04629, "infos[0].srcAccelerationStructure");
    world_mesh_finish(&mesh);
}

/* Without a cache nothing can be updated, and nothing else changes. */
static void test_no_cache(void **state)
{
    (void)state;
    world_finish(&world);
    start(0);
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 50);
    struct key source = update_build(client, &mesh.input);
    const struct build_input update = update_of(&mesh.input);
    expect_lost(update_await(client, update_ask(client, &update, &source)), &source);
    world_mesh_finish(&mesh);
}

/* ---- the disk ---- */

static struct world_client *restart(void)
{
    world_finish(&world);
    start(world_options().cache);
    return world_join(&world);
}

static struct world_client *restart_with_disk(void)
{
    assert_non_null(mkdtemp(strcpy(directory, "/tmp/bvhd-update-XXXXXX")));
    with_disk = true;
    return restart();
}

static int files; /* whose names are keys */

static int count_one(const char *path, const struct stat *about, int type, struct FTW *at)
{
    (void)about;
    files += type == FTW_F && strlen(path + at->base) == KEY_TEXT_SIZE - 1;
    return 0;
}

/* A source comes from the disk with its record; the results of updates, and their records, are not there. */
static void test_sources_on_disk(void **state)
{
    (void)state;
    struct world_client *client = restart_with_disk();
    struct world_mesh mesh;
    updatable_mesh(&mesh, 4000);
    struct key source = update_build(client, &mesh.input);
    client = restart();
    move(&mesh, 1);
    const struct build_input update = update_of(&mesh.input);
    for (int i = 0; i < 2; i++) { /* from the disk, then from the memory into which that has come */
        const struct control_result *first = update_await(client, update_ask(client, &update, &source))->result;
        if (first->error.status != BVHD_OK)
            fail_msg("%s", first->error.text);
        move(&mesh, 2);
    }
    struct key updated = update_await(client, update_ask(client, &update, &source))->result->key;
    client = restart();
    expect_lost(update_await(client, update_ask(client, &update, &updated)), &updated);
    world_get(client, ++update_requests, &updated, 1);
    assert_int_equal(world_await_result(client, update_requests, 0)->result->error.status, BVHD_NOT_FOUND);
    files = 0;
    nftw(directory, count_one, 8, FTW_PHYS);
    assert_int_equal(files, 2); /* the source and its record */
    world_mesh_finish(&mesh);
}

static bool has_ended(void *context)
{
    const struct counters counters = world_counters(context);
    return counters.builds_running == 0 && counters.memory_promised == 0;
}

/* Returns what is promised to an update that is prepared. */
static uint64_t promised_to(struct world_client *client, const struct build_input *update, const struct key *source)
{
    world_await(&world, has_ended, &world);
    world_hold_builds(&world);
    uint64_t before = world_counters(&world).memory_promised, request = update_ask(client, update, source);
    world_await_state(client, request, 0, ITEM_JOINED);
    uint64_t promised = world_counters(&world).memory_promised - before;
    world_release_builds(&world);
    assert_int_equal(update_await(client, request)->result->error.status, BVHD_OK);
    return promised;
}

/* A record that comes from disk is memory that admission knows of. */
static void test_records_from_disk_are_promised(void **state)
{
    (void)state;
    struct world_client *client = restart_with_disk();
    struct world_mesh mesh;
    const uint64_t record = sizeof(struct record_header) + sizeof(struct record_geometry);
    updatable_mesh(&mesh, 4000);
    struct key source = update_build(client, &mesh.input);
    const struct build_input update = update_of(&mesh.input);
    uint64_t without = promised_to(client, &update, &source);
    client = restart();
    assert_true(promised_to(client, &update, &source) >= without + record);
    world_mesh_finish(&mesh);
}

/* The key of a record names no result, and asking for it does no harm. */
static void test_records_are_no_results(void **state)
{
    (void)state;
    struct world_client *client = restart_with_disk();
    struct world_mesh mesh;
    struct bvhd_error error;
    struct key record;
    updatable_mesh(&mesh, 50);
    struct key source = update_build(client, &mesh.input);
    assert_int_equal(content_key_of_record(&source, &record, &error), BVHD_OK);
    client = restart();
    world_get(client, ++update_requests, &record, 1);
    assert_int_equal(world_await_result(client, update_requests, 0)->result->error.status, BVHD_NOT_FOUND);
    const struct build_input update = update_of(&mesh.input);
    expect_lost(update_await(client, update_ask(client, &update, &record)), &record);
    assert_int_equal(update_await(client, update_ask(client, &update, &source))->result->error.status, BVHD_OK);
    assert_int_equal(world_counters(&world).disk_damaged, 0);
    world_mesh_finish(&mesh);
}

/* A source on disk that was built without ALLOW_UPDATE says so; one whose record is gone is lost. */
static void test_sources_on_disk_without_record(void **state)
{
    (void)state;
    struct world_client *client = restart_with_disk();
    struct world_mesh mesh;
    updatable_mesh(&mesh, 50);
    struct key updatable = update_build(client, &mesh.input), record;
    struct build_input plain = mesh.input;
    plain.flags = 0;
    struct key source = update_build(client, &plain);
    client = restart();
    const struct build_input update = update_of(&mesh.input);
    update_expect(update_await(client, update_ask(client, &update, &source)), BVHD_INVALID, BVHD_VUID_03667,
                  "infos[0].srcAccelerationStructure");
    struct bvhd_error error;
    char text[KEY_TEXT_SIZE], path[200];
    assert_int_equal(content_key_of_record(&updatable, &record, &error), BVHD_OK);
    key_to_text(&record, text);
    snprintf(path, sizeof path, "%s/%s/%.2s/%s", directory, store_generation(), text, text);
    assert_int_equal(unlink(path), 0);
    expect_lost(update_await(client, update_ask(client, &update, &updatable)), &updatable);
    world_mesh_finish(&mesh);
}

/* ---- handles ---- */

/* The handles of one request: in place is no conflict, another item's destination is. */
static void test_handles(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 20);
    struct key key = update_build(client, &mesh.input);
    const struct build_input update = update_of(&mesh.input);
    free(mesh.payload);
    mesh.payload = world_payload(&update, &mesh.size);
    struct control_item items[4];
    for (int i = 0; i < 4; i++) {
        items[i] = world_item(&update, mesh.size, SOURCE_INLINE, 0);
        items[i].source_key = key;
        items[i].destination = items[i].source = 10 + (uint64_t)i; /* in place */
    }
    items[1].source = items[2].destination = 5; /* 1 is updated from what 2 makes */
    items[3].source = 6; /* to another structure */
    const struct control_build build = {.item_count = 4, .items = items};
    world_build(client, ++update_requests, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
    for (uint32_t i = 0; i < 4; i++) {
        const struct bvhd_error *error = &world_await_result(client, update_requests, i)->result->error;
        assert_int_equal(error->vuid, i == 1 ? BVHD_VUID_03403 : BVHD_VUID_NONE);
        assert_int_equal(error->status, i == 1 ? BVHD_INVALID : BVHD_OK);
    }
    world_mesh_finish(&mesh);
}

/* ---- sharing and cancelling ---- */

static void test_equal_updates_are_made_once(void **state)
{
    (void)state;
    struct world_client *clients[] = {world_join(&world), world_join(&world)};
    struct world_mesh mesh;
    updatable_mesh(&mesh, 2000);
    struct key source = update_build(clients[0], &mesh.input);
    move(&mesh, 1);
    const struct build_input update = update_of(&mesh.input);
    struct world_gate *gate = world_shut(&world);
    uint64_t requests[2];
    for (int i = 0; i < 2; i++)
        requests[i] = update_ask(clients[i], &update, &source);
    world_open(gate);
    const struct control_result *a = update_await(clients[0], requests[0])->result;
    const struct control_result *b = update_await(clients[1], requests[1])->result;
    assert_true(a->error.status == BVHD_OK && key_equal(&a->key, &b->key));
    assert_int_equal(world_counters(&world).refits_done, 1);
    world_mesh_finish(&mesh);
}

static void test_cancelling(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 3000);
    struct key source = update_build(client, &mesh.input);
    const struct build_input update = update_of(&mesh.input);
    for (uint32_t i = 0; i < 4; i++) {
        struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
        move(&mesh, i + 1);
        uint64_t request = update_ask(client, &update, &source);
        if (i % 2 == 0)
            world_cancel(client, request, NULL, 0); /* it waits for a worker */
        world_open(gates[0]);
        world_open(gates[1]);
        if (i % 2 == 1) {
            world_await_state(client, request, 0, ITEM_JOINED);
            world_cancel(client, request, NULL, 0);
        }
        world_await_result(client, request, 0);
        assert_int_equal(world_status(client, request, 0), BVHD_CANCELLED);
    }
    world_settle(&world);
    assert_int_equal(world_counters(&world).cancelled, 4);
    world_mesh_finish(&mesh);
}

/* An update that was cancelled after it had begun has not failed. */
static void test_cancelled_refits_are_counted(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    updatable_mesh(&mesh, 100);
    struct key source = update_build(client, &mesh.input);
    const struct build_input update = update_of(&mesh.input);
    world_hold_builds(&world);
    uint64_t request = update_ask(client, &update, &source);
    world_await_state(client, request, 0, ITEM_JOINED);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_release_builds(&world);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, 1);
    assert_int_equal(world_cancel(client, request, NULL, 0), BVHD_OK);
    world_open(gates[0]);
    world_open(gates[1]);
    world_await(&world, has_ended, &world);
    const struct counters counters = world_counters(&world);
    assert_int_equal(counters.refits_started, 1);
    assert_int_equal(counters.refits_cancelled, 1);
    assert_int_equal(counters.refits_done + counters.refits_failed, 0);
    world_mesh_finish(&mesh);
}

/* ---- shortages ---- */

/* Updates that wait for memory, of which a block leaves them half of what they need. */
struct squeeze {
    struct world_client *client;
    struct world_mesh mesh;
    struct update_made built; /* the source */
    struct build_input update;
    struct key source;
    uint64_t requests[2];
    void *block;
};

/* Finds out what an update needs, then asks for `count` of them, and for nothing else. */
static void squeeze_init(struct squeeze *squeeze, uint32_t count)
{
    world_restart(&world, 32 << 20);
    struct memory *memory = &world.service->memory;
    squeeze->client = world_join(&world);
    updatable_mesh(&squeeze->mesh, 20000);
    update_make(&squeeze->mesh.input, NULL, &squeeze->built);
    squeeze->update = update_of(&squeeze->mesh.input);
    squeeze->source = update_build(squeeze->client, &squeeze->mesh.input);
    uint64_t request = update_ask(squeeze->client, &squeeze->update, &squeeze->source);
    uint64_t needed = update_await(squeeze->client, request)->result->summary.peak_bytes;
    assert_true(needed > 50000);
    world_await(&world, has_ended, &world);
    world_hold_builds(&world);
    for (uint32_t i = 0; i < count; i++) {
        move(&squeeze->mesh, i + 1);
        squeeze->requests[i] = update_ask(squeeze->client, &squeeze->update, &squeeze->source);
        world_await_state(squeeze->client, squeeze->requests[i], 0, ITEM_JOINED);
    }
    squeeze->block = memory_alloc(memory, memory->limit - atomic_load(&memory->live) - needed / 2);
    assert_non_null(squeeze->block);
}

/* Lets all of them run, and frees the block before the loop collects them. */
static void squeeze_run(struct squeeze *squeeze, uint64_t count)
{
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_release_builds(&world);
    world_iterate(&world);
    assert_int_equal(world_counters(&world).builds_running, count);
    world_open(gates[0]);
    world_open(gates[1]);
    while (world_counters(&world).jobs_running + world_counters(&world).jobs_queued > 0)
        ;
    memory_free(&world.service->memory, squeeze->block);
}

static void squeeze_finish(struct squeeze *squeeze)
{
    update_made_finish(&squeeze->built);
    world_mesh_finish(&squeeze->mesh);
}

/* Updates that were admitted end, with the bytes that they would have had alone. */
static void test_a_shortage_beside_others_is_tried_again(void **state)
{
    (void)state;
    struct squeeze squeeze;
    struct update_made made;
    squeeze_init(&squeeze, 2);
    squeeze_run(&squeeze, 2);
    update_make(&squeeze.update, &squeeze.built, &made);
    assert_int_equal(update_await(squeeze.client, squeeze.requests[0])->result->error.status, BVHD_OK);
    update_check_same(update_await(squeeze.client, squeeze.requests[1]), &made);
    const struct counters counters = world_counters(&world);
    assert_int_equal(counters.refits_retried, 2);
    assert_int_equal(counters.refits_done, 3);
    assert_int_equal(counters.refits_started, 5);
    assert_int_equal(counters.refits_failed + counters.builds_retried, 0);
    update_made_finish(&made);
    squeeze_finish(&squeeze);
}

static void test_a_shortage_alone_is_an_error(void **state)
{
    (void)state;
    struct squeeze squeeze;
    squeeze_init(&squeeze, 1);
    squeeze_run(&squeeze, 1);
    assert_int_equal(update_await(squeeze.client, squeeze.requests[0])->result->error.status, BVHD_NO_MEMORY);
    const struct counters counters = world_counters(&world);
    assert_int_equal(counters.refits_retried, 0);
    assert_int_equal(counters.refits_failed, 1);
    uint64_t again = update_ask(squeeze.client, &squeeze.update, &squeeze.source);
    assert_int_equal(update_await(squeeze.client, again)->result->error.status, BVHD_OK);
    squeeze_finish(&squeeze);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_updates_are_refits, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_updates_are_no_builds, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_results_are_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_lost_sources, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_are_held, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_cache, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_on_disk, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_records_from_disk_are_promised, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_records_are_no_results, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_on_disk_without_record, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_handles, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_equal_updates_are_made_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_cancelling, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_cancelled_refits_are_counted, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_shortage_beside_others_is_tried_again, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_shortage_alone_is_an_error, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_request_update.c - tests updates through a session: what they start from, and that they are refits, shared and
 * cancelled as builds are.
 */
#include "tests/support/unit.h"

#include <ftw.h>
#include <unistd.h>

#include "builder/content_key.h"
#include "builder/store/generation.h"
#include "builder/update/build_entry.h"
#include "tests/support/builder/inputs.h"
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

/* A structure that is made in this process, without a service. */
struct made {
    struct memory memory;
    struct build_entry entry;
    struct build_made made;
};

/* `source` is NULL for a build. */
static void make(const struct build_input *input, const struct made *source, struct made *ret_made)
{
    const struct limits limits = limits_default();
    struct bvhd_error error;
    memory_init(&ret_made->memory, UINT64_MAX);
    const struct build_context context = {.memory = &ret_made->memory, .parallel = &parallel_serial};
    struct build_input asked = *input;
    struct build_entry_source from = {.blob = {NULL, 0}};
    if (source) {
        asked.source_key = source->entry.key;
        from = (struct build_entry_source){{source->made.blob, source->made.size}, source->entry.record.bytes};
    }
    assert_int_equal(build_entry_prepare(&asked, 0, &limits, &from, &context, &ret_made->entry, &error), BVHD_OK);
    assert_int_equal(build_entry_make(&ret_made->entry, &from, &context, &ret_made->made, &error), BVHD_OK);
}

static void made_finish(struct made *made)
{
    build_entry_finish(&made->entry, &made->memory);
    memory_free(&made->memory, made->made.blob);
    assert_int_equal(made->memory.live, 0);
}

static void check_same(const struct world_event *event, const struct made *made)
{
    const struct control_result *result = event->result;
    const struct summary *summary = &made->made.summary;
    assert_int_equal(result->error.status, BVHD_OK);
    assert_int_equal(result->size, made->made.size);
    assert_memory_equal(event->bytes, made->made.blob, result->size);
    assert_true(key_equal(&result->key, &made->entry.key));
    assert_true(result->summary.decay == summary->decay);
    assert_int_equal(result->summary.refits, summary->refits);
    assert_string_equal(result->summary.method, summary->method);
    assert_true(result->summary.sah == summary->sah);
}

/* ---- updates that succeed ---- */

/* A chain of updates: each has the bytes of a refit of the one before, and none is a build. */
static void test_updates_are_refits(void **state)
{
    (void)state;
    enum { STEPS = 3 };
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    struct made made[STEPS + 1];
    updatable_mesh(&mesh, 3000);
    struct key key = update_build(client, &mesh.input);
    make(&mesh.input, NULL, &made[0]);
    assert_true(key_equal(&key, &made[0].entry.key));
    const struct build_input update = update_of(&mesh.input);
    for (uint32_t step = 1; step <= STEPS; step++) {
        move(&mesh, step);
        make(&update, &made[step - 1], &made[step]);
        const struct world_event *event = update_await(client, update_ask(client, &update, &key));
        check_same(event, &made[step]);
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
        made_finish(&made[i]);
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

/* Each kind of structure, with everything that may be other than it was. */
static void test_every_kind(void **state)
{
    (void)state;
    static void (*const makers[])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances};
    struct world_client *client = world_join(&world);
    struct test_input test;
    for (int i = 0; i < 3; i++) {
        makers[i](&test);
        test.input.flags = BUILD_ALLOW_UPDATE;
        struct key key = update_build(client, &test.input);
        for (int k = 0; k < INPUTS_VERTICES; k++)
            test.vertices[k][k % 3] += 2;
        test.transform[7] += 1;
        test.boxes[0][3] += 1;
        test.records[0][3] = 0x40400000;
        const struct build_input update = update_of(&test.input);
        const struct control_result *result = update_await(client, update_ask(client, &update, &key))->result;
        assert_string_equal(result->error.text, "");
        assert_int_equal(result->error.status, BVHD_OK);
        assert_int_equal(result->summary.refits, 1);
    }
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
    update_expect(update_await(client, update_ask(client, &update, &none)), BVHD_INVALID, BVHD_VUID_03667,
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
    update_expect(update_await(client, late), BVHD_INVALID, BVHD_VUID_03667, "infos[0].srcAccelerationStructure");
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
    assert_non_null(mkdtemp(directory));
    with_disk = true;
    struct world_client *client = restart();
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

/* The key of a record names no result, and asking for it does no harm. */
static void test_records_are_no_results(void **state)
{
    (void)state;
    assert_non_null(mkdtemp(strcpy(directory, "/tmp/bvhd-update-XXXXXX")));
    with_disk = true;
    struct world_client *client = restart();
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
    assert_non_null(mkdtemp(strcpy(directory, "/tmp/bvhd-update-XXXXXX")));
    with_disk = true;
    struct world_client *client = restart();
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_updates_are_refits, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_updates_are_no_builds, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_results_are_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_every_kind, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_lost_sources, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_are_held, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_cache, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_on_disk, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_records_are_no_results, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sources_on_disk_without_record, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_handles, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_equal_updates_are_made_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_cancelling, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

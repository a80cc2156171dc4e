/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_request_micromap.c - tests opacity micromaps through a session: they are built, shared and kept as other
 * structures are, and triangles name them by their keys, wherever the service has them.
 */
#include "tests/support/unit.h"

#include "proto/base/validate_shape.h"
#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/builder/random_micromap.h"
#include "tests/support/daemon/update_request.h"
#include "tests/support/scratch.h"

enum { HANDLE = 88, SMALL_COUNT = 40, SMALL_LEVEL = 3, LARGE_COUNT = 1000, LARGE_LEVEL = 7 };

static struct session_world world;
static struct service_options options;
static struct random_micromap micromap;
static struct random_attachment attachment;
static struct test_input test; /* triangles with the micromap */
static struct reference reference;
static struct build_input micromap_input;

static void begin(uint32_t count, unsigned level)
{
    struct random random = {count};
    random_micromap_make(&random, count, level, 0, &micromap);
    micromap_input = (struct build_input){.type = STRUCTURE_MICROMAP,
                                          .geometry_count = 1,
                                          .geometries = &micromap.geometry,
                                          .options = {.target = TARGET_PORTABLE}};
    inputs_triangles(&test);
    test.input.options.quality = QUALITY_FAST;
    random_micromap_attach(&random, &micromap, HANDLE, &test.geometries[0], &attachment);
    reference = random_micromap_reference(&micromap, HANDLE);
    test.input.references = &reference;
    test.input.reference_count = 1;
    world_init(&world, &options);
}

static int set_up(void **state)
{
    (void)state;
    options = world_options();
    begin(SMALL_COUNT, SMALL_LEVEL);
    return 0;
}

/* With a disk, and a micromap that lies in a descriptor. */
static int set_up_on_disk(void **state)
{
    (void)state;
    options = world_options();
    options.disk_directory = scratch_folder;
    options.disk_budget = 64 << 20;
    begin(LARGE_COUNT, LARGE_LEVEL);
    assert_true(micromap.blob.size > BLOB_INLINE_MAX);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    random_attachment_finish(&attachment);
    random_micromap_finish(&micromap);
    validate_micromaps = true;
    return 0;
}

/* Asks for the triangles, whose bytes are those that are built in this process. */
static const struct world_event *expect_triangles(struct world_client *client)
{
    struct update_made made;
    update_make(&test.input, NULL, &made);
    const struct world_event *event = update_await(client, update_ask(client, &test.input, NULL));
    if (event->result->error.status != BVHD_OK)
        fail_msg("%s: %s", event->result->error.where, event->result->error.text);
    update_check_same(event, &made);
    update_made_finish(&made);
    return event;
}

static void expect_micromap(const struct world_event *event, enum result_origin origin)
{
    const struct control_result *result = event->result;
    assert_int_equal(result->error.status, BVHD_OK);
    assert_int_equal(result->origin, origin);
    assert_true(key_equal(&result->key, &micromap.key));
    assert_int_equal(result->size, micromap.blob.size);
    assert_memory_equal(event->bytes, micromap.blob.data, micromap.blob.size);
    assert_int_equal(result->summary.target, TARGET_PORTABLE);
    assert_int_equal(result->summary.primitives, micromap.count);
    assert_true(result->summary.bounds.min[0] > result->summary.bounds.max[0]);
    assert_false(slabs_are_known(&result->summary.slabs));
}

/* Two ask for it while it is built, and a third one afterwards. */
static void micromaps_are_builds(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    world_hold_builds(&world);
    const uint64_t first = update_ask(client, &micromap_input, NULL);
    world_await_state(client, first, 0, ITEM_JOINED);
    const uint64_t second = update_ask(other, &micromap_input, NULL);
    world_await_state(other, second, 0, ITEM_JOINED);
    world_release_builds(&world);
    expect_micromap(update_await(client, first), ORIGIN_BUILT);
    expect_micromap(update_await(other, second), ORIGIN_COALESCED);
    expect_micromap(update_await(other, update_ask(other, &micromap_input, NULL)), ORIGIN_MEMORY);
    assert_int_equal(world_counters(&world).builds_started, 1);
    world_get(client, 1000, &micromap.key, 1);
    expect_micromap(world_await_result(client, 1000, 0), ORIGIN_MEMORY);
}

static void micromaps_are_found_in_memory(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    update_build(client, &micromap_input);
    assert_int_equal(expect_triangles(other)->result->origin, ORIGIN_BUILT);
    assert_int_equal(expect_triangles(client)->result->origin, ORIGIN_MEMORY);
    assert_int_equal(world_counters(&world).memory_promised, 0);
}

static uint64_t entries_read(void)
{
    return disk_state(world.service->disk).store.read;
}

/* After the first time it is in memory. */
static void micromaps_are_found_on_disk(void **state)
{
    (void)state;
    update_build(world_join(&world), &micromap_input);
    world_finish(&world);
    world_init(&world, &options);
    struct world_client *client = world_join(&world);
    assert_int_equal(world_counters(&world).cache_entries, 0);
    expect_triangles(client);
    assert_int_equal(world_counters(&world).cache_entries, 2);
    assert_int_equal(entries_read(), 1);
    test.geometries[1].flags = GEOMETRY_OPAQUE;
    expect_triangles(client);
    assert_int_equal(world_counters(&world).cache_entries, 3);
    assert_int_equal(entries_read(), 1);
    assert_int_equal(world_counters(&world).memory_promised, 0);
}

static void expect_missing(struct world_client *client, enum bvhd_status status)
{
    update_expect(update_await(client, update_ask(client, &test.input, NULL)), status, BVHD_VUID_NONE,
                  "infos[0].references[0]");
}

static void missing_micromaps_are_not_found(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    reference.key.bytes[0] ^= 1;
    expect_missing(client, BVHD_NOT_FOUND);
    update_build(client, &micromap_input);
    expect_missing(client, BVHD_NOT_FOUND);
    assert_int_equal(world_counters(&world).prepares_failed, 2);
}

/* The key is that of triangles. */
static void other_structures_are_no_micromaps(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    reference.key = update_build(client, &mesh.input);
    expect_missing(client, BVHD_INVALID);
    world_mesh_finish(&mesh);
}

/* Both the source and the micromap are found by their keys. */
static void triangles_with_micromaps_are_updated(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct update_made built, updated;
    update_build(client, &micromap_input);
    test.input.flags = BUILD_ALLOW_UPDATE;
    const struct key key = update_build(client, &test.input);
    update_make(&test.input, NULL, &built);
    const struct build_input update = update_of(&test.input);
    for (int i = 0; i < INPUTS_VERTICES; i++)
        test.vertices[i][i % 3] += 0.125f;
    update_make(&update, &built, &updated);
    update_check_same(update_await(client, update_ask(client, &update, &key)), &updated);
    update_made_finish(&updated);
    update_made_finish(&built);
    assert_int_equal(world_counters(&world).refits_done, 1);
}

static void micromaps_are_not_updated(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    const struct key key = update_build(client, &micromap_input);
    const struct build_input update = update_of(&micromap_input);
    update_expect(update_await(client, update_ask(client, &update, &key)), BVHD_INVALID, BVHD_VUID_NONE,
                  "infos[0].mode");
}

/* Nobody bakes yet. */
static void bakes_are_refused(void **state)
{
    (void)state;
    struct test_input baked;
    inputs_baked_micromap(&baked);
    struct world_client *client = world_join(&world);
    update_expect(update_await(client, update_ask(client, &baked.input, NULL)), BVHD_UNSUPPORTED, BVHD_VUID_NONE,
                  "infos[0].geometries[0].geometryType");
}

/* Whatever a worker does with them, and while they wait for one. */
static void items_with_micromaps_are_cancelled(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    update_build(client, &micromap_input);
    struct world_gate *gates[2] = {world_shut(&world), world_shut(&world)};
    const uint64_t request = update_ask(client, &test.input, NULL);
    world_await_state(client, request, 0, ITEM_PREPARING);
    world_cancel(client, request, NULL, 0);
    assert_int_equal(world_status(client, request, 0), BVHD_CANCELLED);
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    world_settle(&world);
    assert_int_equal(world_counters(&world).memory_promised, 0);
    expect_triangles(client);
}

/* A client that leaves takes nothing with it. */
static void clients_leave(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    update_build(client, &micromap_input);
    update_ask(other, &test.input, NULL);
    world_leave(other);
    world_settle(&world);
    assert_int_equal(world_counters(&world).memory_promised, 0);
    assert_int_equal(world_counters(&world).live_results, world_counters(&world).cache_entries);
}

/* As long as the program does not have all of them, it says so. */
static void a_closed_door_is_told(void **state)
{
    (void)state;
    assert_true(world_find(world_join(&world), FRAME_WELCOME, 0, 0)->welcome->micromaps);
    validate_micromaps = false;
    struct world_client *client = world_join(&world);
    assert_false(world_find(client, FRAME_WELCOME, 0, 0)->welcome->micromaps);
    update_expect(update_await(client, update_ask(client, &micromap_input, NULL)), BVHD_UNSUPPORTED, BVHD_VUID_NONE,
                  "infos[0].type");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(micromaps_are_builds, set_up, tear_down),
        cmocka_unit_test_setup_teardown(micromaps_are_found_in_memory, set_up, tear_down),
        cmocka_unit_test_setup_teardown(micromaps_are_found_on_disk, set_up_on_disk, tear_down),
        cmocka_unit_test_setup_teardown(missing_micromaps_are_not_found, set_up, tear_down),
        cmocka_unit_test_setup_teardown(missing_micromaps_are_not_found, set_up_on_disk, tear_down),
        cmocka_unit_test_setup_teardown(other_structures_are_no_micromaps, set_up, tear_down),
        cmocka_unit_test_setup_teardown(triangles_with_micromaps_are_updated, set_up, tear_down),
        cmocka_unit_test_setup_teardown(micromaps_are_not_updated, set_up, tear_down),
        cmocka_unit_test_setup_teardown(bakes_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(items_with_micromaps_are_cancelled, set_up, tear_down),
        cmocka_unit_test_setup_teardown(clients_leave, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_closed_door_is_told, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, scratch_make_in_memory, scratch_remove);
}

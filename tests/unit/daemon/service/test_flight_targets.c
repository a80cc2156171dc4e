/* SPDX-License-Identifier: Apache-2.0 */
/* test_flight_targets.c - tests builds for devices in the service: results, keys, errors, and promised memory. */
#include "tests/support/unit.h"

#include "builder/format/lavapipe.h"
#include "tests/support/daemon/session_world.h"

enum { TRIANGLES = 1500 };

static struct session_world world;
static struct world_mesh mesh;

static int set_up(void **state)
{
    (void)state;
    world_init(&world, NULL);
    world_mesh_init(&mesh, TRIANGLES, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    world_mesh_finish(&mesh);
    return 0;
}

static struct build_input native(uint32_t variant, uint8_t uuid)
{
    struct build_input input = mesh.input;
    input.options.target = TARGET_LAVAPIPE;
    input.options.device.variant = variant;
    memset(input.options.device.driver_uuid, uuid, 16);
    memset(input.options.device.compatibility_uuid, uuid + 1, 16);
    return input;
}

static void ask(struct world_client *client, uint64_t request, const struct build_input *inputs, uint32_t count)
{
    struct control_item items[16];
    for (uint32_t i = 0; i < count; i++)
        items[i] = world_item(&inputs[i], mesh.size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = count, .items = items};
    world_build(client, request, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
    world_settle(&world);
}

/* There is one build for each target, variant and UUID, with the bytes that a build in process gives. */
static void test_devices_are_apart(void **state)
{
    (void)state;
    enum { ITEMS = 6, DISTINCT = 5 };
    struct build_input inputs[ITEMS] = {mesh.input,
                                        native(LAVAPIPE_PLAIN, 1),
                                        native(LAVAPIPE_COMPACTED, 1),
                                        native(LAVAPIPE_PLAIN, 2),
                                        native(LAVAPIPE_PLAIN, 2),
                                        native(LAVAPIPE_PLAIN, 2)};
    inputs[5].options.device.compatibility_uuid[15]++;
    struct world_client *client = world_join(&world);
    ask(client, 1, inputs, ITEMS);
    for (uint32_t i = 0; i < ITEMS; i++) {
        const struct world_event *event = world_result(client, 1, i);
        world_check_bytes(event, &inputs[i]);
        for (uint32_t k = 0; k < i; k++) {
            const struct world_event *other = world_result(client, 1, k);
            bool same = memcmp(&event->result->key, &other->result->key, sizeof(struct key)) == 0;
            assert_int_equal(same, i == 4 && k == 3);
        }
    }
    assert_int_equal(world_counters(&world).builds_done, DISTINCT);
    ask(client, 2, inputs, ITEMS);
    for (uint32_t i = 0; i < ITEMS; i++)
        assert_int_equal(world_result(client, 2, i)->result->origin, ORIGIN_MEMORY);
    assert_int_equal(world_counters(&world).builds_done, DISTINCT);
}

static void check_error(const struct world_client *client, uint32_t item, enum bvhd_status status, const char *where)
{
    const struct world_event *event = world_result(client, 1, item);
    assert_int_equal(event->result->error.status, status);
    assert_string_equal(event->result->error.where, where);
}

/* Items with wrong options fail, and the others of the request do not. */
static void test_wrong_devices(void **state)
{
    (void)state;
    enum { ITEMS = 6 };
    struct build_input inputs[ITEMS] = {
        native(LAVAPIPE_PLAIN, 1), native(0, 1), native(3, 1), mesh.input, native(1, 1), native(1, 1)};
    inputs[3].options.device.driver_uuid[0] = 1;
    inputs[4].options.layout_flags = PORTABLE_FAST_TRIANGLES;
    inputs[5].options.target = (enum target)3;
    struct world_client *client = world_join(&world);
    ask(client, 1, inputs, ITEMS);
    assert_int_equal(world_status(client, 1, 0), BVHD_OK);
    check_error(client, 1, BVHD_INVALID, "infos[1].options.device");
    check_error(client, 2, BVHD_INVALID, "infos[2].options.device");
    check_error(client, 3, BVHD_INVALID, "infos[3].options.device");
    check_error(client, 4, BVHD_INVALID, "infos[4].options.layoutFlags");
    check_error(client, 5, BVHD_UNSUPPORTED, "infos[5].options.target");
}

/*
 * Compares promises with peaks, for triangles in random order. A promise is for as many threads as there are pieces;
 * with fewer threads, a build takes less.
 */
static void check_promises(uint32_t triangles, uint64_t most)
{
    struct world_client *client = world_join(&world);
    uint64_t request = 0;
    for (int target = 0; target < 2; target++)
        for (int quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
            struct build_input input = target ? native(LAVAPIPE_PLAIN, 1) : mesh.input;
            input.options.quality = (enum build_quality)quality;
            ask(client, ++request, &input, 1);
            struct canonical_geometry geometry = {.type = GEOMETRY_TRIANGLES};
            const struct preparation preparation = {
                .entry = {.options = input.options,
                          .canonical = {.geometry_count = 1,
                                        .geometries = &geometry,
                                        .primitive_count = triangles,
                                        .vertex_count = 3 * triangles}},
            };
            uint64_t peak = world_result(client, request, 0)->result->summary.peak_bytes,
                     promised = preparation_make_bytes(&preparation);
            if (peak > promised || promised > most * peak)
                fail_msg("%u triangles, target %d, quality %d: %llu promised, %llu taken", triangles, target, quality,
                         (unsigned long long)promised, (unsigned long long)peak);
        }
}

/* A build takes no more than it was promised, and not much less. */
static void test_promises_suit_targets(void **state)
{
    (void)state;
    enum { MANY = 40000 };
    check_promises(TRIANGLES, 2);
    world_mesh_finish(&mesh);
    world_mesh_init(&mesh, MANY, 2);
    check_promises(MANY, 3);
}

#define TEST(function) cmocka_unit_test_setup_teardown(function, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {TEST(test_devices_are_apart), TEST(test_wrong_devices),
                                       TEST(test_promises_suit_targets)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

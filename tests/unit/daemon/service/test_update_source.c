/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_update_source.c - tests that what an update starts from is found on disk, and that no more of it is read than
 * was promised: a record that is larger than a right update could have is promised before, too.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/daemon/update_request.h"
#include "tests/support/scratch.h"

enum { BOXES = 200000, INDEX = 3 };

static struct session_world world;
static struct service_options options;
static struct memory memory;
static struct key key; /* of the source, which is on disk alone */

/* Boxes of which one is inactive, so that the record has a bit for each. */
static struct geometry make_boxes(float (*boxes)[6], uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 6; k++)
            boxes[i][k] = (float)i + (k < 3 ? 0 : 0.5f);
    boxes[count / 2][0] = NAN;
    return (struct geometry){.type = GEOMETRY_AABBS,
                             .aabbs = {24, {(const unsigned char *)boxes, count * sizeof *boxes}},
                             .range = {.primitive_count = count}};
}

static struct build_input input_of(const struct geometry *geometry)
{
    return (struct build_input){.type = STRUCTURE_BOTTOM,
                                .flags = BUILD_ALLOW_UPDATE,
                                .geometry_count = 1,
                                .geometries = geometry,
                                .options = {.target = TARGET_PORTABLE, .quality = QUALITY_FAST}};
}

/* Has the source built and written to disk by a service that ends then. */
static int set_up(void **state)
{
    (void)state;
    float(*boxes)[6] = malloc(BOXES * sizeof *boxes);
    const struct geometry geometry = make_boxes(boxes, BOXES);
    const struct build_input input = input_of(&geometry);
    memory_init(&memory, UINT64_MAX);
    options = world_options();
    options.disk_directory = scratch_folder;
    options.disk_budget = 1 << 30;
    world_init(&world, &options);
    key = update_build(world_join(&world), &input);
    world_finish(&world);
    world_init(&world, &options);
    free(boxes);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    assert_int_equal(atomic_load(&memory.live), 0);
    return 0;
}

static uint64_t record_size(uint32_t primitives)
{
    return sizeof(struct record_header) + sizeof(struct record_geometry) + (primitives + 63) / 64 * sizeof(uint64_t);
}

/* A record is read where there is room for it, and stays as it is where there is not. */
static void records_are_read_where_there_is_room(void **state)
{
    (void)state;
    const atomic_bool cancel = false;
    const uint64_t size = record_size(BOXES);
    struct update_source source = {.disk = world.service->disk, .record.memory = &memory};
    struct bvhd_error error;
    assert_int_equal(update_source_find(&source, &key, INDEX, &cancel, &error), BVHD_OK);
    for (uint64_t room = size - 1; room > 0; room /= 8) {
        source.record.room = room;
        assert_int_equal(update_source_find_record(&source, &key, INDEX, &cancel, &error), BVHD_TOO_LARGE);
        assert_int_equal(source.record.size, size);
        assert_int_equal(update_source_record(&source).size, 0);
        assert_int_equal(atomic_load(&memory.peak), 0);
    }
    source.record.room = size;
    assert_int_equal(update_source_find_record(&source, &key, INDEX, &cancel, &error), BVHD_OK);
    assert_int_equal(update_source_record(&source).size, size);
    assert_int_equal(disk_state(world.service->disk).read_errors, 0);
    assert_int_equal(world_counters(&world).disk_damaged, 0);
    update_source_finish(&source);
}

/* Runs until no more is needed, with no promise that is not asked for, and returns how often it had to be asked for. */
static uint32_t prepare_by_promises(struct preparation *preparation, uint64_t promised)
{
    const atomic_bool cancel = false;
    uint32_t more = 0;
    preparation->promised = promised;
    preparation->class = ADMISSION_SMALL;
    for (;;) {
        preparation_run(preparation, &parallel_serial, &cancel);
        assert_true(atomic_load(&preparation->memory.peak) <= preparation->promised);
        if (preparation->needed == 0)
            return more;
        assert_true(preparation->needed > preparation->promised);
        assert_int_equal(atomic_load(&preparation->memory.live), 0);
        preparation->promised = preparation->needed;
        more++;
    }
}

/* An update of some boxes of the source, or of all: only the latter keeps the rules. */
static void records_are_promised_before_they_are_read(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 3, 1000, BOXES};
    float(*boxes)[6] = malloc(BOXES * sizeof *boxes);
    const struct limits limits = limits_default();
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        const struct geometry geometry = make_boxes(boxes, counts[i]);
        const struct build_input boxes_input = input_of(&geometry), input = update_of(&boxes_input);
        const bool is_right = counts[i] == BOXES;
        uint64_t size;
        unsigned char *bytes = world_payload(&input, &size);
        struct control_item item = world_item(&input, size, SOURCE_MEMFD, 0);
        struct payload *payload;
        item.source_key = key;
        assert_int_equal(payload_copy((struct bytes){bytes, size}, &memory, &payload, NULL), BVHD_OK);
        const struct preparation_source source = {.payload = payload, .size = size};
        struct preparation *preparation = preparation_create(&item, INDEX, &source, &memory);
        assert_non_null(preparation);
        preparation->limits = &limits;
        preparation->updated.disk = world.service->disk;
        const uint64_t bound = preparation_bound(&input);
        assert_int_equal(prepare_by_promises(preparation, bound), !is_right);
        if (is_right) {
            assert_int_equal(preparation->status, BVHD_OK);
        } else {
            assert_int_equal(preparation->status, BVHD_INVALID);
            assert_int_equal(preparation->error.vuid, BVHD_VUID_03769);
            assert_true(preparation->promised >= bound + record_size(BOXES) - record_size(counts[i] + 63));
        }
        preparation_destroy(preparation);
        free(bytes);
    }
    free(boxes);
}

/* The client gets the rule that its update breaks. */
static void the_service_tells_the_rule(void **state)
{
    (void)state;
    float boxes[1][6];
    const struct geometry geometry = make_boxes(boxes, 1);
    const struct build_input input = input_of(&geometry), update = update_of(&input);
    struct world_client *client = world_join(&world);
    update_expect(update_await(client, update_ask(client, &update, &key)), BVHD_INVALID, BVHD_VUID_03769,
                  "ranges[0][0].primitiveCount");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(records_are_read_where_there_is_room, set_up, tear_down),
        cmocka_unit_test_setup_teardown(records_are_promised_before_they_are_read, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_service_tells_the_rule, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, scratch_make_in_memory, scratch_remove);
}

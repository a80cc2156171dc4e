/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_check.c - tests which structures a device may load, and that all others are refused with a reason. */
#include "tests/support/unit.h"

#include "tests/support/client/vulkan/fake_vulkan.h"
#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

static const struct device_format this_driver = {"25.0.7-2~bpo12+1", "25.0.7-2~bpo12+1", LAVAPIPE_PLAIN};

/* A scene of each target, and a device. */
struct world {
    struct vulkan_bed portable, native;
    struct bvhd_vulkan_device *device;
    struct bvhd_format format;
};

static struct bvhd_vulkan_device *make_device(bool has_structures, bool has_addresses)
{
    struct bvhd_vulkan_device *device = NULL;
    const struct bvhd_vulkan_device_options options = fake_vulkan_options(has_structures, has_addresses, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_OK);
    return device;
}

static int set_up(void **state)
{
    struct world *world = calloc(1, sizeof *world);
    struct vulkan_bed_options options = {.target = TARGET_PORTABLE, .bottoms = 2, .instances = 5, .triangles = 12};
    vulkan_bed_init(&world->portable, &options);
    options.target = TARGET_LAVAPIPE;
    options.device = this_driver;
    vulkan_bed_init(&world->native, &options);
    fake_vulkan_reset();
    world->device = make_device(true, true);
    world->format = vulkan_bed_format(&this_driver);
    *state = world;
    return 0;
}

static int tear_down(void **state)
{
    struct world *world = *state;
    bvhd_vulkan_device_destroy(world->device);
    vulkan_bed_finish(&world->portable);
    vulkan_bed_finish(&world->native);
    free(world);
    return 0;
}

static enum bvhd_status check(const struct world *world, const struct bvhd_format *format,
                              const struct bvhd_vulkan_bytes *blob, struct bvhd_error *error)
{
    *error = (struct bvhd_error){.status = BVHD_OK};
    enum bvhd_status status = bvhd_vulkan_check(world->device, format, blob->data, blob->size, error);
    assert_int_equal(status, error->status);
    return status;
}

static void what_was_built_for_the_device_passes(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    for (uint32_t i = 0; i < world->portable.count; i++) {
        assert_int_equal(check(world, NULL, &world->portable.blobs[i], &error), BVHD_OK);
        assert_int_equal(check(world, &world->format, &world->portable.blobs[i], &error), BVHD_OK);
        assert_int_equal(check(world, &world->format, &world->native.blobs[i], &error), BVHD_OK);
    }
}

/* All 32 bytes count, and the text says what the device needs. */
static void other_drivers_are_told_apart(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    for (int i = 0; i < 32; i++) {
        struct bvhd_format other = world->format;
        (i < 16 ? other.driver_uuid : other.compatibility_uuid)[i % 16] ^= 1;
        assert_int_equal(check(world, &other, &world->native.blobs[0], &error), BVHD_INCOMPATIBLE);
        assert_string_equal(error.where, i < 16 ? "header.driverUUID" : "header.compatibilityUUID");
    }
    struct bvhd_format newer = world->format;
    memcpy(newer.driver_uuid, "25.0.8-1aaaaaaaa", 16);
    assert_int_equal(check(world, &newer, &world->native.blobs[1], &error), BVHD_INCOMPATIBLE);
    assert_string_equal(
        error.text,
        "for target lavapipe, driver 25.0.7-2~bpo12+1; this device needs target lavapipe, driver 25.0.8-1aaaaaaaa, "
        "or portable");
    newer.driver_uuid[3] = 0;
    assert_int_equal(check(world, &newer, &world->native.blobs[1], &error), BVHD_INCOMPATIBLE);
    assert_non_null(strstr(error.text, "driver 32352e002e382d31"));
}

/* The format fits the structures, but the driver has changed since. */
static void formats_that_are_out_of_date_are_found_out(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    fake_vulkan.is_updated = true;
    assert_int_equal(check(world, &world->format, &world->native.blobs[0], &error), BVHD_INCOMPATIBLE);
    assert_string_equal(error.where, "format");
    assert_non_null(strstr(error.text, "25.0.7-2~bpo12+1"));
    assert_int_equal(check(world, &world->format, &world->portable.blobs[0], &error), BVHD_OK);
}

/*
 * A structure with the same driver's UUIDs and another layout of the driver's header, which a driver would accept and
 * crash on, is refused.
 */
static void other_variants_are_refused(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    struct bvhd_format other = world->format;
    other.variant = LAVAPIPE_COMPACTED;
    for (uint32_t i = 0; i < world->native.count; i++) {
        assert_int_equal(check(world, &other, &world->native.blobs[i], &error), BVHD_INCOMPATIBLE);
        assert_string_equal(
            error.text,
            "for target lavapipe in its variant 1; this device needs target lavapipe in variant 2, or portable");
    }
}

static void a_structure_of_nobody_known_is_incompatible(void **state)
{
    struct world *world = *state;
    _Alignas(16) unsigned char data[512] = {0};
    struct bvhd_error error;
    const struct serialized_header header = {
        .driver_uuid = {1}, .serialized_size = sizeof data, .deserialized_size = 1024};
    const struct bvhd_vulkan_bytes blob = {data, sizeof data};
    serialized_write(data, &header);
    assert_int_equal(check(world, &world->format, &blob, &error), BVHD_INCOMPATIBLE);
    bytes_put64(data + 40, sizeof data - SERIALIZED_HANDLES);
    assert_int_equal(check(world, &world->format, &blob, &error), BVHD_INCOMPATIBLE);
    assert_non_null(strstr(error.text, "for target unknown, driver 0100000000"));
}

static void devices_without_structures_take_portable_ones(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    for (int i = 0; i < 2; i++) {
        bvhd_vulkan_device_destroy(world->device);
        world->device = make_device(i == 1, false); /* without addresses there are no structures either */
        assert_int_equal(check(world, NULL, &world->portable.blobs[2], &error), BVHD_OK);
        assert_int_equal(check(world, &world->format, &world->native.blobs[2], &error), BVHD_UNSUPPORTED);
        assert_non_null(strstr(error.text, "portable"));
    }
}

static void arguments_are_looked_at(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    const struct bvhd_vulkan_bytes *native = &world->native.blobs[0];
    const struct bvhd_vulkan_bytes nothing = {NULL, 0},
                                   skewed = {(const unsigned char *)world->portable.blobs[0].data + 8, 100};
    struct bvhd_format format = world->format;
    assert_int_equal(check(world, NULL, native, &error), BVHD_INVALID);
    assert_string_equal(error.where, "format");
    assert_int_equal(check(world, NULL, &nothing, &error), BVHD_INVALID);
    assert_int_equal(check(world, NULL, &skewed, &error), BVHD_INVALID);
    assert_string_equal(error.where, "data");
    format.struct_size--;
    assert_int_equal(check(world, &format, native, &error), BVHD_INVALID);
    format.struct_size++;
    format.variant = 0;
    assert_int_equal(check(world, &format, native, &error), BVHD_INVALID);
    format.variant = LAVAPIPE_VARIANTS + 1;
    assert_int_equal(check(world, &format, native, &error), BVHD_INVALID);
    assert_int_equal(bvhd_vulkan_check(world->device, &format, native->data, native->size, NULL), BVHD_INVALID);
}

static void limits_are_the_devices(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    const struct bvhd_vulkan_bytes *portable = &world->portable.blobs[0], *native = &world->native.blobs[0],
                                   *top = &world->native.blobs[2];
    static const struct {
        size_t field;
        uint64_t value;
        bool has_addresses;
        enum bvhd_status portable, native, top;
    } rows[] = {
        {offsetof(struct fake_vulkan, max_storage_range), 256, true, BVHD_OK, BVHD_OK, BVHD_OK},
        {offsetof(struct fake_vulkan, max_storage_range), 256, false, BVHD_TOO_LARGE, BVHD_UNSUPPORTED,
         BVHD_UNSUPPORTED},
        {offsetof(struct fake_vulkan, max_allocation), 300, true, BVHD_TOO_LARGE, BVHD_TOO_LARGE, BVHD_TOO_LARGE},
        {offsetof(struct fake_vulkan, max_buffer), 300, true, BVHD_TOO_LARGE, BVHD_TOO_LARGE, BVHD_TOO_LARGE},
        {offsetof(struct fake_vulkan, max_primitives), 11, true, BVHD_OK, BVHD_TOO_LARGE, BVHD_OK},
        {offsetof(struct fake_vulkan, max_primitives), 12, true, BVHD_OK, BVHD_OK, BVHD_OK},
        {offsetof(struct fake_vulkan, max_instances), 4, true, BVHD_OK, BVHD_OK, BVHD_TOO_LARGE},
        {offsetof(struct fake_vulkan, max_instances), 5, true, BVHD_OK, BVHD_OK, BVHD_OK},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        fake_vulkan_reset();
        memcpy((unsigned char *)&fake_vulkan + rows[i].field, &rows[i].value, sizeof rows[i].value);
        bvhd_vulkan_device_destroy(world->device);
        world->device = make_device(true, rows[i].has_addresses);
        assert_int_equal(check(world, NULL, portable, &error), rows[i].portable);
        assert_int_equal(check(world, &world->format, native, &error), rows[i].native);
        assert_int_equal(check(world, &world->format, top, &error), rows[i].top);
    }
}

/* Only the header is read, because no memory is large enough. */
static void what_shaders_cannot_reach_is_too_large(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    unsigned char *head = aligned_alloc(64, 256);
    assert_non_null(head);
    fake_vulkan.max_buffer = fake_vulkan.max_allocation = UINT64_MAX;
    bvhd_vulkan_device_destroy(world->device);
    world->device = make_device(true, true);
    memcpy(head, world->portable.blobs[0].data, 256);
    for (uint64_t more = 0; more < 2; more++) {
        uint64_t body = (UINT64_C(8) << 30) + 64 * more;
        bytes_put64(head + 32, 64 + body);
        bytes_put64(head + 40, body);
        bytes_put64(head + 64 + offsetof(struct portable_header, body_size), body);
        bytes_put32(head + 64 + offsetof(struct portable_header, version), 0);
        assert_int_equal(check(world, NULL, &(struct bvhd_vulkan_bytes){head, 64 + body}, &error),
                         more ? BVHD_TOO_LARGE : BVHD_INCOMPATIBLE);
    }
    free(head);
}

/*
 * Every truncation, one byte more, and every changed byte give an answer, and nothing is read outside (the blocks end
 * where the bytes end).
 */
static void whatever_is_offered_there_is_an_answer(void **state)
{
    struct world *world = *state;
    struct bvhd_error error;
    uint64_t refused = 0, changed = 0;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++)
        for (uint32_t i = 0; i < 3; i++) {
            const struct vulkan_bed *bed = target == TARGET_PORTABLE ? &world->portable : &world->native;
            const struct bvhd_vulkan_bytes *whole = &bed->blobs[i];
            for (uint64_t size = 0; size <= whole->size + 1; size++) {
                unsigned char *data = malloc(size + (size == 0));
                memcpy(data, whole->data, size < whole->size ? size : whole->size);
                if (size != whole->size)
                    assert_int_equal(check(world, &world->format, &(struct bvhd_vulkan_bytes){data, size}, &error),
                                     BVHD_CORRUPT);
                free(data);
            }
            unsigned char *data = malloc(whole->size);
            const struct bvhd_vulkan_bytes blob = {data, whole->size};
            memcpy(data, whole->data, whole->size);
            for (uint64_t at = 0; at < whole->size; at++) {
                data[at] ^= 0x41;
                refused += check(world, &world->format, &blob, &error) != BVHD_OK;
                changed++;
                data[at] ^= 0x41;
            }
            free(data);
        }
    assert_true(refused > changed / 20 && refused < changed);
}

int main(void)
{
#define WORLD_TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    static const struct CMUnitTest tests[] = {
        WORLD_TEST(what_was_built_for_the_device_passes),
        WORLD_TEST(other_drivers_are_told_apart),
        WORLD_TEST(other_variants_are_refused),
        WORLD_TEST(formats_that_are_out_of_date_are_found_out),
        WORLD_TEST(a_structure_of_nobody_known_is_incompatible),
        WORLD_TEST(devices_without_structures_take_portable_ones),
        WORLD_TEST(arguments_are_looked_at),
        WORLD_TEST(limits_are_the_devices),
        WORLD_TEST(what_shaders_cannot_reach_is_too_large),
        WORLD_TEST(whatever_is_offered_there_is_an_answer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

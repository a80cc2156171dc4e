/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_refusals.c - tests that structures which a device cannot load are refused before the driver reads a byte, and
 * that the text says what the device needs instead: another driver, another version, another layout of the same
 * version, another target, or no native target, for a device without acceleration structures. Skipped (77) where no
 * device loads our structures.
 */
#include "tests/support/unit.h"

#include "tests/support/driver/driver_scene.h"
#include "tests/support/driver/gpu_bed.h"
#include "builder/format/lavapipe.h"
#include "builder/format/serialized.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

enum { BOTTOMS = 2, INSTANCES = 5 };

static struct memory memory;
static struct gpu *gpu;
static struct bvhd_format format;
static struct device_format device;

static void build_for(struct vulkan_bed *bed, enum target target, const struct device_format *whose)
{
    const struct vulkan_bed_options options = {
        .target = target, .device = *whose, .bottoms = BOTTOMS, .instances = INSTANCES, .triangles = 12};
    vulkan_bed_init(bed, &options);
}

/* Whether the driver itself accepts the header of a structure. */
static bool driver_takes(const struct bvhd_vulkan_bytes *blob)
{
    const VkAccelerationStructureVersionInfoKHR version = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR, .pVersionData = blob->data};
    VkAccelerationStructureCompatibilityKHR answer;
    gpu->vk.GetDeviceAccelerationStructureCompatibilityKHR(gpu->device, &version, &answer);
    return answer == VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR;
}

static enum bvhd_status load(struct bvhd_vulkan_device *on, const struct bvhd_vulkan_bytes *blobs, uint32_t count,
                             struct bvhd_error *error)
{
    struct bvhd_vulkan_scene *scene = NULL;
    const struct bvhd_vulkan_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = count, .format = &format};
    enum bvhd_status status = bvhd_vulkan_scene_create(on, &gpu->queue, &options, &scene, error);
    bvhd_vulkan_scene_destroy(scene);
    return status;
}

/* Checks that bvhd_vulkan_check refuses each structure, and that loading a scene of them is refused, too. */
static void assert_refused(struct bvhd_vulkan_device *on, const struct vulkan_bed *bed, enum bvhd_status expected,
                           const char *text)
{
    struct bvhd_error error = {.status = BVHD_OK};
    for (uint32_t i = 0; i < bed->count; i++) {
        assert_int_equal(bvhd_vulkan_check(on, &format, bed->blobs[i].data, bed->blobs[i].size, &error), expected);
        if (text && !strstr(error.text, text))
            fail_msg("'%s' is not in: %s: %s", text, error.where, error.text);
    }
    assert_int_equal(load(on, bed->blobs, bed->count, &error), expected);
    assert_true(strncmp(error.where, "blobs[0]", 8) == 0);
    print_message("refused: %s: %s\n", error.where, error.text);
}

static void its_own_are_taken(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct bvhd_error error;
    build_for(&bed, TARGET_LAVAPIPE, &device);
    for (uint32_t i = 0; i < bed.count; i++) {
        assert_true(driver_takes(&bed.blobs[i]));
        assert_int_equal(bvhd_vulkan_check(gpu->library, &format, bed.blobs[i].data, bed.blobs[i].size, &error),
                         BVHD_OK);
    }
    assert_int_equal(load(gpu->library, bed.blobs, bed.count, &error), BVHD_OK);
    vulkan_bed_finish(&bed);
}

static void another_versions_are_refused(void **state)
{
    (void)state;
    static const char other[] = "24.3.1-1aaaaaaaa";
    struct vulkan_bed bed;
    struct device_format another = device;
    char needed[80];
    memcpy(another.driver_uuid, other, sizeof another.driver_uuid);
    memcpy(another.compatibility_uuid, other, sizeof another.compatibility_uuid);
    build_for(&bed, TARGET_LAVAPIPE, &another);
    assert_false(driver_takes(&bed.blobs[0]));
    snprintf(needed, sizeof needed, "this device needs target %s, driver ", bvhd_target_name(format.target));
    assert_refused(gpu->library, &bed, BVHD_INCOMPATIBLE, needed);
    assert_refused(gpu->library, &bed, BVHD_INCOMPATIBLE, "for target lavapipe, driver 24.3.1-1aaaaaaaa;");
    vulkan_bed_finish(&bed);
}

/* The driver compares only one of the two UUIDs and would load the structure. */
static void both_uuids_count(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct device_format another = device;
    another.compatibility_uuid[0] ^= 1;
    build_for(&bed, TARGET_LAVAPIPE, &another);
    assert_refused(gpu->library, &bed, BVHD_INCOMPATIBLE, "this device needs target");
    vulkan_bed_finish(&bed);
}

/* The driver would load the structure as its own, because the header says so. */
static void another_variants_are_refused(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct device_format another = device;
    another.variant = device.variant == LAVAPIPE_PLAIN ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN;
    build_for(&bed, TARGET_LAVAPIPE, &another);
    assert_true(driver_takes(&bed.blobs[0]));
    assert_refused(gpu->library, &bed, BVHD_INCOMPATIBLE, "this device needs target lavapipe in variant ");
    vulkan_bed_finish(&bed);
}

static void portable_ones_do_not_become_native(void **state)
{
    (void)state;
    const struct device_format none = {.variant = 0};
    struct vulkan_bed portable, native;
    struct bvhd_vulkan_requirements needed;
    struct bvhd_error error;
    build_for(&portable, TARGET_PORTABLE, &none);
    build_for(&native, TARGET_LAVAPIPE, &device);
    for (uint32_t i = 0; i < portable.count; i++) {
        assert_false(driver_takes(&portable.blobs[i]));
        assert_int_equal(
            bvhd_vulkan_requirements(gpu->library, portable.blobs[i].data, portable.blobs[i].size, &needed, &error),
            BVHD_OK);
        assert_int_equal(needed.target, BVHD_TARGET_PORTABLE);
    }
    /* A native top level over portable bottom levels, and a portable one over native ones. */
    struct bvhd_vulkan_bytes mixed[BOTTOMS + 1] = {portable.blobs[0], portable.blobs[1], native.blobs[2]};
    assert_int_not_equal(load(gpu->library, mixed, BOTTOMS + 1, &error), BVHD_OK);
    print_message("refused: %s: %s\n", error.where, error.text);
    mixed[0] = native.blobs[0];
    mixed[1] = native.blobs[1];
    mixed[2] = portable.blobs[2];
    assert_int_not_equal(load(gpu->library, mixed, BOTTOMS + 1, &error), BVHD_OK);
    print_message("refused: %s: %s\n", error.where, error.text);
    vulkan_bed_finish(&native);
    vulkan_bed_finish(&portable);
}

static void a_device_without_structures_wants_portable_ones(void **state)
{
    (void)state;
    const struct device_format none = {.variant = 0};
    const struct bvhd_vulkan_device_options without = {.struct_size = sizeof without,
                                                       .get_instance_proc_addr = gpu->get_instance_proc_addr,
                                                       .instance = gpu->instance,
                                                       .physical_device = gpu->physical,
                                                       .device = gpu->device};
    struct vulkan_bed portable, native;
    struct bvhd_vulkan_device *plain;
    struct bvhd_error error;
    void *probe;
    uint64_t size;
    assert_int_equal(bvhd_vulkan_device_create(&without, &plain, &error), BVHD_OK);
    build_for(&native, TARGET_LAVAPIPE, &device);
    assert_refused(plain, &native, BVHD_UNSUPPORTED, "needs target portable");
    assert_int_equal(bvhd_vulkan_probe(plain, &gpu->queue, &probe, &size, &error), BVHD_UNSUPPORTED);
    build_for(&portable, TARGET_PORTABLE, &none);
    assert_int_equal(load(plain, portable.blobs, portable.count, &error), BVHD_OK);
    vulkan_bed_finish(&portable);
    vulkan_bed_finish(&native);
    bvhd_vulkan_device_destroy(plain);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(its_own_are_taken),
        cmocka_unit_test(another_versions_are_refused),
        cmocka_unit_test(both_uuids_count),
        cmocka_unit_test(another_variants_are_refused),
        cmocka_unit_test(portable_ones_do_not_become_native),
        cmocka_unit_test(a_device_without_structures_wants_portable_ones),
    };
    memory_init(&memory, UINT64_MAX);
    if (!driver_scene_device(&memory, &gpu, &format))
        return GPU_BED_SKIPPED;
    device.variant = format.variant;
    memcpy(device.driver_uuid, format.driver_uuid, sizeof device.driver_uuid);
    memcpy(device.compatibility_uuid, format.compatibility_uuid, sizeof device.compatibility_uuid);
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    gpu_close(gpu);
    return failed || memory.live || gpu_messages();
}

/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_device.c - tests how a device's functions and limits are found, and how a device is probed. */
#include "tests/support/unit.h"

#include "tests/support/client/vulkan/fake_vulkan.h"
#include "client/library.h"
#include "builder/format/probe.h"
#include "client/vulkan/vulkan_device.h"

static void devices_know_their_limits(void **state)
{
    (void)state;
    struct bvhd_vulkan_device *device = NULL;
    fake_vulkan_reset();
    fake_vulkan.max_buffer = 123456;
    const struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_OK);
    assert_int_equal(device->limits.buffer, 123456);
    assert_int_equal(device->limits.storage_alignment, 128);
    assert_int_equal(device->limits.instances, 1 << 24);
    assert_true(device->has_structures && device->has_addresses);
    assert_string_equal(device->name, "plain memory");
    assert_string_equal(device->driver, "");
    bvhd_vulkan_device_destroy(device);
    bvhd_vulkan_device_destroy(NULL);
    assert_int_equal(library_memory.live, 0);
}

/* Functions that a device does not need are not looked up. */
static void missing_functions_are_named(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int needs; /* 0: always, 1: with addresses, 2: with structures */
    } rows[] = {
        {"vkGetDeviceProcAddr", 0},
        {"vkGetPhysicalDeviceProperties2", 0},
        {"vkGetPhysicalDeviceMemoryProperties", 0},
        {"vkEnumerateDeviceExtensionProperties", 0},
#define VULKAN_ALWAYS(function) {"vk" #function, 0},
#define VULKAN_ADDRESS(function) {"vk" #function, 1},
#define VULKAN_STRUCTURE(function) {"vk" #function, 2},
#include "client/vulkan/vulkan_functions.def"
#undef VULKAN_ALWAYS
#undef VULKAN_ADDRESS
#undef VULKAN_STRUCTURE
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (int has = 0; has <= 2; has++) {
            struct bvhd_vulkan_device *device = NULL;
            struct bvhd_error error = {0};
            fake_vulkan_reset();
            fake_vulkan.missing = rows[i].name;
            const struct bvhd_vulkan_device_options options = fake_vulkan_options(has == 2, has >= 1, NULL);
            enum bvhd_status status = bvhd_vulkan_device_create(&options, &device, &error);
            assert_int_equal(status, has >= rows[i].needs ? BVHD_INVALID : BVHD_OK);
            if (status != BVHD_OK) {
                assert_string_equal(error.where, rows[i].name);
                assert_null(device);
            }
            bvhd_vulkan_device_destroy(device);
            assert_int_equal(library_memory.live, 0);
        }
}

static void options_are_checked(void **state)
{
    (void)state;
    static const char *const places[5] = {"options.struct_size", "options.get_instance_proc_addr", "options.instance",
                                          "options.physical_device", "options.device"};
    fake_vulkan_reset();
    for (int i = 0; i < 5; i++) {
        struct bvhd_vulkan_device *device = NULL;
        struct bvhd_error error = {0};
        struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
        if (i == 0)
            options.struct_size = 8;
        else if (i == 1)
            options.get_instance_proc_addr = NULL;
        else if (i == 2)
            options.instance = VK_NULL_HANDLE;
        else if (i == 3)
            options.physical_device = VK_NULL_HANDLE;
        else
            options.device = VK_NULL_HANDLE;
        assert_int_equal(bvhd_vulkan_device_create(&options, &device, &error), BVHD_INVALID);
        assert_string_equal(error.where, places[i]);
        assert_null(device);
    }
}

static void a_lack_of_memory_leaves_nothing(void **state)
{
    (void)state;
    for (int64_t n = 0;; n++) {
        struct bvhd_vulkan_device *device = NULL;
        fake_vulkan_reset();
        const struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
        library_memory.fail_after = n;
        enum bvhd_status status = bvhd_vulkan_device_create(&options, &device, NULL);
        library_memory.fail_after = -1;
        bvhd_vulkan_device_destroy(device);
        assert_int_equal(library_memory.live, 0);
        if (status == BVHD_OK) {
            assert_true(n >= 2);
            break;
        }
        assert_int_equal(status, BVHD_NO_MEMORY);
    }
    for (int64_t n = 0; n < 2; n++) {
        struct bvhd_vulkan_device *device = NULL;
        const struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
        fake_vulkan.fail_after = n;
        fake_vulkan.failure = VK_ERROR_OUT_OF_HOST_MEMORY;
        assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_NO_MEMORY);
        assert_int_equal(library_memory.live, 0);
    }
}

static void results_have_a_status(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    assert_int_equal(vulkan_device_result("vkX", VK_SUCCESS, &error), BVHD_OK);
    assert_int_equal(vulkan_device_result("vkX", VK_ERROR_OUT_OF_HOST_MEMORY, &error), BVHD_NO_MEMORY);
    assert_int_equal(vulkan_device_result("vkX", VK_ERROR_TOO_MANY_OBJECTS, &error), BVHD_NO_MEMORY);
    assert_int_equal(vulkan_device_result("vkX", VK_ERROR_DEVICE_LOST, &error), BVHD_UNAVAILABLE);
    assert_int_equal(vulkan_device_result("vkX", VK_ERROR_FEATURE_NOT_PRESENT, &error), BVHD_INTERNAL);
    assert_string_equal(error.text, "VK_ERROR_FEATURE_NOT_PRESENT");
    assert_int_equal(vulkan_device_result("vkX", (VkResult)-77, &error), BVHD_INTERNAL);
    assert_string_equal(error.text, "VkResult -77");
    assert_string_equal(error.where, "vkX");
}

/* ---- The probe, on a device with its own format of structures ---- */

static enum bvhd_status probe(struct bvhd_vulkan_device *device, void **ret_probe, uint64_t *ret_size,
                              struct bvhd_error *error)
{
    const struct bvhd_vulkan_queue queue = fake_vulkan_queue();
    return bvhd_vulkan_probe(device, &queue, ret_probe, ret_size, error);
}

/*
 * Returns the expected byte where the driver wrote none: two instances name the first two structures, by numbers,
 * because addresses differ from run to run.
 */
static unsigned left_out(int structure, uint64_t at)
{
    return structure == PROBE_INSTANCES && at == 64 ? 1 : structure == PROBE_INSTANCES && at == 64 + 9 ? 2 : 0;
}

static void a_probe_holds_what_the_device_gave(void **state)
{
    (void)state;
    struct bvhd_vulkan_device *device = NULL;
    struct bvhd_error error = {0};
    struct probe unpacked;
    void *data = NULL;
    uint64_t size = 0;
    fake_vulkan_reset();
    const struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_OK);
    assert_int_equal(probe(device, &data, &size, &error), BVHD_OK);
    assert_int_equal(probe_unpack((struct bytes){data, size}, &unpacked, &error), BVHD_OK);
    assert_string_equal(unpacked.device, "plain memory");
    for (int i = 0; i < PROBE_COUNT; i++) {
        struct probe_request request;
        probe_request_init(&request, (enum probe_structure)i);
        uint64_t created = 128 + UINT64_C(64) * request.canonical.primitive_count;
        assert_int_equal(unpacked.structures[i].size, 56 + created);
        /* The driver wrote the first 64 bytes; the bytes that it left out are zero. */
        for (uint64_t at = 0; at < created; at++)
            assert_int_equal(unpacked.structures[i].data[56 + at], at < 64 ? created & 0xff : left_out(i, at));
        assert_int_equal(unpacked.handles[i], i + 1);
    }
    bvhd_vulkan_free(data);
    bvhd_vulkan_free(NULL);
    bvhd_vulkan_device_destroy(device);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, 0);
}

static void a_probe_needs_structures(void **state)
{
    (void)state;
    struct bvhd_vulkan_device *device = NULL;
    void *data = NULL;
    uint64_t size;
    fake_vulkan_reset();
    const struct bvhd_vulkan_device_options options = fake_vulkan_options(false, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_OK);
    assert_int_equal(probe(device, &data, &size, NULL), BVHD_UNSUPPORTED);
    assert_null(data);
    bvhd_vulkan_device_destroy(device);
}

static void whatever_fails_in_a_probe_nothing_is_left(void **state)
{
    (void)state;
    struct bvhd_vulkan_device *device = NULL;
    fake_vulkan_reset();
    const struct bvhd_vulkan_device_options options = fake_vulkan_options(true, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&options, &device, NULL), BVHD_OK);
    for (int own = 0; own < 2; own++)
        for (int64_t n = 0;; n++) {
            uint64_t live = library_memory.live, size = 0;
            void *data = NULL;
            struct bvhd_error error = {0};
            fake_vulkan.failure = VK_ERROR_DEVICE_LOST;
            if (own)
                library_memory.fail_after = n;
            else
                fake_vulkan.fail_after = n;
            enum bvhd_status status = probe(device, &data, &size, &error);
            fake_vulkan.fail_after = -1;
            library_memory.fail_after = -1;
            bvhd_vulkan_free(data);
            assert_int_equal(library_memory.live, live);
            assert_int_equal(fake_vulkan.live, 0);
            if (status == BVHD_OK) {
                assert_true(n > (own ? 0 : 20));
                break;
            }
            assert_int_equal(status, own ? BVHD_NO_MEMORY : BVHD_UNAVAILABLE);
            assert_null(data);
        }
    bvhd_vulkan_device_destroy(device);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(devices_know_their_limits), cmocka_unit_test(missing_functions_are_named),
        cmocka_unit_test(options_are_checked),       cmocka_unit_test(a_lack_of_memory_leaves_nothing),
        cmocka_unit_test(results_have_a_status),     cmocka_unit_test(a_probe_holds_what_the_device_gave),
        cmocka_unit_test(a_probe_needs_structures),  cmocka_unit_test(whatever_fails_in_a_probe_nothing_is_left),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
